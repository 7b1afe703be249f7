# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl demo`: the simulated knee and column identified live, over DDS."""

import click
from identnl_ros.cli.output import command as reporting, DONE, NEGATIVE, Outcome, say
from identnl_ros.cli.quantity_types import NOISE, TIME
from identnl_ros.cli.ros import require_ros

MACHINE = 'knee_column.yaml'
SAMPLE_RATE = 10_000.0


@click.command('demo')
@click.option(
    '--duration', type=TIME, default=10.0, show_default=True, help='Of the run [s], in real time.'
)
@click.option(
    '--excitation',
    type=click.Choice(['sine', 'multisine']),
    default='sine',
    show_default=True,
    help='sine: 100 daN at 40 Hz, as in the paper.',
)
@click.option(
    '--noise',
    type=NOISE,
    default='none',
    show_default=True,
    help='Factor on the noise that the layout states; the paper used perfect sensors.',
)
@click.option(
    '--estimator',
    type=click.Choice(['pointwise', 'weak']),
    default='pointwise',
    show_default=True,
    help="pointwise: the paper's, for perfect sensors. weak: for sensors with noise.",
)
@reporting
def command(duration: float, excitation: str, noise: float, estimator: str) -> Outcome:
    """
    Run a simulated stand and identify its 16 joint parameters while it vibrates.

    Sensor bridge, transform and identifier are separate processes that talk over DDS on this
    host. At the end, tables 1 and 2 of Berczynski et al. (2010).
    """
    require_ros()
    from identnl_ros.cli.progress import progress
    from identnl_ros.core.mechanics.assembly import assemble
    from identnl_ros.nodes.estimate_conversion import estimate_from_message
    from identnl_ros.nodes.live_run import LiveRun
    from identnl_ros.reports.estimate_document import estimate_document
    from identnl_ros.reports.estimate_tables import show_estimate
    from identnl_ros.storage.machine_file import load_machine
    from identnl_ros.storage.shipped import shipped_config
    from rich.console import Console

    path = shipped_config(MACHINE)
    model = assemble(load_machine(path).machine)
    truth = {model.parameters[i].name: model.parameters[i].value for i in model.estimated}
    source = {
        'source': 'simulated',
        'machine_file': path,
        'excitation': excitation,
        'sample_rate': SAMPLE_RATE,
        'duration': duration,
        'noise': noise,
    }
    say(
        f'{excitation} on {model.machine.name} for {duration:g} s: sensor_bridge -> transform -> '
        'identifier, three processes over DDS'
    )
    samples = round(duration * SAMPLE_RATE)
    with LiveRun(source, estimator) as run, progress('identifying', samples) as advance:
        seen = 0
        for message in run.estimates():
            advance(message.last_sample_index - seen)
            seen = message.last_sample_index
    estimate = estimate_from_message(message)
    document = {'machine': model.machine.name, **estimate_document(estimate, truth)}
    determined = any(parameter.value == parameter.value for parameter in estimate.parameters)
    return Outcome(
        document,
        lambda: show_estimate(estimate, truth, Console()),
        DONE if determined else NEGATIVE,
    )
