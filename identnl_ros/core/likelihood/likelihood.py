# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Maximum-likelihood identification: the simulated motion that fits all sensors best.

The model is simulated under the measured force and compared with every sensor of motion; all
unknowns and the initial state of each record follow from weighted nonlinear least squares
(Gauss-Newton with orthogonal factors, damped after Levenberg and Marquardt where needed). With
white sensor noise of known size the estimate reaches the Cramer-Rao bound as the record grows.
The force is taken as exact: noise of its sensors is not accounted for.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.algebra.information import Solution
from identnl_ros.core.errors import DataError
from identnl_ros.core.likelihood.likelihood_point import (
    LikelihoodSettings,
    Point,
    start_of,
)
from identnl_ros.core.likelihood.likelihood_record import (
    prepare,
    PreparedRecord,
    stretch,
)
from identnl_ros.core.likelihood.likelihood_search import residuals_at, search
from identnl_ros.core.measurement.measured_record import MeasuredRecord, standard_deviations
from identnl_ros.core.measurement.sensor_prediction import SensorPrediction
from identnl_ros.core.measurement.sensor_unknown import SensorUnknown
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.mechanics.modes import modes
from identnl_ros.core.simulation.sensitivity import STEP_LIMIT
from identnl_ros.core.simulation.simulation import STEP_LIMIT as FINE_STEP_LIMIT
import numpy as np
from numpy.typing import NDArray

# Pieces that the fit begins with: so many periods of the slowest vibration, so many at most.
PIECE_PERIODS = 4.0
MOST_PIECES = 4
SHORTEST_PIECE = 100  # samples
# Residuals of so many times the noise are worth a word.
DOUBTFUL = 1.1


@dataclass(frozen=True)
class LikelihoodFit:
    """
    Result of a maximum-likelihood fit.

    Parameters
    ----------
    model : Model
        With the estimated values; a combination the data do not determine keeps its start.
    values : ndarray, shape (n_unknowns,)
        In the order of `Model.estimated` [SI].
    covariance : ndarray, shape (n_unknowns, n_unknowns)
        Of `values`, under the stated noise; meaningless where `free`.
    sensor_values, sensor_deviations : ndarray, shape (n_sensor_unknowns,)
        Unknowns of the sensors and their standard deviations.
    initial_states : tuple of ndarray, each shape (2, n_coordinates)
        Displacement and velocity at the first sample used of each record.
    solution : Solution
        Of the last linearisation, initial states eliminated: unknowns of the machine first,
        then those of the sensors.
    chi_squared : float
        Sum of squared residuals, each in standard deviations of its noise.
    degrees_of_freedom : int
        Valid readings minus unknowns that they determine.
    noise_known : bool
        Every sensor's noise is stated and positive; otherwise `chi_squared` and `covariance`
        rest on estimates, or, where there is no noise at all, mean nothing.
    channel_names : tuple of tuple of str
        Sensors of motion of each record.
    channel_ratios : tuple of ndarray
        Root mean square of each one's residual over its noise; NaN without valid readings.
    converged : bool
    reason : str
        How the search ended, in words.
    iterations : int
        Linearisations of the whole data.
    residuals : tuple of ndarray, each shape (n_samples, n_motion_channels)
        In standard deviations, NaN where not used; empty unless asked for.
    first_samples : tuple of int
        Sample of each record that its residuals and its initial state belong to.

    """

    model: Model
    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    sensor_values: NDArray[np.float64]
    sensor_deviations: NDArray[np.float64]
    initial_states: tuple[NDArray[np.float64], ...]
    solution: Solution
    chi_squared: float
    degrees_of_freedom: int
    noise_known: bool
    channel_names: tuple[tuple[str, ...], ...]
    channel_ratios: tuple[NDArray[np.float64], ...]
    converged: bool
    reason: str
    iterations: int
    residuals: tuple[NDArray[np.float64], ...]
    first_samples: tuple[int, ...]

    @property
    def free(self) -> NDArray[np.bool_]:
        """Unknowns that take part in a combination the data do not determine."""
        return self.solution.free

    @property
    def null_space(self) -> NDArray[np.float64]:
        """Directions that leave every reading unchanged, shape (n_all_unknowns, n_null)."""
        return self.solution.null_space

    @property
    def condition_number(self) -> float:
        """Of the column-scaled problem, initial states eliminated."""
        return self.solution.condition_number

    @property
    def standard_deviations(self) -> NDArray[np.float64]:
        """Of `values`; NaN where the data do not determine a value, shape (n_unknowns,)."""
        deviations = np.sqrt(np.diag(self.covariance))
        deviations[self.free[: len(deviations)]] = np.nan
        return np.asarray(deviations)

    @property
    def excess(self) -> float:
        """
        How far chi squared lies above its expectation, in its standard deviations [-].

        Above 4: noise alone does not explain the residuals, where it is known.
        """
        return (self.chi_squared - self.degrees_of_freedom) / float(
            np.sqrt(2 * max(self.degrees_of_freedom, 1))
        )


