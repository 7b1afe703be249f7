# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Go over kept records until the simulation follows them as closely as it can."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from identnl_ros.core.algebra.information import Information, Solution
from identnl_ros.core.errors import MachineError
from identnl_ros.core.estimation.alternatives import alternatives_of
from identnl_ros.core.estimation.residual_statistics import ResidualStatistics
from identnl_ros.core.measurement.motion_record import MotionRecord
from identnl_ros.core.measurement.motion_weights import MotionWeights
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.weak.response_fit import FORCE_MARGIN, padded, ResponseFit, State
from identnl_ros.core.weak.weighting_function import WeightingFunction
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Samples that are simulated and factored at a time.
CHUNK = 512
PASSES = 25
HALVINGS = 8
# The last step may be this fraction of the standard errors, or of the values: sensors may be
# perfect.
SMALL_STEP = 0.02
SMALLEST_STEP = 1e-10
# Relative error of the values to start from, while a record is too short to tell them all.
START_ERROR = 0.1
# Power of the motion beyond that of the noise, in standard deviations of the latter.
STANDING_OUT = 6.0
# Half lengths of a test function: a period or two of the fastest motion.
SHORTEST_BEGINNING = 4
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
    def moves(self) -> bool:
        """Whether the motion stands out of the noise of its sensors."""
        table = self.record.part(self.first, self.end).bridged()
        tables = table.displacement, table.velocity, table.acceleration
        for kind, matrix in self.weights.matrices:
            white = tables[kind][table.valid] @ matrix.T
            count = len(white) // self.function.stride
            if not count:
                continue
            white = (white - white.mean(axis=0))[: count * self.function.stride]
            averages = white.reshape(count, self.function.stride, -1).mean(axis=1)
            power = self.function.stride * (averages**2).mean(axis=0).max(initial=0.0)
            if power > 1 + STANDING_OUT * np.sqrt(2 / count):
                return True
        return False

    @property
    def end(self) -> int:
        """Sample up to which the record is used: whole chunks, if there is one."""
        inside = max(len(self.record) - FORCE_MARGIN - self.first, 0)
        return self.first + (inside // CHUNK * CHUNK if inside >= CHUNK else inside)

    def beginning(self, length: int) -> 'WeighedRecord':
        """
        Cut the record so that no more than a number of samples is used.

        Parameters
        ----------
        length : int

        Returns
        -------
        WeighedRecord

        """
        return replace(self, record=self.record.part(0, self.first + length + FORCE_MARGIN))

    def initial_state(self) -> State:
        """
        Displacement and velocity at `first`, from a polynomial through the samples around it.

        Returns
        -------
        displacement, velocity : ndarray, shape (n_coordinates,)
        hidden : ndarray, shape (0,)
            Hysteretic states are not known.

        """
        unknown = np.zeros(0)
        table = self.record.displacement[: 2 * self.first + 1]
        valid = np.isfinite(table).all(axis=1)
        if not valid.any():
            return np.zeros(table.shape[1]), np.zeros(table.shape[1]), unknown
        time = np.arange(len(table)) / self.first - 1
        powers = np.vander(time[valid], min(DEGREE + 1, int(valid.sum())), increasing=True)
        terms = np.linalg.lstsq(powers, table[valid], rcond=None)[0]
        velocity = terms[1] if len(terms) > 1 else np.zeros(table.shape[1])
        return terms[0], velocity * self.record.sample_rate / self.first, unknown


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
    fits: list[ResponseFit]
    statistics: ResidualStatistics
    cost: float
    solution: Solution


def search(
    model: Model,
    records: Sequence[WeighedRecord],
    states: Sequence[State],
    memory: float | None = None,
    small_step: float = SMALL_STEP,
    prior: Information | None = None,
) -> Search:
    """
    Gauss-Newton with step halving on the likelihood of several records.

    Parameters
    ----------
    model : Model
        Values to start from.
    records : sequence of WeighedRecord
    states : sequence of tuple of ndarray
        Initial state of every record to start from.
    memory : float or None
        Time after which what was learned counts 1/e as much [s]; None: nothing is forgotten.
    small_step : float
        Step, in standard errors, at which to stop.
    prior : Information or None
        What else is known of the differences of the unknowns from the values to start from.

    Returns
    -------
    Search

    Raises
    ------
    MachineError
        If the values to start from cannot be simulated.

    """
    task = _Task(records, memory, model, prior)
    point = task.at(model, list(states))
    passes, reason = 1, f'no convergence in {PASSES} passes over the data'
    converged = False
    while passes < PASSES:
        if _steps_within(point, small_step, SMALLEST_STEP):
            converged, reason = True, ''
            break
        better, tried = _improved(point, task, PASSES - passes)
        passes += tried
        if better is None:
            # Where rounding is all that is left, no step improves.
            converged = _cannot_matter(point)
            reason = '' if converged else 'no step brings the simulation closer to the measurement'
            break
        point = better
    return Search(point.fits, point.statistics, converged, reason, passes)


def search_by_lengths(
    model: Model,
    records: Sequence[WeighedRecord],
    states: Sequence[State],
    memory: float | None = None,
    known: Information | None = None,
) -> Search:
    """
    Search from values that may be too rough for a simulation to follow a record to its end.

    The beginnings of the records come first, then twice as much and so on.

    Parameters
    ----------
    model, records, states, memory
        As in `search`.
    known : Information or None
        What is known of the differences of the unknowns from the values to start from.

    Returns
    -------
    Search

    Raises
    ------
    MachineError
        If the values to start from cannot be simulated.

    """
    with suppress(MachineError):
        present, beginning = _from_beginnings(model, records, list(states), memory, known)
        found = search(present, records, beginning, memory, SMALL_STEP, _at(present, model, known))
        if found.converged:
            return found
    return search(model, records, states, memory, SMALL_STEP, known)


def _at(present: Model, start: Model, known: Information | None) -> Information | None:
    """Express what is known about other values."""
    unknowns = list(start.estimated)
    offset = present.values[unknowns] - start.values[unknowns]
    if known is None:
        return None
    return known.shifted(padded(offset, len(unknowns), known.size - len(unknowns)))


def _from_beginnings(
    start: Model,
    records: Sequence[WeighedRecord],
    states: list[State],
    memory: float | None,
    known: Information | None,
) -> tuple[Model, list[State]]:
    """Improve values and initial states on ever longer beginnings of the records."""
    if known is None:
        # A short beginning does not tell all unknowns: the values to start from count too.
        sizes = START_ERROR * np.abs(start.values[list(start.estimated)])
        roots = np.diag(np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0))
        rows = np.column_stack((roots, np.zeros((len(sizes), len(alternatives_of(start))))))
        known = Information.empty(rows.shape[1]).with_rows(rows, np.zeros(len(sizes)))
    model = start
    longest = max(one.end - one.first for one in records)
    length = SHORTEST_BEGINNING * max(one.first for one in records)
    while length < longest:
        beginnings = [one.beginning(length) for one in records]
        prior = _at(model, start, known)
        found = search(model, beginnings, states, memory, SMALL_STEP, prior)
        if found.converged:
            model = found.fits[0].model
            states = [fit.initial_state for fit in found.fits]
        length *= 2
    return model, states


