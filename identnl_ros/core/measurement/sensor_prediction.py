# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the sensors of a layout show of a simulated motion, and its dependence on the unknowns."""

from collections.abc import Iterator
from dataclasses import dataclass

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.added_reading import gravity_reading
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.measurement.sensor_unknown import SensorQuantity, SensorUnknown
from identnl_ros.core.measurement.stencils import stencil
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.sensitivity import (
    CHUNK,
    MotionVariation,
    VariedSimulation,
)
import numpy as np
from numpy.typing import NDArray

MOTION_KINDS = (SensorKind.DISPLACEMENT, SensorKind.VELOCITY, SensorKind.ACCELERATION)
# Samples on either side of an instant between two samples that interpolate there.
HALF_WIDTH = 8


@dataclass(frozen=True)
class Prediction:
    """
    Predicted readings at consecutive samples.

    Parameters
    ----------
    first : int
        The first sample, counted from the beginning of the simulation.
    readings : ndarray, shape (n_samples, n_motion_channels)
        SI.
    derivatives : ndarray, shape (n_samples, n_motion_channels, n_columns)
        By the initial displacement, the initial velocity, the model's unknowns and the sensors'
        unknowns, in this order; without columns if the simulation is not sensitive.

    """

    first: int
    readings: NDArray[np.float64]
    derivatives: NDArray[np.float64]


