# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A run that has not been made: what its sensors will show, by every unknown, and how clearly."""

from collections.abc import Iterator

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.sensor_prediction import HALF_WIDTH, SensorPrediction
from identnl_ros.core.measurement.sensor_unknown import SensorUnknown
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.laws import LawKind
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.sensitivity import (
    CHUNK,
    MotionVariation,
    STEP_LIMIT,
    VariedSimulation,
)
import numpy as np
from numpy.typing import NDArray

PRELOADED = (LawKind.SIGNED_POWER, LawKind.CONTACT)


class PlannedRun:
    """
    A machine, its exciters and its sensors, run from rest.

    The nonlinear model is simulated as it is, however far the motion goes; the force is exact.

    Parameters
    ----------
    model : Model
        The values expected.
    layout : Layout
        With the noise of every sensor of motion.
    signals : tuple of Signal
        Force of every excitation point.
    sample_rate : float
        [Hz].
    duration : float
        Of the samples used [s].
    settling : float
        From rest to the first sample used [s].
    sensor_unknowns : tuple of SensorUnknown
        To be estimated as well.
    step_limit : float
        Integration step times fastest eigenvalue [-].

    Raises
    ------
    DataError
        If there would be fewer than two samples.
    LayoutError
        If a noise is not stated, or a sensor does not fit the machine.
    MachineError
        If a value is missing.

    """

    def __init__(
        self,
        model: Model,
        layout: Layout,
        signals: tuple[Signal, ...],
        sample_rate: float,
        duration: float,
        settling: float = 0.0,
        sensor_unknowns: tuple[SensorUnknown, ...] = (),
        step_limit: float = STEP_LIMIT,
    ) -> None:
        self._count = round(duration * sample_rate)
        if self._count < 2:
            raise DataError(
                f'planned run: {duration:g} s at {sample_rate:g} Hz are {self._count} samples, '
                'expected at least two'
            )
        self._model = model
        self._signals = signals
        self._rate = sample_rate
        self._settled = round(settling * sample_rate)
        self._unknowns = len(sensor_unknowns)
        self._step_limit = step_limit
        self._prediction = SensorPrediction(model, layout, sample_rate, sensor_unknowns)
        self._deviation = _noise(layout, self._prediction)
        self._rest = static_equilibrium(model)
        self._lowest = self._model.lines @ self._rest

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of the layout that measure motion, in order."""
        return self._prediction.channels

    @property
    def n_own(self) -> int:
        """Number of unknowns of the initial state, displacement then velocity."""
        return 2 * self._rest.size

    @property
    def size(self) -> int:
        """Number of all unknowns: initial state, the model's, the sensors'."""
        return self.n_own + len(self._model.estimated) + self._unknowns

    def weighted_derivatives(self) -> Iterator[NDArray[np.float64]]:
        """
        Simulate; yield the readings' derivatives by the unknowns in standard deviations of noise.

        Yields
        ------
        ndarray, shape (n_samples, n_motion_channels, n_unknowns)
            Consecutive samples. Unknowns: initial state, the model's, the sensors'. Zero where a
            late sensor shows something from before or after the run.

        Raises
        ------
        MachineError
            If the motion grows without bound.

        """
        simulation = _WatchedSimulation(
            self._model, self._signals, 1 / self._rate, self._rest, np.zeros_like(self._rest),
            step_limit=self._step_limit, sensitive=False,
        )  # fmt: skip
        for start in range(0, self._settled, CHUNK):
            simulation.advance(min(CHUNK, self._settled - start))
        simulation = _WatchedSimulation(
            self._model, self._signals, 1 / self._rate, simulation.displacement,
            simulation.velocity, start=self._settled / self._rate,
            step_limit=self._step_limit, steps=simulation.steps,
        )  # fmt: skip
        prediction = self._prediction
        late = prediction.stated_delays
        first = np.where(prediction.moved, np.ceil(late) + HALF_WIDTH, 0)
        last = np.where(prediction.moved, self._count + np.floor(late) - HALF_WIDTH, self._count)
        for part in prediction.run(simulation, self._count, np.zeros(self._unknowns)):
            sample = np.arange(part.first, part.first + len(part.readings))[:, np.newaxis]
            weights = ((sample >= first) & (sample < last)) / self._deviation
            yield part.derivatives * weights[:, :, np.newaxis]
        self._lowest = simulation.lowest

    def relief(self) -> dict[str, float]:
        """
        Tell how far the motion, once simulated, relieves the preloaded contacts.

        Returns
        -------
        dict of str to float
            By joint: largest part of the compression at rest that the motion takes away [-];
            from 1 on the contact law passes its kink, and a contact that can open does so.

        """
        found: dict[str, float] = {}
        at_rest = self._model.lines @ self._rest
        for term in self._model.terms:
            compression = term.law.preload + at_rest[term.line]
            if term.law.kind in PRELOADED and term.law.preload > 0 and compression > 0:
                joint = self._model.line_joints[term.line]
                relieved = float((at_rest - self._lowest)[term.line] / compression)
                found[joint] = max(relieved, found.get(joint, 0.0))
        return found


class _WatchedSimulation(VariedSimulation):
    """A simulation that remembers the smallest deformation of every line."""

    def __post_init__(self) -> None:
        """Begin with the initial state."""
        super().__post_init__()
        self.lowest: NDArray[np.float64] = self.model.lines @ self.displacement

    def advance(self, count: int) -> MotionVariation:
        """Integrate over a number of intervals (see `VariedSimulation`)."""
        variation = super().advance(count)
        deformation = variation.motion[:, 0] @ self.model.lines.T
        self.lowest = np.minimum(self.lowest, deformation.min(axis=0))
        return variation


def _noise(layout: Layout, prediction: SensorPrediction) -> NDArray[np.float64]:
    sensors = [layout.sensors[channel] for channel in prediction.channels]
    for sensor in sensors:
        if not (sensor.noise > 0 or sensor.resolution > 0):
            raise LayoutError(
                f'sensor {sensor.name}: noise is {sensor.noise}, expected a positive number; '
                'how exact a run will be depends on the noise of every sensor'
            )
    return np.array(
        [np.hypot(np.nan_to_num(one.noise), one.resolution / np.sqrt(12)) for one in sensors]
    )