@dataclass(frozen=True)
class _Task:
    """What a search goes over: records, forgetting, and what was known before."""

    records: Sequence[WeighedRecord]
    memory: float | None
    start: Model
    prior: Information | None

    def at(self, model: Model, states: list[State]) -> _Point:
        """Simulate all records."""
        statistics = statistics_for(self.records[0])
        fits: list[ResponseFit] = []
        for one, state in zip(self.records, states, strict=True):
            fit = ResponseFit(model, one.weights, one.record.sample_rate, state)
            statistics.restart()
            fits.append(fit)
            for first in range(one.first, one.end, CHUNK):
                end = min(first + CHUNK, one.end)
                share = remembered(self.memory, end - first, one.record.sample_rate)
                if share < 1:
                    statistics.discount(share)
                    for earlier in fits:
                        earlier.tested = earlier.tested.discounted(share)
                deviation = fit.advance(one.record, first, end)
                statistics.add(deviation.values, one.weights.places, deviation.energy)
        cost = sum(float((fit.tested.factor[:, -1] ** 2).sum()) for fit in fits)
        total = joint_information(fits)
        if self.prior is not None:
            prior = _at(model, self.start, self.prior)
            assert prior is not None
            cost += float((prior.factor[:, -1] ** 2).sum())
            total = total.merged(prior)
        unknowns = len(model.estimated)
        solution = total.without(range(unknowns, total.size)).solve()
        return _Point(model, fits, statistics, cost, solution)


def remembered(memory: float | None, samples: int, sample_rate: float) -> float:
    """
    Find how much what was learned still counts.

    Parameters
    ----------
    memory : float or None
        Time after which it counts 1/e as much, not less than that of a `CHUNK` [s]; None: nothing
        is forgotten.
    samples : int
        That came since.
    sample_rate : float
        [Hz].

    Returns
    -------
    float
        Above 0, at most 1.

    """
    if memory is None:
        return 1.0
    return float(np.exp(-samples / max(memory * sample_rate, CHUNK)))


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
    return ResidualStatistics(3 * record.record.displacement.shape[1], record.function.stride)


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
        On differences of the unknowns from those values, and on the alternatives.

    """
    total = fits[0].unknowns
    for fit in fits[1:]:
        total = total.merged(fit.unknowns)
    return total


def _improved(point: _Point, task: _Task, passes: int) -> tuple[_Point | None, int]:
    """Step towards the solution, by halves where that is too far."""
    steps = [fit.difference(point.solution.values) for fit in point.fits]
    share = 1.0
    tried = 0
    unknowns = list(point.model.estimated)
    while tried < min(HALVINGS, passes):
        values = point.model.values
        values[unknowns] += share * point.solution.values
        states = [
            fit.moved_start(share * step) for fit, step in zip(point.fits, steps, strict=True)
        ]
        tried += 1
        try:
            new = task.at(point.model.with_values(values), states)
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
    freedom = max(sum(fit.tested.rows for fit in point.fits), 1.0)
    # Perfect sensors: the residual says how exact the values are, not the assumed noise.
    exactness = min(1.0, float(np.sqrt(solution.residual_squares / freedom)))
    deviations *= exactness
    steps = np.abs(solution.values)
    if np.all(steps <= of_values * values):
        return True
    # What the step will gain counts the initial states too, which may have far to go.
    fitted = len(steps) + sum(fit.states for fit in point.fits)
    gain = point.cost - solution.residual_squares
    return bool(
        np.all((steps <= of_deviations * deviations) | (steps <= of_values * values))
        and gain <= of_deviations**2 * fitted * max(exactness**2, np.finfo(float).eps)
    )
