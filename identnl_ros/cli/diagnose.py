# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl diagnose`: find what the model of a machine or a layout lacks."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome, say

if TYPE_CHECKING:
    from identnl_ros.core.discrepancy.checked_diagnosis import CheckedDiagnosis

DOCUMENT = 'diagnosis.json'
MACHINE = 'machine.yaml'
LAYOUT = 'layout.yaml'
REPORT = 'report.md'


@click.command('diagnose')
@click.argument('bag', type=click.Path(path_type=Path))
@click.option(
    '--machine',
    type=click.Path(path_type=Path),
    help='Machine file; without it, the one that the bag carries.',
)
@click.option(
    '--validate',
    type=click.Path(path_type=Path),
    help='Bag to check the result on; without it, the last part of BAG, which is left out then.',
)
@click.option('--seed', type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    '--out',
    type=click.Path(path_type=Path, file_okay=False),
    help=f'Folder to write {DOCUMENT} to, the corrected {MACHINE} and {LAYOUT}, '
    f'plots and {REPORT}.',
)
@reporting
def command(
    bag: Path, machine: Path | None, validate: Path | None, seed: int, out: Path | None
) -> Outcome:
    """
    Find what is missing where simulation and measurement differ, name it, add it.

    Exit code 1: they differ, and no known effect explains it.
    """
    from identnl_ros.core.discrepancy.diagnosis import Verdict
    from identnl_ros.reports.diagnosis_document import diagnosis_document
    from identnl_ros.sources.bag_diagnosis import diagnose_bag

    result = diagnose_bag(bag, machine, validate, seed, lambda what: say(f'{what} ...'))
    for problem in result.problems:
        say(f'warning: {problem}')
    plots = _plots(result) if out else {}
    document = {
        'bag': str(bag),
        'machine': result.machine.name,
        **diagnosis_document(result),
        'machine_file': str(out / MACHINE) if out else None,
        'layout_file': str(out / LAYOUT) if out else None,
        'plots': [str(out / name) for name in plots] if out else [],
    }
    if out is not None:
        _write(out, result, plots, json.dumps(document, indent=2, allow_nan=False))
    unexplained = result.diagnosis.verdict is Verdict.UNEXPLAINED
    return Outcome(document, lambda: _show(result), NEGATIVE if unexplained else DONE)


def _plots(result: 'CheckedDiagnosis') -> dict[str, tuple[str, bytes]]:
    """Draw; what is seen, and the picture, by the name of the file."""
    say('drawing ...')
    from identnl_ros.reports.diagnosis_plots import diagnosis_plots

    return {name: (words, content) for name, words, content in diagnosis_plots(result)}


def _write(
    out: Path, result: 'CheckedDiagnosis', plots: dict[str, tuple[str, bytes]], text: str
) -> None:
    from identnl_ros.reports.diagnosis_document import summary
    from identnl_ros.reports.diagnosis_tables import diagnosis_markdown
    from identnl_ros.storage.layout_writing import layout_text
    from identnl_ros.storage.machine_writing import machine_text
    from identnl_ros.storage.replaced_file import write_bytes, write_text

    after = result.diagnosis.after
    values = {one.name: one.value for one in after.model.parameters}
    said = summary(result)
    write_text(out / MACHINE, [machine_text(after.description.machine, values, said)])
    write_text(out / LAYOUT, [layout_text(after.description.layout, said)])
    for name, (_, content) in plots.items():
        write_bytes(out / name, [content])
    captions = {name: words for name, (words, _) in plots.items()}
    write_text(out / REPORT, diagnosis_markdown(result, captions))
    write_text(out / DOCUMENT, [text, '\n'])


def _show(result: 'CheckedDiagnosis') -> None:
    from identnl_ros.reports.diagnosis_tables import show_diagnosis
    from rich.console import Console

    show_diagnosis(result, Console())
