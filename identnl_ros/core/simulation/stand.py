# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A simulated test stand: a machine, its exciters and its sensors with their imperfections."""

from dataclasses import dataclass

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.added_reading import front_mass_reading, gravity_reading
from identnl_ros.core.measurement.blocks import ChannelStatus, SampleBlock, stamp_after
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.simulation import Simulation, steps_per_sample
import numpy as np
from numpy.typing import NDArray

# Samples computed at once, and integration steps for which forces are held in memory;
# independent of the blocks, so that these do not change a bit.
LARGEST_CHUNK = 512
LARGEST_STEPS = 2**15
MOTION_KINDS = (SensorKind.DISPLACEMENT, SensorKind.VELOCITY, SensorKind.ACCELERATION)


@dataclass(frozen=True)
class _Delayed:
    """A delay as whole samples back and a fraction of a sample forward."""

    samples: int
    fraction: float


class SimulatedStand:
    """
    Run a machine from rest and read its sensors.

    The signals are the forces on the structure: what accelerates a mass in front of a cell comes
    on top of them in its reading.

    Parameters
    ----------
    model : Model
        All values known.
    layout : Layout
        The sensors as they really are.
    signals : tuple of Signal
        Force of every excitation point of the machine.
    sample_rate : float
        [Hz].
    seed : int
        Of the sensor noise and dropouts; a seed gives the same bits again.
    stream_id : int
        Of the blocks.
    stamp_ns : int
        Time stamp of the first sample [ns].
    declared_layout : Layout or None
        The sensors as their users believe them to be; None: as they are.

    Raises
    ------
    MachineError
        If a value is missing or the machine has no equilibrium.
    LayoutError
        If a sensor does not fit the machine, has a negative delay, or the layouts differ in
        their channels.

    """

    def __init__(
        self,
        model: Model,
        layout: Layout,
        signals: tuple[Signal, ...],
        sample_rate: float,
        seed: int,
        stream_id: int,
        stamp_ns: int = 0,
        declared_layout: Layout | None = None,
    ) -> None:
        self.layout = declared_layout or layout
        channels, declared = (
            [(sensor.name, sensor.kind) for sensor in one.sensors] for one in (layout, self.layout)
        )
        if channels != declared:
            raise LayoutError(
                'simulated stand: the declared layout must have the channels of the actual one, '
                'in the same order'
            )
        self._actual = layout
        self._rate = sample_rate
        self._stream_id = stream_id
        self._stamp_ns = stamp_ns
        rest = static_equilibrium(model)
        interval = 1 / sample_rate
        self._simulation = Simulation(
            model,
            signals,
            interval,
            rest,
            np.zeros_like(rest),
            steps_per_sample(model, rest[np.newaxis], interval),
        )
        self._chunk_size = max(1, min(LARGEST_CHUNK, LARGEST_STEPS // self._simulation.steps))
        self._delays = [_delay(sensor, sample_rate) for sensor in layout.sensors]
        self._rows = {
            kind: sensor_matrix(model, tuple(layout.sensors[i] for i in layout.of_kind(kind)))
            for kind in MOTION_KINDS
        }
        self._gravity = gravity_reading(model, layout.sensors, layout.gravity)
        self._front_mass = front_mass_reading(model, layout.sensors)
        names = [point.name for point in model.machine.excitations]
        for sensor in layout.sensors:
            if sensor.excitation and sensor.excitation not in names:
                raise LayoutError(
                    f'sensor {sensor.name}: the machine has no excitation '
                    f'"{sensor.excitation}", it has {", ".join(names) or "none"}'
                )
        self._excitation_names = names
        self._history = self._at_rest(rest)
        noise_seed, dropout_seed = np.random.SeedSequence(seed).spawn(2)
        self._noise = np.random.default_rng(noise_seed)
        self._dropouts = np.random.default_rng(dropout_seed)
        self._ready = np.empty((0, len(layout.sensors)))
        self._chunk_index = 0
        self._next_index = 0

    def read(self, count: int, last: bool = False) -> SampleBlock:
        """
        Take the next samples.

        Parameters
        ----------
        count : int
            Number of samples.
        last : bool
            Mark the block as the end of the stream.

        Returns
        -------
        SampleBlock

        """
        parts = [self._ready]
        available = len(self._ready)
        while available < count:
            parts.append(self._chunk())
            available += self._chunk_size
        samples = np.concatenate(parts)
        self._ready = samples[count:]
        first_index, self._next_index = self._next_index, self._next_index + count
        missing = np.isnan(samples[:count]).any(axis=0)
        return SampleBlock(
            stream_id=self._stream_id,
            stamp_ns=stamp_after(self._stamp_ns, first_index, self._rate),
            first_index=first_index,
            sample_rate=self._rate,
            samples=samples[:count].copy(),
            channel_status=np.where(
                missing, ChannelStatus.MISSING_SAMPLES, ChannelStatus.OK
            ).astype(np.uint8),
            last=last,
        )

    def _chunk(self) -> NDArray[np.float64]:
        """Take the next samples in SI, as the declared layout understands them."""
        fractions = tuple(sorted({0.0, *(delay.fraction for delay in self._delays)}))
        motions = self._simulation.advance(self._chunk_size, fractions)
        start = self._chunk_index * self._chunk_size / self._rate
        time = start + np.arange(self._chunk_size) / self._rate
        self._chunk_index += 1
        columns = {}
        for kind, motion in zip(MOTION_KINDS, motions, strict=True):
            for row, channel in zip(self._rows[kind], self._actual.of_kind(kind), strict=True):
                columns[channel] = motion[fractions.index(self._delays[channel].fraction)] @ row
        for channel in self._actual.of_kind(SensorKind.FORCE):
            signal = self._simulation.signals[
                self._excitation_names.index(self._actual.sensors[channel].excitation)
            ]
            offset = self._delays[channel].fraction / self._rate
            columns[channel] = signal.on_grid(start + offset, 1 / self._rate, self._chunk_size)
        for added, motion in ((self._gravity, motions[0]), (self._front_mass, motions[2])):
            for channel, constant, row in zip(
                added.channels, added.constant, added.matrix, strict=True
            ):
                moved = motion[fractions.index(self._delays[channel].fraction)]
                columns[channel] = columns[channel] + constant + moved @ row
        readings = np.empty((self._chunk_size, len(self._actual.sensors)))
        for channel, delay in enumerate(self._delays):
            longer = np.concatenate((self._history[channel], columns[channel]))
            readings[:, channel] = longer[: self._chunk_size]
            self._history[channel] = longer[len(longer) - delay.samples :]
        return self._imperfect(readings, time)

    def _imperfect(
        self, readings: NDArray[np.float64], time: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        sensors = self._actual.sensors
        noise = np.nan_to_num(np.array([sensor.noise for sensor in sensors]))
        readings = readings + noise * self._noise.standard_normal(readings.shape)
        lost = self._dropouts.random(readings.shape) < np.array(
            [sensor.dropout_probability for sensor in sensors]
        )
        for channel, (actual, declared) in enumerate(
            zip(sensors, self.layout.sensors, strict=True)
        ):
            if actual.resolution:
                readings[:, channel] = actual.resolution * np.round(
                    readings[:, channel] / actual.resolution
                )
            if declared is not actual:
                recorded = actual.to_recorded(readings[:, channel], time)
                readings[:, channel] = declared.to_si(recorded, time)
        return np.where(lost, np.nan, readings)

    def _at_rest(self, rest: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Give the readings before the start, as many as each sensor is late."""
        before = np.zeros(len(self._delays))
        before[list(self._actual.of_kind(SensorKind.DISPLACEMENT))] = (
            self._rows[SensorKind.DISPLACEMENT] @ rest
        )
        before[self._gravity.channels] = self._gravity.of(rest)
        return [
            np.full(delay.samples, value)
            for delay, value in zip(self._delays, before, strict=True)
        ]


def _delay(sensor: Sensor, sample_rate: float) -> _Delayed:
    if sensor.delay < 0:
        raise LayoutError(
            f'sensor {sensor.name}: a simulated sensor cannot be early, '
            f'found a delay of {sensor.delay} s'
        )
    delay = sensor.delay * sample_rate
    # A delay within rounding of a whole number of samples is that number.
    whole = round(delay)
    if abs(delay - whole) < 1e-9:
        return _Delayed(whole, 0.0)
    samples = int(np.ceil(delay))
    return _Delayed(samples, samples - delay)
