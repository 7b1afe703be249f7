# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Records of shipped machines in which something is hidden, drawn at random."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Effect, Hypothesis, SensorFault
from identnl_ros.core.discrepancy.hidden_effect import choose_place, HiddenEffect, relative_size
from identnl_ros.core.discrepancy.library import EFFECTS
from identnl_ros.core.errors import IdentnlError
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.machine import ExcitationPoint
from identnl_ros.core.simulation.excitation import Impulses, multisine, Signal, sine, Sweep
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
from identnl_ros.storage.shipped import shipped_config
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Key = tuple[str, str]

RATE = 10e3  # [Hz]
SETTLING, DIAGNOSED, HELD_OUT = 2000, 4096, 1536  # samples
MACHINES = ('knee_column', 'three_body')
# Sizes of effects of the machine: shares of the exciters' strength.
SIZES = (0.02, 0.1)
STRONG = 0.2
# Mass of a flexible mode over that of its body.
HEAVIEST = 0.3
WHOLE = ('coupled_contact', 'contact_opening')
# Of faults of sensors: smallest and largest.
FAULTS = {
    'sensor_gain': (0.02, 0.1),
    'sensor_delay': (20e-6, 200e-6),
    'delay_of_kind': (20e-6, 200e-6),
    'wrong_direction': (0.05, 0.3),
}
# Values of the unknowns in the machine file, over the true ones.
MISJUDGED = (0.7, 1.3)
OFFSET = (0.05, 0.5)  # of what the sensor reads (root mean square)


@dataclass(frozen=True)
class Case:
    """
    A record with something hidden.

    Parameters
    ----------
    description : Description
        As believed.
    record, held_out : MeasuredRecord
    hidden : tuple of (str, str)
        Effects and places.
    what : str
        In words.

    """

    description: Description
    record: MeasuredRecord
    held_out: MeasuredRecord
    hidden: tuple[Key, ...]
    what: str


@cache
def shipped(name: str) -> Description:
    """
    Load a shipped machine with displacement sensors and accelerometers.

    Parameters
    ----------
    name : str

    Returns
    -------
    Description

    """
    machine = load_machine(shipped_config(f'{name}.yaml')).machine
    layout = load_layout(shipped_config(f'{name}_layout.yaml')).layout
    sensors = tuple(one for one in layout.sensors if one.kind is not SensorKind.VELOCITY)
    return Description(machine, replace(layout, sensors=sensors))


def believed(description: Description, generator: np.random.Generator) -> Description:
    """
    Get the values of the unknowns wrong.

    Parameters
    ----------
    description : Description
    generator : numpy.random.Generator

    Returns
    -------
    Description

    """
    machine = description.machine
    parts: dict[str, Any] = {
        kind: tuple(_misjudged(one, generator) for one in getattr(machine, kind))
        for kind in ('bodies', 'joints', 'forces')
    }
    return replace(description, machine=replace(machine, **parts))


