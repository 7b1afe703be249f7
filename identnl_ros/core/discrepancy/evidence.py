# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What a record says about a number of hypotheses: one linear regression for all of them.

The measured readings are compared with a nominal motion. What they deviate from it by is, to
first order, a sum of the responses of the linearised machine to: errors of the unknowns and of
the initial state, what the nominal motion lacks in the equations of motion (known), and each
effect that is missing, in proportion to its size; and of the deviations that sensor faults add.
The noise is white; averages over a few samples keep what the machine can do. Noise of the
measured force, which the machine filters, is taken out by weights in the frequency domain.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from identnl_ros.core.discrepancy.consistent_motion import consistent_motion
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Hypothesis, Scale, SensorFault, Signals
from identnl_ros.core.discrepancy.features import Features, left_hand_side
from identnl_ros.core.discrepancy.nominal_motion import corrected, NominalMotion
from identnl_ros.core.errors import MachineError
from identnl_ros.core.likelihood.likelihood_record import prepare, PreparedRecord
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.noise import NoiseEstimate
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.measurement.sensor_prediction import MOTION_KINDS, SensorPrediction
from identnl_ros.core.mechanics.kinematics import joint_deformation
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.simulation.tangent_response import TangentResponse
from identnl_ros.core.weak.weighting_function import bandwidth, weighting_function_for
import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.interpolate import make_interp_spline

Reals = NDArray[np.float64]

CHUNK = 256
# Noise of a sensor that is said to have none, over what it reads.
FINEST = 1e-6


