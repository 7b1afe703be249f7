# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
A record against a model: the motion as simulated and as it was, and the noise of the sensors.

The measured readings are compared with a nominal motion, about which the equations of motion are
linearised. The noise is white; averages over a few samples keep what the machine can do.
"""

from dataclasses import dataclass, replace

from identnl_ros.core.discrepancy.circumstances import Course, Scale, Signals
from identnl_ros.core.discrepancy.consistent_motion import consistent_motion
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.nominal_motion import corrected, NominalMotion
from identnl_ros.core.errors import MachineError
from identnl_ros.core.likelihood.likelihood_record import prepare, PreparedRecord
from identnl_ros.core.measurement.added_reading import gravity_reading
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.noise import NoiseEstimate
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.measurement.sensor_prediction import MOTION_KINDS, SensorPrediction
from identnl_ros.core.mechanics.kinematics import joint_deformation
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.weak.weighting_function import bandwidth, weighting_function_for
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

Reals = NDArray[np.float64]

CHUNK = 1024
# Noise of a sensor that is said to have none, over what it reads.
FINEST = 1e-6


@dataclass(frozen=True)
class State:
    """
    State of a machine.

    Parameters
    ----------
    displacement, velocity : ndarray, shape (n_coordinates,)
    hidden : ndarray, shape (n_hidden,)
        Of hysteretic terms.

    """

    displacement: Reals
    velocity: Reals
    hidden: Reals

    @property
    def flat(self) -> Reals:
        """All numbers, in this order."""
        return np.concatenate((self.displacement, self.velocity, self.hidden))

    def moved(self, step: Reals) -> 'State':
        """
        Add to all numbers.

        Parameters
        ----------
        step : ndarray
            In the order of `flat`.

        Returns
        -------
        State

        """
        n = len(self.displacement)
        return State(
            self.displacement + step[:n],
            self.velocity + step[n : 2 * n],
            self.hidden + step[2 * n :],
        )


class Comparison:
    """
    A record against a model.

    Parameters
    ----------
    description : Description
        Its layout is that of the record.
    model : Model
        Assembled from its machine; all values known.
    record : MeasuredRecord
    state : State or None
        At the first sample compared; None: from the first samples.
    noise : ndarray, shape (n_motion_sensors,), or None
        Of one reading [SI]; None: read off the fastest changes.
    earlier : Comparison or None
        Of the same record with the same unknowns: what does not depend on values is taken from it.

    """

    def __init__(
        self,
        description: Description,
        model: Model,
        record: MeasuredRecord,
        state: State | None = None,
        noise: Reals | None = None,
        earlier: 'Comparison | None' = None,
    ) -> None:
        self.description = description
        self.model = model
        self.rate = record.sample_rate
        self._origin = record.origin
        prediction = SensorPrediction(model, record.layout, record.sample_rate)
        self.sensors = [record.layout.sensors[i] for i in prediction.channels]
        self.prepared: PreparedRecord = (
            earlier.prepared if earlier else prepare(model, record, prediction)
        )
        prepared = self.prepared
        self._gravity = prediction.gravity
        _, self.tilt = self._gravity.among(len(self.sensors))
        """What the sensors read of gravity per unit of every coordinate, (n_sensors, n)."""
        self.rows = [
            (order, places, sensor_matrix(model, tuple(self.sensors[i] for i in places)))
            for order, kind in enumerate(MOTION_KINDS)
            if (places := [i for i, one in enumerate(self.sensors) if one.kind is kind])
        ]
        self.state = state or State(
            prepared.initial_displacement,
            prepared.initial_velocity,
            np.zeros(len(model.hidden_columns)),
        )
        self.measured: Reals = earlier.measured if earlier else _aligned(prepared)
        """Of the sensors of motion, without stated delays, (n_samples, n_sensors) [SI]."""
        self.valid = prepared.weights > 0
        """Which of them are readings."""
        self.failed = False
        """The model with its values cannot be simulated."""
        self.simulated = simulated = self._simulated()
        readings = self.readings(simulated)
        self.deviation = self.noise() if noise is None else noise
        """Standard deviation of one reading of every sensor [SI]."""
        white = (self.measured - self.measured.mean(axis=0)) / self.deviation
        order, places, _ = self.rows[0]
        frequency = bandwidth(white[:, places], self.rate, order)
        self.average = weighting_function_for(frequency, self.rate).stride
        self.count = len(self.measured) // self.average * self.average
        self.motion = self._nominal(simulated, readings)

    @property
    def time(self) -> Reals:
        """Of the samples and of one more, since the begin of the stream, (n_samples + 1,) [s]."""
        samples = self.prepared.first + np.arange(len(self.measured) + 1)
        return np.asarray(self._origin + samples / self.rate)

    @property
    def scale(self) -> Scale:
        """How far and how fast joints move."""
        deformation, rate = {}, {}
        machine, coordinates = self.model.machine, self.model.coordinates
        for joint in machine.joints:
            rows = joint_deformation(machine, coordinates, joint)
            for axis in range(6):
                key = joint.name, axis + 1
                deformation[key] = float(np.abs(self.motion.displacement @ rows[axis]).max())
                rate[key] = float(np.abs(self.motion.velocity @ rows[axis]).max())
        return Scale(deformation, rate)

    def residual_ratios(self) -> dict[str, float]:
        """
        Compare every sensor's deviation from the nominal motion with its noise.

        Returns
        -------
        dict of str to float
            Root mean square of averages over that of the noise.

        """
        white = (self.measured - self.readings(self.motion)) / self.deviation
        white[~self.valid] = 0.0
        ratios = np.sqrt(np.mean(averages(white, self.average) ** 2, axis=0))
        return {one.name: float(ratio) for one, ratio in zip(self.sensors, ratios, strict=True)}

    def simulated_error(self) -> tuple[Reals, NDArray[np.bool_]]:
        """
        Compare the readings with the simulation from the initial state, uncorrected.

        Returns
        -------
        error : ndarray, shape (n_samples, n_motion_sensors)
            Measured less simulated [SI].
        valid : ndarray of bool, the same shape

        """
        return self.measured - self.readings(self.simulated), self.valid

    def _simulated(self) -> NominalMotion:
        """Simulate from the initial state; no motion where the model cannot be simulated."""
        try:
            return self._integrated()
        except MachineError:
            none = np.zeros((len(self.measured) + 1, len(self.model.coordinates)))
            self.failed = True
            return NominalMotion(none, none, none)

    def _integrated(self) -> NominalMotion:
        prepared = self.prepared
        state = self.state
        simulation = VariedSimulation(
            self.model, prepared.signals, 1 / self.rate, state.displacement.copy(),
            state.velocity.copy(), start=prepared.first / self.rate, origin=self._origin,
            sensitive=False, hidden=state.hidden.copy(),
        )  # fmt: skip
        total = len(self.measured) + 1
        parts = [
            simulation.advance(min(CHUNK, total - first)).motion
            for first in range(0, total, CHUNK)
        ]
        motion = np.concatenate(parts)
        return NominalMotion(*(np.ascontiguousarray(motion[:, order]) for order in range(3)))

    def readings(self, motion: NominalMotion) -> Reals:
        """
        Read a motion as the sensors would.

        Parameters
        ----------
        motion : NominalMotion

        Returns
        -------
        ndarray, shape (n_samples, n_motion_sensors)
            [SI].

        """
        series = motion.displacement, motion.velocity, motion.acceleration
        result = np.empty((len(self.measured), len(self.sensors)))
        for order, places, rows in self.rows:
            result[:, places] = series[order][: len(result)] @ rows.T
        gravity = self._gravity
        result[:, gravity.channels] += gravity.of(motion.displacement[: len(result)])
        return result

    def noise(self) -> Reals:
        """
        Read the noise off the fastest changes, of the readings or of what is left of them.

        Returns
        -------
        ndarray, shape (n_motion_sensors,)
            Standard deviation of a reading [SI].

        """
        found = []
        # Readings whose delay was taken out are smoother than they came.
        left = self.measured - self.readings(self.simulated)
        left[:, self.prepared.prediction.stated_delays != 0] = np.nan
        for table in (self.prepared.measured, left):
            estimate = NoiseEstimate(table.shape[1])
            estimate.add(np.where(self.valid, table, np.nan))
            found.append(estimate.standard_deviation)
        # Motion adds to both.
        least = np.fmin(*found)
        stated = 1 / np.where(self.valid.any(axis=0), self.prepared.weights.max(axis=0), 1.0)
        size = np.sqrt(np.mean(self.measured**2, axis=0))
        known = np.where(np.isfinite(least), least, stated)
        return np.asarray(np.maximum(known, FINEST * size + np.finfo(float).tiny))

    def _nominal(self, simulated: NominalMotion, readings: Reals) -> NominalMotion:
        order, places, rows = self.rows[0]
        if order:
            return simulated
        residual = np.where(self.valid, self.measured - readings, 0.0)[:, places]
        to_motion, covariance = consistent_motion(residual, rows, self.deviation[places])
        deviation = residual @ to_motion.T
        deviation = np.vstack((deviation, deviation[-1:]))
        # Averages cannot tell faster motion from slower.
        highest = self.rate / (2 * self.average)
        return corrected(simulated, deviation, covariance, self.rate, highest)

    def force(self) -> Reals:
        """
        Give the measured force.

        Returns
        -------
        ndarray, shape (n_samples + 1, n_excitations)
            [N].

        """
        begin = self.prepared.first / self.rate
        return np.column_stack(
            [
                one.on_grid(begin, 1 / self.rate, len(self.measured) + 1)
                for one in self.prepared.signals
            ]
        )

    def course(self) -> Course:
        """
        Collect what effects of the machine are evaluated from.

        Returns
        -------
        Course
            Of as many samples as are compared, and one more.

        """
        part = slice(0, self.count + 1)
        motion = self.motion
        return Course(
            self.description, self.model,
            self.time[part],
            motion.displacement[part], motion.velocity[part], motion.acceleration[part],
            self.force()[part],
        )  # fmt: skip

    def signals(self) -> Signals:
        """
        Collect what faults of sensors are evaluated from.

        Returns
        -------
        Signals

        """
        motion = self.motion
        nominal = self.readings(motion)
        series = motion.displacement, motion.velocity, motion.acceleration
        following = (*series[1:], np.gradient(motion.acceleration, 1 / self.rate, axis=0))
        rates = np.empty_like(nominal)
        triads = {}
        for order, places, rows in self.rows:
            rates[:, places] = following[order][: len(rates)] @ rows.T
            for i in places:
                axes = tuple(replace(self.sensors[i], direction=axis) for axis in np.eye(3))
                three = series[order] @ sensor_matrix(self.model, axes).T
                gravity = gravity_reading(self.model, axes, self.description.layout.gravity)
                three[:, gravity.channels] += gravity.of(motion.displacement)
                triads[self.sensors[i].name] = three[: len(rates)]
        rates += motion.velocity[: len(rates)] @ self.tilt.T
        names = [sensor.name for sensor in self.sensors]
        return Signals(
            self.time[:-1],
            dict(zip(names, nominal.T, strict=True)),
            dict(zip(names, rates.T, strict=True)),
            triads,
            {sensor.name: sensor.kind for sensor in self.sensors},
            {sensor.name: sensor.direction for sensor in self.sensors},
        )


def averages(table: Reals, length: int) -> Reals:
    """
    Average over consecutive samples, the noise keeping its size.

    Parameters
    ----------
    table : ndarray, shape (n_samples, ...)
    length : int

    Returns
    -------
    ndarray, shape (n_samples // length, ...)

    """
    shape = len(table) // length, length, *table.shape[1:]
    return np.asarray(table[: shape[0] * length].reshape(shape).mean(axis=1) * np.sqrt(length))


def _aligned(prepared: PreparedRecord) -> Reals:
    """Take out stated delays."""
    delays = prepared.prediction.stated_delays
    if not delays.any():
        return prepared.measured
    measured = prepared.measured.copy()
    time = np.arange(len(measured), dtype=np.float64)
    for i in np.flatnonzero(delays):
        measured[:, i] = make_interp_spline(time, prepared.measured[:, i], 5)(
            np.clip(time + delays[i], 0, len(time) - 1)
        )
    return measured
