# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl identify`: the parameters of a machine from bags."""

import json
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome, say
from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus

if TYPE_CHECKING:
    pass


@click.command('identify')
@click.argument('bags', type=click.Path(path_type=Path), nargs=-1, required=True, metavar='BAG...')
@click.option(
    '--machine',
    type=click.Path(path_type=Path),
    help='Machine file; without it, the one that the first bag carries.',
)
@click.option(
    '--estimator',
    type=click.Choice(['weak', 'pointwise', 'likelihood']),
    default='weak',
    show_default=True,
    help='weak: streaming, survives sensor noise. pointwise: least squares on every sample '
    '(Berczynski et al. 2010), for clean data. likelihood: simulation against all sensors, '
    'for partial layouts and unknown sensors.',
)
@click.option(
    '--unknown',
    'unknowns',
    multiple=True,
    metavar='SENSORS.QUANTITY',
    help='With the likelihood: estimate also the offset, gain or delay of a sensor or of all '
    'sensors of a kind, e.g. acceleration.delay; may be repeated.',
)
@click.option(
    '--without',
    multiple=True,
    metavar='SENSOR',
    help='Do not use this sensor; may be repeated.',
)
@click.option(
    '--bounded',
    is_flag=True,
    help='Keep stiffness, damping, mass, preload and exponent from being negative.',
)
@reporting
def command(
    bags: tuple[Path, ...],
    machine: Path | None,
    estimator: str,
    unknowns: tuple[str, ...],
    without: tuple[str, ...],
    bounded: bool,
) -> Outcome:
    """
    Identify the parameters marked "estimate" in the machine file.

    From one or several BAGs of the same machine. Exit code 1: the data determine none of them
    so that it could be said how well, or the estimates are not to be trusted because model and
    data disagree.
    """
    from identnl_ros.cli.progress import activity
    from identnl_ros.core.estimation.physical_bounds import within_physical_bounds
    from identnl_ros.reports.estimate_document import estimate_document
    from identnl_ros.sources.offline import identify_bags
    from identnl_ros.storage.bag_reader import open_bag

    told: set[str] = set()

    def tell(sentence: str) -> None:
        told.add(sentence)
        say(f'warning: {sentence}')

    with activity('identify') as doing:
        result = identify_bags(bags, machine, estimator, unknowns, without, tell, doing)
    truth = _truth(open_bag(bags[0]).metadata('identnl.truth'))
    estimate = within_physical_bounds(result.estimate) if bounded else result.estimate
    remarks = result.losses.remarks()
    for remark in remarks:
        if remark not in told:
            say(f'warning: {remark}')
    document = {
        'bag': str(bags[0]),
        'bags': [str(bag) for bag in bags],
        'machine': result.machine.name,
        **estimate_document(estimate, truth),
        'problems': remarks,
        'left_out': result.losses.causes,
    }
    return Outcome(document, lambda: _show(estimate, truth), _exit_code(estimate))


def _exit_code(estimate: Estimate) -> int:
    determined = any(isfinite(one.standard_deviation) for one in estimate.parameters)
    doubted = any(one.status is EstimateStatus.MODEL_IN_DOUBT for one in estimate.parameters)
    return DONE if determined and not doubted else NEGATIVE


def _truth(metadata: dict[str, str] | None) -> dict[str, float]:
    return json.loads(metadata['parameters']) if metadata else {}


def _show(estimate: Estimate, truth: dict[str, float]) -> None:
    from identnl_ros.reports.estimate_tables import show_estimate
    from rich.console import Console

    show_estimate(estimate, truth, Console())
