# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl validate`: compare a machine with identified parameters with a bag."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome, say

if TYPE_CHECKING:
    from identnl_ros.sources.bag_validation import BagValidation

DOCUMENT = 'validation.json'
TRACES = 'traces'


@click.command('validate')
@click.argument('bag', type=click.Path(path_type=Path))
@click.option(
    '--parameters',
    required=True,
    type=click.Path(path_type=Path),
    help='Identified values: what "identnl identify --json" prints.',
)
@click.option(
    '--machine',
    type=click.Path(path_type=Path),
    help='Machine file; without it, the one that the bag carries.',
)
@click.option(
    '--out',
    type=click.Path(path_type=Path, file_okay=False),
    help=f'Folder to write {DOCUMENT} and {TRACES}.csv to: measurement, simulation, band.',
)
@click.option(
    '--samples',
    type=click.IntRange(1, 100_000),
    default=2000,
    show_default=True,
    help='So many samples of traces at most, from the beginning.',
)
@reporting
def command(
    bag: Path, parameters: Path, machine: Path | None, out: Path | None, samples: int
) -> Outcome:
    """
    Simulate the machine under the force measured in BAG and compare with every sensor.

    Take a bag that the identification has not seen. Exit code 1: the model differs from the
    measurement by more than the sensors' noise and the parameters' uncertainty explain.
    """
    from identnl_ros.reports.validation_document import validation_document
    from identnl_ros.sources.bag_validation import validate_bag

    result = validate_bag(bag, parameters, machine, samples if out else 0)
    for problem in result.problems:
        say(f'warning: {problem}')
    document = {
        'bag': str(bag),
        'parameters': str(parameters),
        'machine': result.machine.name,
        **validation_document(result.agreement, result.stream_ids),
        'notes': list(result.notes),
        'problems': list(result.problems),
    }
    if out is not None:
        _write(out, result, json.dumps(document, indent=2, allow_nan=False))
    return Outcome(document, lambda: _show(result), DONE if result.agreement.agrees else NEGATIVE)


def _write(out: Path, result: 'BagValidation', text: str) -> None:
    from identnl_ros.reports.validation_document import trace_table
    from identnl_ros.storage.replaced_file import write_text

    several = len(result.traces) > 1
    for i, traces in enumerate(result.traces, start=1):
        if traces is not None:
            write_text(
                out / (f'{TRACES}_{i}.csv' if several else f'{TRACES}.csv'), trace_table(traces)
            )
    write_text(out / DOCUMENT, [text, '\n'])


def _show(result: 'BagValidation') -> None:
    from identnl_ros.reports.validation_tables import show_validation
    from rich.console import Console

    show_validation(result.agreement, result.notes, Console())
