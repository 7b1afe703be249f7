# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl design`: what a planned run would determine, and which run and sensors suffice."""

from pathlib import Path

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome, say
from identnl_ros.cli.progress import progress
from identnl_ros.cli.quantity_types import ERROR, FORCE, FREQUENCY, TIME

DURATION = 1.0  # [s]
# Of a longer run this much is computed, and scaled [s].
COMPUTED_AT_MOST = 4.0


@click.command('design')
@click.argument('machine', type=click.Path(path_type=Path))
@click.argument('layout', required=False, type=click.Path(path_type=Path))
@click.option(
    '--error',
    'wanted',
    type=ERROR,
    help='Relative standard error wanted of every parameter; find a plan for it.',
)
@click.option(
    '--excitation',
    type=click.Choice(['multisine', 'sine', 'sweep', 'impulse']),
    help='Without it multisine; with --error, the best of multisine, sweep and sine.',
)
@click.option(
    '--duration',
    type=TIME,
    help='[s]; without it 1 s; with --error, the longest allowed.',
)
@click.option(
    '--amplitude',
    type=FORCE,
    help='Of every exciter [N]; without it, that of the machine file; with --error, a third, once '
    'and three times that.',
)
@click.option(
    '--largest-amplitude',
    type=FORCE,
    help='That exciters can do [N]; without it, more than in the machine file is not advised.',
)
@click.option(
    '--frequency', type=FREQUENCY, help='Of a sine [Hz]; without it, that of the machine file.'
)
@click.option(
    '--band',
    nargs=2,
    type=FREQUENCY,
    help='Of a multisine or sweep [Hz]; without it, that of the machine file.',
)
@click.option('--period', type=TIME, default=1.0, show_default=True, help='Of a multisine [s].')
@click.option(
    '--settling',
    type=TIME,
    default=1.0,
    show_default=True,
    help='From rest to the first sample used [s].',
)
@click.option(
    '--rate',
    type=FREQUENCY,
    help='Sample rate [Hz]; without it, that of the layout file or 10 kHz.',
)
@click.option(
    '--seed',
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help='Of the phases of a multisine.',
)
@reporting
def command(
    machine: Path,
    layout: Path | None,
    wanted: float | None,
    excitation: str | None,
    duration: float | None,
    amplitude: float | None,
    largest_amplitude: float | None,
    frequency: float | None,
    band: tuple[float, float] | None,
    period: float,
    settling: float,
    rate: float | None,
    seed: int,
) -> Outcome:
    """
    Tell what a run on MACHINE with the sensors of LAYOUT would determine, before it is made.

    Without LAYOUT, MACHINE_layout.yaml beside the machine file. Exit code 1: a parameter would
    not be identifiable, or no plan meets the wanted error.
    """
    from identnl_ros.core.design.design import outlook
    from identnl_ros.core.design.plan_search import compare
    from identnl_ros.core.design.sensor_choice import sensor_importances
    from identnl_ros.core.errors import DataError
    from identnl_ros.core.mechanics.assembly import assemble
    from identnl_ros.reports.design_document import design_document
    from identnl_ros.sources.planned import plan, plans_to_compare, PlanSettings
    from identnl_ros.sources.simulated import Excitation
    from identnl_ros.sources.stand_layout import stand_layout
    from identnl_ros.storage.machine_file import load_machine

    machine_file = load_machine(machine)
    sensors = stand_layout(machine_file, layout)
    if sensors.remark:
        say(sensors.remark)
    planned = machine_file.machine
    settings = PlanSettings(
        sensors.sample_rate(rate), settling, amplitude, frequency, band, period, seed
    )
    if wanted is None and largest_amplitude is not None:
        raise DataError('--largest-amplitude limits the search for a plan: give --error too')
    if wanted is not None and not 0 < wanted < float('inf'):
        raise DataError(f'--error: the wanted error is {wanted:g}, expected more than 0, e.g. 1 %')
    for name, time in (('duration', duration), ('settling', settling or 1.0)):
        if time is not None and not 0 < time < float('inf'):
            raise DataError(f'--{name}: {time:g} s, expected a positive time')
    kind = None if excitation is None else Excitation(excitation)
    model = assemble(planned)
    comparison = None
    if wanted is None:
        chosen = plan(planned, settings, kind or Excitation.MULTISINE, duration or DURATION)
        expected = outlook(model, sensors.layout, chosen, COMPUTED_AT_MOST)
        done = expected.expectation.identifiable
    else:
        plans = plans_to_compare(planned, settings, kind, largest_amplitude)
        longest = float('inf') if duration is None else duration
        with progress('computing plans', len(plans)) as advance:
            comparison = compare(model, sensors.layout, plans, wanted, longest, advance)
        expected = comparison.best.outlook
        done = comparison.met
    importances = sensor_importances(model, expected.sensors)

    def show() -> None:
        from identnl_ros.reports.design_tables import show_design
        from rich.console import Console

        show_design(expected, sensors.layout, importances, Console(), comparison)

    document = {
        'machine': planned.name,
        **design_document(expected, sensors.layout, importances, comparison),
    }
    return Outcome(document, show, DONE if done else NEGATIVE)
