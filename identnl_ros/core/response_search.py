# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Go over kept records until the simulation follows them as closely as it can."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.errors import MachineError
from identnl_ros.core.information import Information, Solution
from identnl_ros.core.model import Model
from identnl_ros.core.motion_record import MotionRecord
from identnl_ros.core.motion_weights import MotionWeights
from identnl_ros.core.residual_statistics import ResidualStatistics
from identnl_ros.core.response_fit import FORCE_MARGIN, ResponseFit
from identnl_ros.core.weighting_function import WeightingFunction
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
# Displacement and velocity.
State = tuple[Reals, Reals]

# Samples that are simulated and factored at a time.
CHUNK = 512
PASSES = 25
HALVINGS = 8
# The last step may be this fraction of the standard errors, or of the values: sensors may be
# perfect.
SMALL_STEP = 0.02
SMALLEST_STEP = 1e-10
# Degree of the polynomial through the first samples that gives the initial state.
DEGREE = 5


@dataclass(frozen=True)
class WeighedRecord:
    """
    A record with what is known of its noise and its spectrum.

    Parameters
    ----------
    record : MotionRecord
    weights : MotionWeights
    function : WeightingFunction
        Test function for its spectrum.

    """

    record: MotionRecord
    weights: MotionWeights
    function: WeightingFunction

    @property
    def first(self) -> int:
        """Sample from which on the record is used: the initial state needs some on both sides."""
        return self.function.half_length

    @property
    def end(self) -> int:
        """Sample up to which the record is used: whole chunks, if there is one."""
        inside = max(len(self.record) - FORCE_MARGIN - self.first, 0)
        return self.first + (inside // CHUNK * CHUNK if inside >= CHUNK else inside)

    def initial_state(self) -> State:
        """
        Displacement and velocity at `first`, from a polynomial through the samples around it.

        Returns
        -------
        displacement, velocity : ndarray, shape (n_coordinates,)

        """
        table = self.record.displacement[: 2 * self.first + 1]
        time = np.arange(len(table)) / self.first - 1
        valid = np.isfinite(table).all(axis=1)
        powers = np.vander(time[valid], min(DEGREE + 1, int(valid.sum())), increasing=True)
        terms = np.linalg.lstsq(powers, table[valid], rcond=None)[0]
        velocity = terms[1] if len(terms) > 1 else np.zeros(table.shape[1])
        return terms[0], velocity * self.record.sample_rate / self.first


@dataclass
class Search:
    """
    Where a search has come to.

    Parameters
    ----------
    fits : list of ResponseFit
        One per record, linearised about the values reached.
    statistics : ResidualStatistics
        Of all records at these values.
    converged : bool
    reason : str
        Why it has not converged, in words.
    passes : int
        Simulations of the records that were made.

    """

    fits: list[ResponseFit]
    statistics: ResidualStatistics
    converged: bool
    reason: str
    passes: int


@dataclass
class _Point:
    """Values of the unknowns and initial states, and what a pass there has shown."""

    model: Model
    states: list[State]
    fits: list[ResponseFit]
    statistics: ResidualStatistics
    cost: float
    solution: Solution


def search(
    model: Model,
    records: Sequence[WeighedRecord],
    states: Sequence[State],
    discount: float = 1.0,
    small_step: float = SMALL_STEP,
) -> Search:
    """
    Gauss-Newton with step halving on the likelihood of several records.

    Parameters
    ----------
    model : Model
        Values to start from.
    records : sequence of WeighedRecord
    states : sequence of (displacement, velocity)
        Initial state of every record to start from.
    discount : float
        Weight of what has been learned before each `CHUNK` of samples; 1 forgets nothing.
    small_step : float
        Step, in standard errors, at which to stop.

    Returns
    -------
    Search

    Raises
    ------
    MachineError
        If the values to start from cannot be simulated.

    """
    point = _pass(model, records, list(states), discount)
    passes, reason = 1, f'no convergence in {PASSES} passes over the data'
    converged = False
    while passes < PASSES:
        if _steps_within(point, small_step, SMALLEST_STEP):
            converged, reason = True, ''
            break
        better, tried = _improved(point, records, discount, PASSES - passes)
        passes += tried
        if better is None:
            # Where rounding is all that is left, no step improves.
            converged = _cannot_matter(point)
            reason = '' if converged else 'no step brings the simulation closer to the measurement'
            break
        point = better
    return Search(point.fits, point.statistics, converged, reason, passes)


def _pass(
    model: Model,
    records: Sequence[WeighedRecord],
    states: list[State],
    discount: float,
) -> _Point:
    statistics = statistics_for(records[0])
    fits: list[ResponseFit] = []
    for one, state in zip(records, states, strict=True):
        fit = ResponseFit(model, one.weights, one.record.sample_rate, *state)
        statistics.restart()
        fits.append(fit)
        for first in range(one.first, one.end, CHUNK):
            if discount < 1:
                for earlier in fits:
                    earlier.information = earlier.information.discounted(discount)
            deviation = fit.advance(one.record, first, min(first + CHUNK, one.end))
            statistics.add(deviation.values)
    cost = sum(float((fit.information.factor[:, -1] ** 2).sum()) for fit in fits)
    return _Point(model, states, fits, statistics, cost, joint_information(fits).solve())


def statistics_for(record: WeighedRecord) -> ResidualStatistics:
    """
    Make empty statistics for the residuals of a record and its like.

    Parameters
    ----------
    record : WeighedRecord

    Returns
    -------
    ResidualStatistics

    """
    channels = sum(len(matrix) for _, matrix in record.weights.matrices)
    return ResidualStatistics(channels, record.function.stride)


def joint_information(fits: Sequence[ResponseFit]) -> Information:
    """
    Join what several records say about the unknowns.

    Parameters
    ----------
    fits : sequence of ResponseFit
        Linearised about the same values.

    Returns
    -------
    Information
        On differences of the unknowns from those values.

    """
    total = fits[0].unknowns
    for fit in fits[1:]:
        total = total.merged(fit.unknowns)
    return total


def _improved(
    point: _Point, records: Sequence[WeighedRecord], discount: float, passes: int
) -> tuple[_Point | None, int]:
    """Step towards the solution, by halves where that is too far."""
    steps = [fit.difference(point.solution.values) for fit in point.fits]
    share = 1.0
    tried = 0
    unknowns = list(point.model.estimated)
    n = len(point.model.coordinates)
    while tried < min(HALVINGS, passes):
        values = point.model.values
        values[unknowns] += share * point.solution.values
        states = [
            (displacement + share * step[-2 * n : -n], velocity + share * step[-n:])
            for (displacement, velocity), step in zip(point.states, steps, strict=True)
        ]
        tried += 1
        try:
            new = _pass(point.model.with_values(values), records, states, discount)
        except MachineError:
            share /= 4
            continue
        if new.cost < point.cost:
            return new, tried
        if _cannot_matter(point):
            break
        share /= 2
    return None, tried


def _cannot_matter(point: _Point) -> bool:
    """Tell whether rounding may be all that is left of a step."""
    return _steps_within(point, 10 * SMALL_STEP, 1e4 * SMALLEST_STEP)


def _steps_within(point: _Point, of_deviations: float, of_values: float) -> bool:
    solution = point.solution
    values = np.abs(point.model.values[list(point.model.estimated)])
    deviations = np.sqrt(np.maximum(np.diag(solution.inverse), 0.0))
    freedom = max(sum(fit.information.rows for fit in point.fits), 1.0)
    # Perfect sensors: the residual says how exact the values are, not the assumed noise.
    deviations *= min(1.0, float(np.sqrt(solution.residual_squares / freedom)))
    steps = np.abs(solution.values)
    return bool(np.all((steps <= of_deviations * deviations) | (steps <= of_values * values)))
