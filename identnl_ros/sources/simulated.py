# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated stand as a source of samples."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import Enum
import hashlib

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import SampleBlock, samples_per_block
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.machine import ExcitationPoint, Machine
from identnl_ros.core.simulation.excitation import (
    Impulses,
    multisine,
    RecordedForce,
    Signal,
    sine,
    Sweep,
)
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.sources.source import Timing
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

IMPULSE_INTERVAL = 1.0
SWEEP_DURATION = 2.0


class Excitation(Enum):
    """Form of the force of all exciters."""

    SINE = 'sine'
    MULTISINE = 'multisine'
    SWEEP = 'sweep'
    IMPULSE = 'impulse'
    RECORDED = 'recorded'


@dataclass(frozen=True)
class TestRun:
    """
    What the exciters do, for how long, and how the sensors are read.

    Parameters
    ----------
    excitation : Excitation
    duration : float
        [s].
    sample_rate : float
        [Hz].
    noise : float
        Factor on the noise that the layout states; 0: perfect sensors.
    seed : int
        Of everything random: phases, noise, dropouts; a seed gives the same bytes again.
    amplitude, frequency : float or None
        Of every exciter [N], [Hz]; None: as in the machine file.
    band : tuple of float or None
        Of a multisine or sweep [Hz]; None: as in the machine file.
    period : float
        Of a multisine [s].
    recorded_force : ndarray or None
        For a recorded excitation, sampled at `sample_rate` [N].

    Raises
    ------
    DataError
        If a number is out of range.

    """

    __test__ = False

    excitation: Excitation
    duration: float
    sample_rate: float
    noise: float = 1.0
    seed: int = 0
    amplitude: float | None = None
    frequency: float | None = None
    band: tuple[float, float] | None = None
    period: float = 1.0
    recorded_force: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in ('duration', 'sample_rate', 'amplitude', 'frequency', 'period'):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise DataError(f'simulation: {name} is {value}, expected a positive number')
        if not (np.isfinite(self.noise) and self.noise >= 0):
            raise DataError(f'simulation: noise is {self.noise}, expected 0 or a positive factor')
        if self.seed < 0:
            raise DataError(f'simulation: seed is {self.seed}, expected 0 or a positive number')
        if self.band is not None and not 0 < self.band[0] <= self.band[1]:
            raise DataError(
                f'simulation: band is {self.band[0]} to {self.band[1]} Hz, '
                'expected two positive numbers, the lower one first'
            )
        if (self.excitation is Excitation.RECORDED) == (self.recorded_force is None):
            raise DataError('simulation: a recorded excitation and a recorded force go together')
        if self.samples < 1:
            raise DataError(
                f'simulation: {self.duration} s at {self.sample_rate} Hz is less than a sample'
            )

    @property
    def samples(self) -> int:
        """Number of samples of the run."""
        return round(self.duration * self.sample_rate)