def fit_likelihood(
    model: Model,
    records: Sequence[MeasuredRecord],
    sensor_unknowns: tuple[SensorUnknown, ...] = (),
    settings: LikelihoodSettings | None = None,
) -> LikelihoodFit:
    """
    Fit the unknowns of a machine, and of its sensors, to measured records.

    Parameters
    ----------
    model : Model
        Its values are the start of the search; all must be known, some within about a factor 2.
    records : sequence of MeasuredRecord
        Of one machine; layouts, excitations and amplitudes may differ.
    sensor_unknowns : tuple of SensorUnknown
        Common to all records whose layout has the sensors named.
    settings : LikelihoodSettings or None
        None: the defaults.

    Returns
    -------
    LikelihoodFit
        Also when the search has not converged: see `converged` and `reason`.

    Raises
    ------
    DataError
        If there is no record, or a force has holes.
    LayoutError
        If a layout does not fit the machine.
    MachineError
        If a value is missing, or the machine cannot be simulated from where the search starts.

    """
    if not records:
        raise DataError('likelihood fit: no record given, expected at least one')
    settings = settings or LikelihoodSettings()
    model.require_values()
    prepared = []
    for record in records:
        prediction = SensorPrediction(model, record.layout, record.sample_rate, sensor_unknowns)
        prepared.append(prepare(model, record, prediction))
    known = [_noise_known(record, one) for record, one in zip(records, prepared, strict=True)]
    perfect = any(np.all(_deviations(record, one) == 0) for record, one in
                  zip(records, prepared, strict=True))  # fmt: skip
    limit = settings.step_limit or (FINE_STEP_LIMIT if perfect else STEP_LIMIT)
    point = start_of(model, prepared, len(sensor_unknowns))
    if settings.pieces:
        point = _from_pieces(model, records, prepared, point, settings)
    outcome = search(model, prepared, point, settings, limit)
    point, step = outcome.point, outcome.step
    n = len(model.estimated)
    whitened = residuals_at(model, prepared, point, limit)
    chi_squared = float(sum(np.sum(one**2) for one in whitened))
    inverse = step.solution.inverse
    determined = len(point.common) - step.solution.null_space.shape[1]
    valid = sum(one.valid for one in prepared)
    own = sum(2 * len(model.coordinates) for _ in prepared)
    masked = [
        np.where(one.weights > 0, residual, np.nan)
        for one, residual in zip(prepared, whitened, strict=True)
    ]
    return LikelihoodFit(
        model=point.model_of(model),
        values=point.common[:n],
        covariance=inverse[:n, :n],
        sensor_values=point.common[n:],
        sensor_deviations=np.sqrt(np.diag(inverse)[n:]),
        initial_states=tuple(state.reshape(2, -1) for state in point.states),
        solution=step.solution,
        chi_squared=chi_squared,
        degrees_of_freedom=valid - determined - own,
        noise_known=all(known),
        channel_names=tuple(
            tuple(record.layout.sensors[i].name for i in one.prediction.channels)
            for record, one in zip(records, prepared, strict=True)
        ),
        channel_ratios=tuple(
            np.sqrt(np.sum(residual**2, axis=0) / _at_least_nan(one))
            for one, residual in zip(prepared, whitened, strict=True)
        ),
        converged=outcome.converged,
        reason=outcome.reason + _doubt(chi_squared, valid),
        iterations=outcome.iterations,
        residuals=tuple(masked) if settings.keep_residuals else (),
        first_samples=tuple(one.first for one in prepared),
    )


def _from_pieces(
    model: Model,
    records: Sequence[MeasuredRecord],
    prepared: list[PreparedRecord],
    point: Point,
    settings: LikelihoodSettings,
) -> Point:
    """
    Come closer with short pieces of the records, each with an initial state of its own.

    Over a short time wrong stiffness has not yet put the simulated vibration out of step with
    the measured one, so the search is far less likely to end in a wrong minimum.
    """
    try:
        slowest = min(
            mode.frequency
            for mode in modes(model, prepared[0].initial_displacement)
            if mode.frequency > 0
        )
    except ValueError:  # nothing vibrates
        return point
    pieces: list[PreparedRecord] = []
    firsts = []
    share = max(1, MOST_PIECES // len(prepared))
    for record, one in zip(records, prepared, strict=True):
        total = len(one.measured)
        length = max(SHORTEST_PIECE, round(PIECE_PERIODS / slowest * one.sample_rate))
        firsts.append(len(pieces))
        if total < 2 * length:
            pieces.append(one)
            continue
        count = min(share, total // length)
        begins = np.linspace(0, total - length, count).astype(int)
        pieces += [stretch(model, record, one, begin, begin + length) for begin in begins]
    start = start_of(model, pieces, len(point.common) - len(model.estimated))
    found = search(model, pieces, start, settings, STEP_LIMIT, rough=True).point
    return Point(found.common, tuple(found.states[first] for first in firsts))


def _deviations(record: MeasuredRecord, prepared: PreparedRecord) -> NDArray[np.float64]:
    return standard_deviations(record)[list(prepared.prediction.channels)]


def _noise_known(record: MeasuredRecord, prepared: PreparedRecord) -> bool:
    sensors = [record.layout.sensors[i] for i in prepared.prediction.channels]
    return all(sensor.noise > 0 or sensor.resolution > 0 for sensor in sensors)


def _doubt(chi_squared: float, valid: int) -> str:
    ratio = np.sqrt(chi_squared / max(valid, 1))
    if ratio < DOUBTFUL:
        return ''
    return (
        f'; the residuals are {ratio:.3g} times the noise: the model lacks something, the '
        'stated noise is too small, or the search ended in a wrong minimum (start elsewhere)'
    )


def _at_least_nan(prepared: PreparedRecord) -> NDArray[np.float64]:
    counts = np.count_nonzero(prepared.weights, axis=0)
    return np.where(counts > 0, counts, np.nan)
