# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl identify`: the parameters of a machine from a bag."""

import json
from pathlib import Path

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome, say
from identnl_ros.core.estimate import Estimate


@click.command('identify')
@click.argument('bag', type=click.Path(path_type=Path))
@click.option(
    '--machine',
    type=click.Path(path_type=Path),
    help='Machine file; without it, the one that the bag carries.',
)
@click.option(
    '--estimator',
    type=click.Choice(['pointwise']),
    default='pointwise',
    show_default=True,
    help='pointwise: least squares on every sample (Berczynski et al. 2010).',
)
@reporting
def command(bag: Path, machine: Path | None, estimator: str) -> Outcome:
    """
    Identify the parameters marked "estimate" in the machine file from BAG.

    Exit code 1: the data determine none of them.
    """
    from identnl_ros.reports.estimate_document import estimate_document
    from identnl_ros.sources.offline import identify_bag
    from identnl_ros.storage.bag_reader import open_bag

    result = identify_bag(bag, machine)
    truth = _truth(open_bag(bag).metadata('identnl.truth'))
    estimate = result.estimate
    remarks = [
        *result.problems,
        *(
            f'{name}: {count} samples without a valid reading'
            for name, count in result.readings_missing.items()
        ),
    ]
    if result.lost_samples:
        remarks.append(f'{result.lost_samples} samples are missing between the blocks')
    if result.unusable_blocks:
        remarks.append(f'{result.unusable_blocks} blocks were repeated, late or foreign')
    for remark in remarks:
        say(f'warning: {remark}')
    document = {
        'bag': str(bag),
        'machine': result.machine.name,
        **estimate_document(estimate, truth),
        'problems': remarks,
    }
    determined = any(parameter.value == parameter.value for parameter in estimate.parameters)
    return Outcome(document, lambda: _show(estimate, truth), DONE if determined else NEGATIVE)


def _truth(metadata: dict[str, str] | None) -> dict[str, float]:
    return json.loads(metadata['parameters']) if metadata else {}


def _show(estimate: Estimate, truth: dict[str, float]) -> None:
    from identnl_ros.reports.estimate_tables import show_estimate
    from rich.console import Console

    show_estimate(estimate, truth, Console())