class SensorPrediction:
    """
    Predict the readings of all sensors of motion of a layout.

    Parameters
    ----------
    model : Model
    layout : Layout
    sample_rate : float
        [Hz].
    unknowns : tuple of SensorUnknown
        Sensors that the layout does not have are passed over.

    Raises
    ------
    LayoutError
        If a sensor does not fit the machine, or an unknown is one of a force sensor.

    """

    def __init__(
        self,
        model: Model,
        layout: Layout,
        sample_rate: float,
        unknowns: tuple[SensorUnknown, ...] = (),
    ) -> None:
        self._rate = sample_rate
        self._size = len(model.coordinates)
        self._unknowns = unknowns
        sensors = layout.sensors
        self.channels = tuple(i for i, one in enumerate(sensors) if one.kind in MOTION_KINDS)
        """Channels of the layout that are predicted, in order."""
        places = {sensors[channel].name: i for i, channel in enumerate(self.channels)}
        self._kinds = []
        for order, kind in enumerate(MOTION_KINDS):
            own = layout.of_kind(kind)
            rows = sensor_matrix(model, tuple(sensors[channel] for channel in own))
            if own:
                self._kinds.append((order, [self.channels.index(i) for i in own], rows))
        self.gravity = gravity_reading(
            model, tuple(sensors[channel] for channel in self.channels), layout.gravity
        )
        """What accelerometers read of gravity; channels count those that are predicted."""
        for unknown in unknowns:
            for sensor in sensors:
                if sensor.name in unknown.sensors and sensor.kind is SensorKind.FORCE:
                    raise LayoutError(
                        f'sensor {sensor.name}: the {unknown.quantity.value} of a force sensor '
                        'cannot be an unknown; the force is taken as exact'
                    )
        self._members = [
            np.array([places[name] for name in unknown.sensors if name in places], dtype=np.int64)
            for unknown in unknowns
        ]
        self._stated_delays = np.array([sensors[i].delay for i in self.channels])

    @property
    def moved(self) -> NDArray[np.bool_]:
        """Channels whose readings are interpolated, shape (n_motion_channels,)."""
        moved = np.asarray(self._stated_delays != 0)
        for unknown, members in zip(self._unknowns, self._members, strict=True):
            if unknown.quantity is SensorQuantity.DELAY:
                moved[members] = True
        return moved

    @property
    def stated_delays(self) -> NDArray[np.float64]:
        """Known delays in samples, shape (n_motion_channels,)."""
        return self._stated_delays * self._rate

    def largest_delay(self, numbers: NDArray[np.float64]) -> float:
        """
        Find the largest unknown delay, either way.

        Parameters
        ----------
        numbers : ndarray, shape (n_sensor_unknowns,)
            Values of the sensors' unknowns.

        Returns
        -------
        float
            In samples, beyond the stated delay.

        """
        zero = np.zeros(len(self.channels))
        unknown = self._with_unknown(SensorQuantity.DELAY, zero, numbers)
        return float(np.abs(unknown).max(initial=0.0) * self._rate)

    def run(
        self, simulation: VariedSimulation, count: int, numbers: NDArray[np.float64]
    ) -> Iterator[Prediction]:
        """
        Simulate and yield the predicted readings, chunk by chunk.

        Where a late or early sensor would show motion before or after the simulation, its
        reading is meaningless (see `moved`).

        Parameters
        ----------
        simulation : VariedSimulation
            At its beginning; its interval is that of the samples.
        count : int
            Number of samples.
        numbers : ndarray, shape (n_sensor_unknowns,)
            Values of the sensors' unknowns.

        Yields
        ------
        Prediction

        Raises
        ------
        MachineError
            If the motion grows beyond all bounds.

        """
        delays = self._with_unknown(SensorQuantity.DELAY, self._stated_delays, numbers)
        moved = self.moved
        places = [
            (np.flatnonzero(moved & (delays == delay)), delay * self._rate)
            for delay in np.unique(delays[moved])
        ]
        shifts = [round(place) for _, place in places]
        before = HALF_WIDTH + max(shifts, default=0) if places else 0
        after = HALF_WIDTH - min(shifts, default=0) if places else 0
        before, after = max(before, 0), max(after, 0)
        buffer: NDArray[np.float64] | None = None
        done = 0
        for start in range(0, count, CHUNK):
            series = self._series(simulation.advance(min(CHUNK, count - start)))
            if buffer is None:
                buffer = np.zeros((before, *series.shape[1:]))
            buffer = np.concatenate((buffer, series)) if before + after else series
            if start + CHUNK >= count:
                buffer = np.concatenate((buffer, np.zeros((after, *series.shape[1:]))))
            ready = len(buffer) - before - after
            if ready > 0:
                yield self._prediction(buffer, done, before, ready, places, numbers)
                done += ready
                buffer = buffer[ready:]

    def _series(self, variation: MotionVariation) -> NDArray[np.float64]:
        """Stack the undelayed readings with their derivatives, (n_samples, n_channels, 1 + n)."""
        motion, derivatives = variation.motion, variation.derivatives
        columns = derivatives.shape[3]
        unknowns = columns - 2 * self._size
        series = np.empty((len(motion), len(self.channels), 1 + columns))
        for order, places, rows in self._kinds:
            series[:, places, 0] = motion[:, order] @ rows.T
            if columns:
                varied = rows @ derivatives[:, order]
                series[:, places, 1 : 1 + 2 * self._size] = varied[..., unknowns:]
                series[:, places, 1 + 2 * self._size :] = varied[..., :unknowns]
        gravity = self.gravity
        if len(gravity.channels):
            series[:, gravity.channels, 0] += gravity.of(motion[:, 0])
            if columns:
                tilted = gravity.matrix @ derivatives[:, 0]
                series[:, gravity.channels, 1 : 1 + 2 * self._size] += tilted[..., unknowns:]
                series[:, gravity.channels, 1 + 2 * self._size :] += tilted[..., :unknowns]
        return series

    def _prediction(
        self,
        buffer: NDArray[np.float64],
        first: int,
        before: int,
        count: int,
        places: list[tuple[NDArray[np.intp], float]],
        numbers: NDArray[np.float64],
    ) -> Prediction:
        series = buffer[before : before + count]
        sensitive = series.shape[2] > 1
        rates = np.zeros(series.shape[:2])
        if places:
            series = series.copy()
        for channels, place in places:
            shift = round(place)
            begin = before - shift - HALF_WIDTH
            window = buffer[begin : begin + count + 2 * HALF_WIDTH, channels]
            series[:, channels] = _filtered(window, stencil(0, shift - place, HALF_WIDTH))
            if sensitive:
                weights = stencil(1, shift - place, HALF_WIDTH) * self._rate
                rates[:, channels] = _filtered(window[..., 0], weights)
        gains = self._with_unknown(SensorQuantity.GAIN, np.ones(len(self.channels)), numbers)
        offsets = self._with_unknown(SensorQuantity.OFFSET, np.zeros(len(self.channels)), numbers)
        readings = gains * series[..., 0] + offsets
        if not sensitive:
            return Prediction(first, readings, np.empty((*readings.shape, 0)))
        size = series.shape[2] - 1
        derivatives = np.zeros((*readings.shape, size + len(self._unknowns)))
        np.multiply(series[..., 1:], gains[:, np.newaxis], out=derivatives[..., :size])
        for i, (unknown, members) in enumerate(zip(self._unknowns, self._members, strict=True)):
            match unknown.quantity:
                case SensorQuantity.OFFSET:
                    derivatives[:, members, size + i] = 1.0
                case SensorQuantity.GAIN:
                    derivatives[:, members, size + i] = series[:, members, 0]
                case SensorQuantity.DELAY:
                    derivatives[:, members, size + i] = -(gains * rates)[:, members]
        return Prediction(first, readings, derivatives)

    def _with_unknown(
        self,
        quantity: SensorQuantity,
        stated: NDArray[np.float64],
        numbers: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        result = stated.copy()
        for unknown, members, number in zip(self._unknowns, self._members, numbers, strict=True):
            if unknown.quantity is quantity:
                result[members] += number
        return result


def _filtered(window: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weigh neighbouring samples along the first axis, which becomes that much shorter."""
    count = len(window) - len(weights) + 1
    result: NDArray[np.float64] = weights[0] * window[:count]
    for i, weight in enumerate(weights[1:], 1):
        result += weight * window[i : i + count]
    return result