def _misjudged(part: Any, generator: np.random.Generator) -> Any:
    def wrong(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(wrong(one) for one in value)
        if isinstance(value, Coefficient) and value.estimated:
            return replace(value, value=value.value * generator.uniform(*MISJUDGED))
        return value

    changed = {one.name: wrong(getattr(part, one.name)) for one in fields(part)}
    return replace(part, **changed)


def signals_of(
    description: Description, excitation: str, generator: np.random.Generator
) -> tuple[Signal, ...]:
    """
    Make the forces of the exciters.

    Parameters
    ----------
    description : Description
    excitation : str
        ``multisine`` or ``sine``.
    generator : numpy.random.Generator
        Of the phases.

    Returns
    -------
    tuple of Signal

    """
    return tuple(
        multisine(point.amplitude, point.band, 1.0, generator)
        if excitation == 'multisine'
        else sine(point.amplitude, point.frequency)
        for point in description.machine.excitations
    )


def measured(
    description: Description,
    truth: Description,
    signals: tuple[Signal, ...],
    seed: int,
    change: Callable[[Reals], Reals] = lambda samples: samples,
) -> tuple[MeasuredRecord, MeasuredRecord]:
    """
    Run a stand as it is and read it as it is described.

    Parameters
    ----------
    description, truth : Description
    signals : tuple of Signal
    seed : int
        Of the sensors' noise.
    change : callable
        What else happens to the samples.

    Returns
    -------
    record, held_out : MeasuredRecord

    """
    stand = SimulatedStand(
        assemble(truth.machine), truth.layout, signals, RATE, seed, 1,
        declared_layout=description.layout,
    )  # fmt: skip
    samples = change(stand.read(SETTLING + DIAGNOSED + HELD_OUT).samples[SETTLING:])
    whole = MeasuredRecord(description.layout, RATE, samples, first_index=SETTLING)
    return whole.part(0, DIAGNOSED), whole.part(DIAGNOSED, DIAGNOSED + HELD_OUT)


def hidden_case(
    name: str, excitation: str, number: int, strength: tuple[float, float], seed: int
) -> Case:
    """
    Hide effects of the library, drawn at random.

    Parameters
    ----------
    name : str
        Of the machine.
    excitation : str
    number : int
        Of effects; 0: nothing is hidden.
    strength : (float, float)
        Smallest and largest share of the exciters' strength.
    seed : int

    Returns
    -------
    Case

    """
    generator = np.random.default_rng(seed)
    description = shipped(name)
    signals = signals_of(description, excitation, generator)
    while True:
        truth = description
        hidden: list[HiddenEffect] = []
        try:
            while len(hidden) < number:
                one = _drawn(description, signals, strength, generator)
                if all(one.hypothesis.key[1] != other.hypothesis.key[1] for other in hidden):
                    hidden.append(one)
                    truth = one.truth(truth)
            records = measured(description, truth, signals, seed)
        except IdentnlError:
            continue  # what cannot be simulated or does nothing is drawn anew
        break
    keys = tuple(one.hypothesis.key for one in hidden)
    words = ', '.join(
        f'{one.hypothesis.effect.name} {one.hypothesis.place.label} {one.size:.4g} '
        f'{dict(one.hypothesis.inner)}'
        for one in hidden
    )
    return Case(believed(description, generator), *records, keys, words)


def _drawn(
    description: Description,
    signals: tuple[Signal, ...],
    strength: tuple[float, float],
    generator: np.random.Generator,
) -> HiddenEffect:
    effect: Effect = EFFECTS[generator.integers(len(EFFECTS))]
    places = [
        one
        for one in choose_place(effect, description, '')
        if not effect.hidden_in(description, one.place)
    ]
    if not places:
        return _drawn(description, signals, strength, generator)
    hypothesis: Hypothesis = places[generator.integers(len(places))]
    if isinstance(effect, SensorFault):
        if effect.name in ('sensor_offset', 'sensor_drift'):
            low, high = OFFSET
            sensor = description.sensor(hypothesis.place.part)
            scale = {SensorKind.DISPLACEMENT: 1e-6, SensorKind.ACCELERATION: 1.0}[sensor.kind]
            return HiddenEffect(hypothesis, scale * _between(low, high, generator))
        low, high = FAULTS.get(effect.name, (1.0, 1.0))
        return HiddenEffect(hypothesis, _between(low, high, generator))
    hypothesis, whole = relative_size(description, hypothesis, signals, RATE, generator)
    if effect.name in WHOLE:
        # There or not: what is far stronger than the others is drawn anew.
        if whole < 1 / STRONG:
            return _drawn(description, signals, strength, generator)
        return HiddenEffect(hypothesis, 1.0)
    sign = 1 if effect.sign else generator.choice((-1, 1))
    size = sign * whole * _between(*strength, generator)
    if effect.name == 'hidden_oscillator':
        host = description.body(hypothesis.place.part)
        if size > HEAVIEST * host.mass.value:
            return _drawn(description, signals, strength, generator)
    return HiddenEffect(hypothesis, size)


def _between(low: float, high: float, generator: np.random.Generator) -> float:
    return float(low * (high / low) ** generator.random())


def outside_case(name: str, excitation: str, seed: int) -> Case:
    """
    Hide something that no effect of the library is.

    Parameters
    ----------
    name : str
        Of the machine.
    excitation : str
    seed : int

    Returns
    -------
    Case

    """
    generator = np.random.default_rng(seed)
    description = shipped(name)
    signals = signals_of(description, excitation, generator)
    kind = OUTSIDE[generator.integers(len(OUTSIDE))]
    return kind(description, signals, seed, generator)


def _unmeasured(
    description: Description,
    signals: tuple[Signal, ...],
    force: Signal,
    what: str,
    seed: int,
    generator: np.random.Generator,
) -> Case:
    """Let a force that nobody measures act on a body."""
    machine = description.machine
    body = machine.bodies[generator.integers(len(machine.bodies))]
    direction = generator.standard_normal(3)
    ghost = ExcitationPoint(
        'ghost', body.name, body.centre_of_mass, direction / np.linalg.norm(direction)
    )
    truth = replace(
        description, machine=replace(machine, excitations=(*machine.excitations, ghost))
    )
    records = measured(description, truth, (*signals, force), seed)
    return Case(believed(description, generator), *records, (), f'{what} on {body.name}')


def _amplitude(description: Description, generator: np.random.Generator) -> float:
    return description.machine.excitations[0].amplitude * _between(0.02, 0.2, generator)


def _random_force(
    description: Description,
    signals: tuple[Signal, ...],
    seed: int,
    generator: np.random.Generator,
) -> Case:
    force = multisine(_amplitude(description, generator), (20.0, 250.0), 3.7, generator)
    return _unmeasured(description, signals, force, 'a random force', seed, generator)


def _impacts(
    description: Description,
    signals: tuple[Signal, ...],
    seed: int,
    generator: np.random.Generator,
) -> Case:
    interval = generator.uniform(0.05, 0.25)
    force = Impulses(10 * _amplitude(description, generator), 2e-3, interval)
    return _unmeasured(description, signals, force, 'impacts', seed, generator)


def _chirp(
    description: Description,
    signals: tuple[Signal, ...],
    seed: int,
    generator: np.random.Generator,
) -> Case:
    force = Sweep(_amplitude(description, generator), (20.0, 200.0), 0.9)
    return _unmeasured(description, signals, force, 'a force of rising frequency', seed, generator)


def _of_channel(
    description: Description,
    signals: tuple[Signal, ...],
    seed: int,
    generator: np.random.Generator,
    what: str,
    change: Callable[[Reals, Reals], Reals],
) -> Case:
    """Let something happen to one channel, by its samples and their typical size."""
    channels = [
        i for i, one in enumerate(description.layout.sensors) if one.kind is not SensorKind.FORCE
    ]
    channel = channels[generator.integers(len(channels))]

    def changed(samples: Reals) -> Reals:
        samples = samples.copy()
        samples[:, channel] = change(samples[:, channel], samples[:, channel].std())
        return samples

    records = measured(description, description, signals, seed, changed)
    where = description.layout.sensors[channel].name
    return Case(believed(description, generator), *records, (), f'{what} of {where}')


def _saturation(
    description: Description,
    signals: tuple[Signal, ...],
    seed: int,
    generator: np.random.Generator,
) -> Case:
    limit = generator.uniform(0.8, 1.8)
    return _of_channel(
        description, signals, seed, generator, 'saturation',
        lambda series, size: np.clip(series, -limit * size, limit * size),
    )  # fmt: skip


def _curved_sensor(
    description: Description,
    signals: tuple[Signal, ...],
    seed: int,
    generator: np.random.Generator,
) -> Case:
    bend = _between(0.02, 0.2, generator)
    return _of_channel(
        description, signals, seed, generator, 'a curved characteristic',
        lambda series, size: series + bend * series * np.abs(series) / size,
    )  # fmt: skip


def _hum(
    description: Description,
    signals: tuple[Signal, ...],
    seed: int,
    generator: np.random.Generator,
) -> Case:
    share, phase = _between(0.02, 0.2, generator), generator.uniform(0, 2 * np.pi)

    def change(series: Reals, size: Reals) -> Reals:
        time = np.arange(len(series)) / RATE
        return series + share * size * np.sin(2 * np.pi * 50 * time + phase)

    return _of_channel(description, signals, seed, generator, 'mains hum', change)


def _wander(
    description: Description,
    signals: tuple[Signal, ...],
    seed: int,
    generator: np.random.Generator,
) -> Case:
    share = _between(0.02, 0.2, generator)

    def change(series: Reals, size: Reals) -> Reals:
        walk = np.cumsum(generator.standard_normal(len(series)))
        return series + share * size * walk / walk.std()

    return _of_channel(description, signals, seed, generator, 'a wandering zero', change)


OUTSIDE = (_random_force, _impacts, _chirp, _saturation, _curved_sensor, _hum, _wander)