@dataclass(frozen=True)
class Evidence:
    """
    A linear regression with noise of unit variance.

    Parameters
    ----------
    residual : ndarray, shape (n_rows,)
        What the nominal motion and its defect leave of the readings.
    base : ndarray, shape (n_rows, n_base)
        By the unknowns of the model and the initial state.
    columns : ndarray, shape (n_rows, n_hypotheses)
        By the sizes of the hypotheses.
    hypotheses : tuple of Hypothesis

    """

    residual: Reals
    base: Reals
    columns: Reals
    hypotheses: tuple[Hypothesis, ...]


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
    state : tuple of ndarray or None
        Displacement and velocity at the first sample compared; None: from the first samples.
    noise : ndarray, shape (n_motion_sensors,), or None
        Of one reading [SI]; None: read off the fastest changes.

    """

    def __init__(
        self,
        description: Description,
        model: Model,
        record: MeasuredRecord,
        state: tuple[Reals, Reals] | None = None,
        noise: Reals | None = None,
    ) -> None:
        self.description = description
        self.model = model
        self.rate = record.sample_rate
        prediction = SensorPrediction(model, record.layout, record.sample_rate)
        self.sensors = [record.layout.sensors[i] for i in prediction.channels]
        self._prepared = prepared = prepare(model, record, prediction)
        self._force_noise = _force_noise(model, record.layout)
        self._rows = [
            (order, places, sensor_matrix(model, tuple(self.sensors[i] for i in places)))
            for order, kind in enumerate(MOTION_KINDS)
            if (places := [i for i, one in enumerate(self.sensors) if one.kind is kind])
        ]
        self.state = state or (prepared.initial_displacement, prepared.initial_velocity)
        self.measured = _aligned(prepared)
        self._valid = prepared.weights > 0
        self.failed = False
        """The model with its values cannot be simulated."""
        self.simulated = simulated = self._simulated()
        readings = self._readings(simulated)
        self.deviation = self._noise(readings) if noise is None else noise
        """Standard deviation of one reading of every sensor [SI]."""
        white = (self.measured - self.measured.mean(axis=0)) / self.deviation
        order, places, _ = self._rows[0]
        frequency = bandwidth(white[:, places], self.rate, order)
        self.average = weighting_function_for(frequency, self.rate).stride
        self.count = len(self.measured) // self.average * self.average
        self.motion = self._nominal(simulated, readings)

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

    def evidence(self, hypotheses: Sequence[Hypothesis]) -> Evidence:
        """
        Set up the regression.

        Parameters
        ----------
        hypotheses : sequence of Hypothesis

        Returns
        -------
        Evidence

        """
        inner = [one for one in hypotheses if not isinstance(one.effect, SensorFault)]
        faults = [one for one in hypotheses if isinstance(one.effect, SensorFault)]
        features = Features(self.description, self.model, inner)
        parts = list(self._responses(features, len(inner)))
        averaged = self._channels(parts)
        unknowns = len(self.model.estimated)
        nominal = self._readings(self.motion)
        residual = (self.measured - nominal) / self.deviation
        residual[~self._valid] = 0.0
        residual = _averages(residual[: self.count], self.average) - averaged[..., unknowns]
        machine = averaged[..., unknowns + 1 : unknowns + 1 + len(inner)]
        base = np.concatenate(
            (averaged[..., :unknowns], averaged[..., unknowns + 1 + len(inner) :]), axis=2
        )
        table = np.concatenate((residual[..., np.newaxis], base), axis=2)
        rows = self._whitened(table)
        columns = np.empty((*machine.shape[:2], len(hypotheses)), dtype=np.float32)
        columns[..., : len(inner)] = machine
        for i, column in enumerate(self._fault_columns(faults, nominal), start=len(inner)):
            columns[..., i] = column
        # Correlations need no more digits than this, and half the memory.
        return Evidence(rows[:, 0], rows[:, 1:], self._whitened(columns), (*inner, *faults))

    def residual_ratios(self) -> dict[str, float]:
        """
        Compare every sensor's deviation from the nominal motion with its noise.

        Returns
        -------
        dict of str to float
            Root mean square of averages over that of the noise.

        """
        white = (self.measured - self._readings(self.motion)) / self.deviation
        white[~self._valid] = 0.0
        ratios = np.sqrt(np.mean(_averages(white, self.average) ** 2, axis=0))
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
        return self.measured - self._readings(self.simulated), self._valid

    def _simulated(self) -> NominalMotion:
        """Simulate from the initial state; no motion where the model cannot be simulated."""
        try:
            return self._integrated()
        except MachineError:
            none = np.zeros((len(self.measured) + 1, len(self.model.coordinates)))
            self.failed = True
            return NominalMotion(none, none, none)

    def _integrated(self) -> NominalMotion:
        prepared = self._prepared
        displacement, velocity = self.state
        simulation = VariedSimulation(
            self.model, prepared.signals, 1 / self.rate, displacement.copy(), velocity.copy(),
            start=prepared.first / self.rate, sensitive=False,
        )  # fmt: skip
        total = len(self.measured) + 1
        parts = [
            simulation.advance(min(4 * CHUNK, total - first)).motion
            for first in range(0, total, 4 * CHUNK)
        ]
        motion = np.concatenate(parts)
        return NominalMotion(*(np.ascontiguousarray(motion[:, order]) for order in range(3)))

    def _readings(self, motion: NominalMotion) -> Reals:
        series = motion.displacement, motion.velocity, motion.acceleration
        result = np.empty((len(self.measured), len(self.sensors)))
        for order, places, rows in self._rows:
            result[:, places] = series[order][: len(result)] @ rows.T
        return result

    def _noise(self, readings: Reals) -> Reals:
        """Read the noise off the fastest changes, of the readings or of what is left of them."""
        found = []
        for table in (self.measured, self.measured - readings):
            estimate = NoiseEstimate(table.shape[1])
            estimate.add(np.where(self._valid, table, np.nan))
            found.append(estimate.standard_deviation)
        # Motion adds to both.
        least = np.fmin(*found)
        stated = 1 / np.where(self._valid.any(axis=0), self._prepared.weights.max(axis=0), 1.0)
        size = np.sqrt(np.mean(self.measured**2, axis=0))
        known = np.where(np.isfinite(least), least, stated)
        return np.asarray(np.maximum(known, FINEST * size + np.finfo(float).tiny))

    def _nominal(self, simulated: NominalMotion, readings: Reals) -> NominalMotion:
        order, places, rows = self._rows[0]
        if order:
            return simulated
        residual = np.where(self._valid, self.measured - readings, 0.0)[:, places]
        to_motion, covariance = consistent_motion(residual, rows, self.deviation[places])
        deviation = residual @ to_motion.T
        deviation = np.vstack((deviation, deviation[-1:]))
        return corrected(simulated, deviation, covariance, self.rate)

    def _responses(self, features: Features, count: int) -> Iterator[Reals]:
        """Yield averages of the responses, (n_averages, 3, n, n_columns)."""
        motion = self.motion
        prepared = self._prepared
        force = np.column_stack(
            [
                one.on_grid(prepared.first / self.rate, 1 / self.rate, self.count + 1)
                for one in prepared.signals
            ]
        )
        defect = force @ self.model.excitation_directions - left_hand_side(
            self.model,
            *(
                one[: self.count + 1]
                for one in (motion.displacement, motion.velocity, motion.acceleration)
            ),
        )
        response = TangentResponse(self.model, 1 / self.rate, 1 + count)
        size = max(CHUNK // self.average, 1) * self.average
        for first in range(0, self.count, size):
            end = min(first + size, self.count)
            part = slice(first, end + 1)
            piece = motion.displacement[part], motion.velocity[part], motion.acceleration[part]
            disturbance = np.concatenate(
                (defect[part, :, np.newaxis], features.along(*piece)), axis=2
            )
            yield _averages(response.advance(*piece, disturbance), self.average)

    def _channels(self, parts: list[Reals]) -> Reals:
        """Project on the sensors, in units of their noise."""
        count = sum(len(part) for part in parts)
        result = np.empty((count, len(self.sensors), parts[0].shape[3]))
        for order, places, rows in self._rows:
            weighted = rows / self.deviation[places, np.newaxis]
            first = 0
            for part in parts:
                result[first : first + len(part), places] = weighted @ part[:, order]
                first += len(part)
        return result

    def _fault_columns(self, faults: list[Hypothesis], nominal: Reals) -> Iterator[Reals]:
        signals = self._signals(nominal)
        place = {sensor.name: i for i, sensor in enumerate(self.sensors)}
        shape = self.count // self.average, len(self.sensors)
        for one in faults:
            column = np.zeros(shape)
            assert isinstance(one.effect, SensorFault)
            for name, series in one.effect.deviation(signals, one.place).items():
                i = place[name]
                column[:, i] = _averages(series[: self.count] / self.deviation[i], self.average)
            yield column

    def _signals(self, nominal: Reals) -> Signals:
        motion = self.motion
        series = motion.displacement, motion.velocity, motion.acceleration
        following = (*series[1:], np.gradient(motion.acceleration, 1 / self.rate, axis=0))
        rates = np.empty_like(nominal)
        triads = {}
        for order, places, rows in self._rows:
            rates[:, places] = following[order][: len(rates)] @ rows.T
            for i in places:
                axes = [replace(self.sensors[i], direction=axis) for axis in np.eye(3)]
                three = sensor_matrix(self.model, tuple(axes))
                triads[self.sensors[i].name] = series[order][: len(rates)] @ three.T
        names = [sensor.name for sensor in self.sensors]
        return Signals(
            np.arange(len(nominal)) / self.rate,
            dict(zip(names, nominal.T, strict=True)),
            dict(zip(names, rates.T, strict=True)),
            triads,
            {sensor.name: sensor.kind for sensor in self.sensors},
            {sensor.name: sensor.direction for sensor in self.sensors},
        )

    def _whitened(self, table: Reals) -> Reals:
        """Take out the force's noise; real rows, (n_rows, n_columns)."""
        count = len(table)
        lines = fft.rfft(table, axis=0, norm='ortho')
        if self._force_noise is not None:
            response = self._force_response(fft.rfftfreq(count, self.average / self.rate))
            left, sizes, _ = np.linalg.svd(response, full_matrices=False)
            shrink = 1 / np.sqrt(1 + sizes**2) - 1
            left = left.astype(lines.dtype)
            weighted = (left * shrink[:, np.newaxis]).astype(lines.dtype)
            lines += weighted @ (left.conj().transpose(0, 2, 1) @ lines)
        weights = np.full(len(lines), np.sqrt(2.0))
        weights[0] = 1.0
        if count % 2 == 0:
            weights[-1] = 1.0
        lines *= weights[:, np.newaxis, np.newaxis].astype(table.dtype)
        whole = lines.reshape(lines.shape[0] * lines.shape[1], table.shape[2])
        return np.concatenate((whole.real, whole.imag))

    def _force_response(self, frequencies: Reals) -> NDArray[np.complex128]:
        """Respond to noise of the force as the machine at rest does, in units of noise."""
        model = self.model
        rest = self.motion.displacement.mean(axis=0)
        rate = 2j * np.pi * frequencies[:, np.newaxis, np.newaxis]
        dynamic = (
            np.diag(model.mass_diagonal()) * rate**2
            + model.damping_matrix() * rate
            + model.tangent_stiffness(rest)
        )
        assert self._force_noise is not None
        motion = np.linalg.solve(
            dynamic, (model.excitation_directions.T @ self._force_noise)[None]
        )
        result = np.zeros((len(frequencies), len(self.sensors), motion.shape[2]), np.complex128)
        for order, places, rows in self._rows:
            result[:, places] = (rows / self.deviation[places, np.newaxis]) @ (
                rate**order * motion
            )
        return result


def _averages(table: Reals, length: int) -> Reals:
    """Average over consecutive samples, the noise keeping its size."""
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


def _force_noise(model: Model, layout: Layout) -> Reals | None:
    """Find the root of the covariance of the exciters' forces as measured; what is stated only."""
    exciters = []
    for point in model.machine.excitations:
        own = [one.noise for one in layout.sensors if one.excitation == point.name]
        known = np.array([one for one in own if one > 0])
        # The force itself may change from sample to sample: its noise does not show in that.
        stated = len(known) == len(own) > 0
        exciters.append(float((known**-2.0).sum() ** -0.5) if stated else 0.0)
    root = np.diag(exciters)
    return root if root.any() else None