class SimulatedSource:
    """
    A machine run by its exciters, read by its sensors.

    Parameters
    ----------
    machine : Machine
    layout : Layout
        Its sensors with their nominal noise.
    run : TestRun
    machine_text, layout_text : str
        Files that machine and layout come from, for the stream's description.
    stream_id : int or None
        None: derived from machine, layout and run: the same for the same samples only.
    stamp_ns : int
        Time stamp of the first sample [ns].
    actual : Description or None
        The stand as it is, where machine and layout do not tell all; None: they do.
    hidden_signals : tuple of Signal
        For excitations that it has beyond those of the machine.

    Raises
    ------
    IdentnlError
        If the machine cannot be simulated or the layout does not fit it.

    """

    timing = Timing.SIMULATED

    def __init__(
        self,
        machine: Machine,
        layout: Layout,
        run: TestRun,
        machine_text: str = '',
        layout_text: str = '',
        stream_id: int | None = None,
        stamp_ns: int = 0,
        actual: Description | None = None,
        hidden_signals: tuple[Signal, ...] = (),
    ) -> None:
        _, _, stand_seed = np.random.SeedSequence(run.seed).spawn(3)
        if stream_id is None:
            stream_id = _stream_id(machine, run, machine_text, layout_text)
        self._run = run
        self._model = assemble(machine)
        stated, layout = layout, layout.with_noise_times(run.noise)
        actual = actual or Description(machine, stated)
        self._stand = SimulatedStand(
            assemble(actual.machine),
            actual.layout.with_noise_times(run.noise),
            (*excitation_signals(machine.excitations, run), *hidden_signals),
            run.sample_rate,
            int(stand_seed.generate_state(1, np.uint64)[0]),
            stream_id,
            stamp_ns,
            layout,
        )
        self._description = StandDescription(
            stand=layout.stand,
            stream_id=stream_id,
            sample_rate=run.sample_rate,
            layout=layout,
            machine_text=machine_text,
            layout_text=layout_text,
            stamp_ns=stamp_ns,
        )

    @property
    def description(self) -> StandDescription:
        """What the channels of the blocks are."""
        return self._description

    @property
    def truth(self) -> dict[str, float]:
        """True values of the parameters that are to be estimated, SI."""
        return {
            self._model.parameters[i].name: self._model.parameters[i].value
            for i in self._model.estimated
        }

    def blocks(self) -> Iterator[SampleBlock]:
        """Yield the blocks of the run in order."""
        size = samples_per_block(self._run.sample_rate)
        for first in range(0, self._run.samples, size):
            count = min(size, self._run.samples - first)
            yield self._stand.read(count, last=first + count == self._run.samples)


def _stream_id(machine: Machine, run: TestRun, machine_text: str, layout_text: str) -> int:
    """Derive a number from everything that the samples depend on."""
    digest = hashlib.sha256()
    parts = [machine.name, machine_text, layout_text]
    for one in fields(run):
        value = getattr(run, one.name)
        parts.append(f'{one.name}={"" if isinstance(value, np.ndarray) else value}')
    if run.recorded_force is not None:
        parts.append(run.recorded_force.tobytes().hex())
    for part in parts:
        encoded = part.encode()
        digest.update(len(encoded).to_bytes(8, 'little') + encoded)
    return int.from_bytes(digest.digest()[:8], 'little')


def _check_below_half(frequency: float, run: TestRun, what: str) -> None:
    if frequency >= run.sample_rate / 2:
        raise DataError(
            f'simulation: {what} reaches {frequency:g} Hz, expected less than half the sample '
            f'rate, {run.sample_rate / 2:g} Hz; lower it or sample faster'
        )


def excitation_signals(points: tuple[ExcitationPoint, ...], run: TestRun) -> tuple[Signal, ...]:
    """
    Give the force of every exciter.

    Parameters
    ----------
    points : tuple of ExcitationPoint
    run : TestRun

    Returns
    -------
    tuple of Signal
        The random phases of several multisines are independent.

    Raises
    ------
    DataError
        If a frequency is too high for the sample rate, or a band has no line.

    """
    generator = np.random.default_rng(np.random.SeedSequence(run.seed).spawn(1)[0])
    signals: list[Signal] = []
    for point in points:
        amplitude = point.amplitude if run.amplitude is None else run.amplitude
        frequency = point.frequency if run.frequency is None else run.frequency
        band = point.band if run.band is None else run.band
        if run.recorded_force is not None:
            signals.append(RecordedForce(run.recorded_force, run.sample_rate))
            continue
        match run.excitation:
            case Excitation.SINE:
                _check_below_half(frequency, run, 'frequency')
                signals.append(sine(amplitude, frequency))
            case Excitation.MULTISINE:
                _check_below_half(band[1], run, 'band')
                signals.append(multisine(amplitude, band, run.period, generator))
            case Excitation.SWEEP:
                _check_below_half(band[1], run, 'band')
                signals.append(Sweep(amplitude, band, SWEEP_DURATION))
            case Excitation.IMPULSE:
                # Half a period of the highest frequency asked for.
                signals.append(Impulses(amplitude, 0.5 / band[1], IMPULSE_INTERVAL))
    return tuple(signals)
