# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl simulate`: a bag recorded on the simulated stand."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from identnl_ros.cli.output import command as reporting, Outcome, say
from identnl_ros.cli.progress import progress
from identnl_ros.cli.quantity_types import FORCE, FREQUENCY, NOISE, TIME
from identnl_ros.core.errors import DataError
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from identnl_ros.core.discrepancy.description import Description
    from identnl_ros.core.measurement.layout import Layout
    from identnl_ros.core.mechanics.machine import Machine
    from identnl_ros.core.simulation.excitation import Signal
    from identnl_ros.sources.simulated import TestRun


@click.command('simulate')
@click.option('--machine', required=True, type=click.Path(path_type=Path), help='Machine file.')
@click.option(
    '--layout',
    type=click.Path(path_type=Path),
    help='Layout file; without it, MACHINE_layout.yaml beside the machine file.',
)
@click.option(
    '--excitation',
    type=click.Choice(['sine', 'multisine', 'sweep', 'impulse', 'recorded']),
    default='multisine',
    show_default=True,
)
@click.option(
    '--duration',
    type=TIME,
    default=4.0,
    show_default=True,
    help='[s]',
)
@click.option(
    '--rate',
    type=FREQUENCY,
    help='Sample rate [Hz]; without it, that of the layout file or 10 kHz.',
)
@click.option(
    '--noise',
    type=NOISE,
    default='nominal',
    show_default=True,
    help='Factor on the noise that the layout states.',
)
@click.option(
    '--seed',
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help='A seed gives the same bytes again.',
)
@click.option(
    '--amplitude',
    type=FORCE,
    help='Of every exciter [N]; without it, that of the machine file.',
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
@click.option(
    '--period',
    type=TIME,
    default=1.0,
    show_default=True,
    help='Of a multisine [s].',
)
@click.option(
    '--force',
    'force_file',
    type=click.Path(path_type=Path),
    help='Recorded excitation: text file, one force [N] a line, at the sample rate.',
)
@click.option(
    '--hide',
    'hidden',
    multiple=True,
    metavar='EFFECT[:PLACE][:SIZE]',
    help='Give the stand an effect that machine and layout in the bag do not tell of, e.g. '
    '"added_mass:knee:5 kg"; sizes also in percent of the exciters\' strength.',
)
@click.option(
    '--truth',
    type=click.Path(path_type=Path, dir_okay=False),
    help='With --hide: file that tells what was hidden; without it, OUT.truth.json.',
)
@click.option(
    '--out',
    required=True,
    type=click.Path(path_type=Path),
    help='Bag to write: a file if it ends in .mcap, else a folder.',
)
@reporting
def command(
    machine: Path,
    layout: Path | None,
    excitation: str,
    duration: float,
    rate: float | None,
    noise: float,
    seed: int,
    amplitude: float | None,
    frequency: float | None,
    band: tuple[float, float] | None,
    period: float,
    force_file: Path | None,
    hidden: tuple[str, ...],
    truth: Path | None,
    out: Path,
) -> Outcome:
    """Run the simulated stand and record its sensors in a bag, with the true parameters."""
    from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
    from identnl_ros.sources.stand_layout import stand_layout
    from identnl_ros.storage.bag_writer import BagWriter
    from identnl_ros.storage.machine_file import load_machine

    machine_file = load_machine(machine)
    sensors = stand_layout(machine_file, layout)
    if sensors.remark:
        say(sensors.remark)
    run = TestRun(
        Excitation(excitation),
        duration,
        sensors.sample_rate(rate),
        noise,
        seed,
        amplitude,
        frequency,
        band,
        period,
        _recorded_force(force_file, excitation),
    )
    actual, signals, told = _with_hidden(machine_file.machine, sensors.layout, run, hidden)
    with BagWriter(out) as bag:
        source = SimulatedSource(
            machine_file.machine, sensors.layout, run, machine_file.text, sensors.text,
            actual=actual, hidden_signals=signals,
        )  # fmt: skip
        bag.write_description(source.description)
        with progress('simulating', run.samples) as advance:
            for block in source.blocks():
                bag.write_block(block)
                advance(block.samples.shape[0])
        bag.write_metadata('identnl.truth', {'parameters': json.dumps(source.truth)})
    document = {
        'bag': str(out),
        'machine': machine_file.machine.name,
        'excitation': excitation,
        'duration': run.samples / run.sample_rate,
        'sample_rate': run.sample_rate,
        'samples': run.samples,
        'channels': [sensor.name for sensor in sensors.layout.sensors],
        'noise': noise,
        'seed': seed,
        'true_parameters': source.truth,
    }
    if hidden:
        from identnl_ros.storage.replaced_file import write_text

        path = truth or out.with_name(f'{out.name}.truth.json')
        write_text(path, [json.dumps({'hidden': told}, indent=2), '\n'])
        document['truth'] = str(path)
    return Outcome(
        document,
        lambda: click.echo(
            f'{out}: {run.samples} samples of {len(sensors.layout.sensors)} channels at '
            f'{run.sample_rate:g} Hz'
        ),
    )


def _with_hidden(
    machine: 'Machine', layout: 'Layout', run: 'TestRun', texts: tuple[str, ...]
) -> tuple['Description | None', tuple['Signal', ...], list[dict[str, object]]]:
    """Describe the stand with everything that is to be hidden, and tell what that is."""
    if not texts:
        return None, (), []
    from identnl_ros.core.discrepancy.description import Description
    from identnl_ros.sources.hidden_force import HiddenForce
    from identnl_ros.sources.hiding import hidden
    from identnl_ros.sources.simulated import excitation_signals

    description = Description(machine, layout)
    generator = np.random.default_rng(np.random.SeedSequence(run.seed, spawn_key=(1,)))
    told: list[dict[str, object]] = []
    signals = excitation_signals(machine.excitations, run)
    unmeasured: list[Signal] = []
    for text in texts:
        one = hidden(text, description, (*signals, *unmeasured), run.sample_rate, generator)
        description = one.truth(description)
        if isinstance(one, HiddenForce):
            unmeasured.append(one.signal)
            told.append({'effect': one.name, 'location': one.label, 'in_library': False})
            continue
        hypothesis = one.hypothesis
        told.append(
            {
                'effect': hypothesis.effect.name,
                'location': hypothesis.place.label,
                'size': one.size,
                'unit': hypothesis.effect.unit(hypothesis.place),
                'inner': dict(hypothesis.inner),
                'in_library': True,
            }
        )
    return description, tuple(unmeasured), told


def _recorded_force(path: Path | None, excitation: str) -> NDArray[np.float64] | None:
    if (path is None) == (excitation == 'recorded'):
        raise DataError('--force FILE and --excitation recorded go together')
    if path is None:
        return None
    try:
        return np.loadtxt(path, dtype=np.float64, ndmin=1).reshape(-1)
    except ValueError as error:
        raise DataError(f'{path}: expected one force in N a line; {error}') from None
