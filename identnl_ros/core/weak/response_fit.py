# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Measured against simulated motion, linearised: one Gauss-Newton step of the likelihood, streamed.

The machine is simulated under the measured force. What the measured motion differs from the
simulated one is, to first order, linear in the errors of the unknowns and of the initial state;
the noise of the sensors enters it linearly too, and white. So the rows collected here have no
noise in the regressor, which is what biases regressions on the measured motion, and least squares
on them is efficient. After every part the simulation may go on with better values: its state moves
by what the derivatives say, and no sample is needed again.
"""

from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information, merge_by_name
from identnl_ros.core.errors import MachineError
from identnl_ros.core.estimation.alternatives import (
    add_readings,
    alternatives_of,
    Course,
    disturbances,
    slope,
)
from identnl_ros.core.measurement.motion_record import MotionRecord
from identnl_ros.core.measurement.motion_weights import MotionWeights
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.equations import initial_hidden
from identnl_ros.core.simulation.excitation import RecordedForce
from identnl_ros.core.simulation.sensitivity import STEP_LIMIT, VariedSimulation
from identnl_ros.core.simulation.simulation import STEP_LIMIT as EXACT_STEP_LIMIT
from identnl_ros.core.simulation.tangent_response import TangentResponse
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
# Displacement, velocity, hysteretic states; none of the latter where they are not known.
State = tuple[Reals, Reals, Reals]

# Samples of force around a part beyond which they do not matter to its interpolation.
FORCE_MARGIN = 40
# Beyond this nothing can be learned, and squares overflow soon.
LARGEST_DERIVATIVE = 1e60
# A state that is carried on may be uncertain by this much more, in standard errors of its parts:
# far less than what any data can tell, and far more than rounding.
CARRIED_ERROR = 1e-5
# A state at the limit of hysteresis is as often estimated a little above it as below. It may be
# where loading fades this many times as fast as at the limit.
BEYOND = 2.0


@dataclass(frozen=True)
class Deviation:
    """
    Measured less simulated motion, in units of the noise.

    Parameters
    ----------
    values : ndarray, shape (n_samples, n_channels)
        NaN where there is no valid measurement.
    derivatives : ndarray, shape (n_samples, n_channels, n_unknowns + n_states)
        Of the simulated motion by the unknowns and the initial state.
    energy : float
        Mean square of the simulated motion about its mean, in the same units.

    """

    values: Reals
    derivatives: Reals
    energy: float

    def after(self, difference: Reals) -> Reals:
        """
        Evaluate, to first order, what is left at other values.

        Parameters
        ----------
        difference : ndarray, shape (n_unknowns + n_states,)

        Returns
        -------
        ndarray, shape (n_samples, n_channels)

        """
        return np.asarray(self.values - self.derivatives @ difference)


class ResponseFit:
    """
    Simulation of one uninterrupted record and what its deviation says about the unknowns.

    Numbers that are taken as known have columns too (`alternatives`), to be tested: they are held
    at what is stated, and no estimate depends on them.

    Parameters
    ----------
    model : Model
        Values to linearise about.
    weights : MotionWeights
    sample_rate : float
        [Hz].
    state : tuple of ndarray
        Of the simulation at the first sample; hysteretic states are zero where none are given.

    """

    def __init__(
        self,
        model: Model,
        weights: MotionWeights,
        sample_rate: float,
        state: State,
    ) -> None:
        self.model = model
        self._weights = weights
        self._rate = sample_rate
        self._state = self.initial_state = *state[:2], initial_hidden(model, state[2])
        self.alternatives = alternatives_of(model)
        self._response = TangentResponse(
            model, 1 / sample_rate, len(self.alternatives), hidden_start=True
        )
        self._limit = EXACT_STEP_LIMIT if weights.quiet else STEP_LIMIT
        laws = [model.terms[i].law for i in model.hidden_columns]
        self._farthest = np.array([BEYOND ** (1 / law.exponent) * law.limit for law in laws])
        # About differences from the present values: unknowns, alternatives, the initial state.
        self.tested = Information.empty(self._begin_of_states + self.states)

    @property
    def values(self) -> Reals:
        """Of the unknowns, about which it is linearised."""
        return self.model.values[list(self.model.estimated)]

    @property
    def states(self) -> int:
        """Numbers of the initial state."""
        return sum(map(len, self._state))

    @property
    def information(self) -> Information:
        """On the unknowns and the initial state; alternatives are as stated."""
        return self.tested.without(range(len(self.model.estimated), self._begin_of_states))

    @property
    def unknowns(self) -> Information:
        """On the unknowns and the alternatives, whatever the initial state was."""
        return self.tested.marginalised(range(self._begin_of_states))

    @property
    def _begin_of_states(self) -> int:
        return len(self.model.estimated) + len(self.alternatives)

    def advance(self, record: MotionRecord, first: int, end: int) -> Deviation:
        """
        Take the next samples.

        Parameters
        ----------
        record : MotionRecord
            With `FORCE_MARGIN` samples around those to take, as far as there are any.
        first, end : int
            The samples to take.

        Returns
        -------
        Deviation

        Raises
        ------
        MachineError
            If the simulation grows beyond all bounds: the values are no good.

        """
        low, high = max(first - FORCE_MARGIN, 0), min(end + FORCE_MARGIN, len(record))
        simulation = VariedSimulation(
            self.model,
            tuple(RecordedForce(force, self._rate) for force in record.force[low:high].T),
            1 / self._rate,
            *self._state[:2],
            start=(first - low) / self._rate,
            step_limit=self._limit,
            sensitive=False,
            hidden=self._state[2],
            origin=float(record.time[low]),
        )
        varied = simulation.advance(end - first)
        motion = varied.motion
        self._state = simulation.displacement, simulation.velocity, simulation.hidden
        following = np.stack((*self._state[:2], motion[-1, 2]))
        whole = np.concatenate((motion, following[np.newaxis]))
        hidden = np.vstack((varied.hidden, simulation.hidden))
        self._response.time = float(record.time[first])
        course = self._course(whole, record, first, low, high)
        derivatives = self._response.advance(
            whole[:, 0], whole[:, 1], whole[:, 2], disturbances(self.alternatives, course), hidden
        )
        add_readings(derivatives, self.alternatives, course, len(self.model.estimated))
        if not np.abs(derivatives).max(initial=0.0) < LARGEST_DERIVATIVE:
            raise MachineError(
                f'machine {self.model.machine.name}: a small change of the unknowns grows without '
                'bound'
            )
        measured = record.displacement, record.velocity, record.acceleration
        parts = []
        energy = 0.0
        about = motion - motion.mean(axis=0)
        for begin, stop, matrices in self._weights.whitening(record, first, end):
            blocks, targets = [], []
            for kind, matrix in matrices:
                place = slice(first + begin, first + stop)
                targets.append((measured[kind][place] - motion[begin:stop, kind]) @ matrix.T)
                blocks.append(np.matmul(matrix, derivatives[begin:stop, kind]))
                energy += float(((about[begin:stop, kind] @ matrix.T) ** 2).sum())
            parts.append((np.concatenate(targets, axis=1), np.concatenate(blocks, axis=1)))
        values, table = (np.concatenate(part) for part in zip(*parts, strict=True))
        valid = np.isfinite(values).all(axis=1)
        if valid.any():
            regressor = table[valid].reshape(-1, self.tested.size)
            self.tested = self.tested.with_rows(regressor, values[valid].reshape(-1))
        unknowns = len(self.model.estimated)
        fitted = np.delete(table, slice(unknowns, self._begin_of_states), axis=2)
        return Deviation(values, fitted, energy / values.size)

    def _course(
        self, whole: Reals, record: MotionRecord, first: int, low: int, high: int
    ) -> Course:
        """Give a simulated stretch and the following instant to what is tested."""
        interval = 1 / self._rate
        place = slice(first - low, first - low + len(whole))
        force = record.force[low:high]
        slopes = slope(force, interval)[place]
        return Course(self.model, whole, force[place], slopes, interval)

    def padded(self, difference: Reals) -> Reals:
        """
        Complete a difference by the alternatives, which stay as stated.

        Parameters
        ----------
        difference : ndarray, shape (n_unknowns,) or (n_unknowns + n_states,)

        Returns
        -------
        ndarray, shape (n_unknowns + n_alternatives + ...,)

        """
        return padded(difference, len(self.model.estimated), len(self.alternatives))

    def carried_on(self, earlier: Information) -> 'ResponseFit':
        """
        Go on with the present state as the initial one.

        What is known of it follows from what is known of the unknowns and of the old one.

        Parameters
        ----------
        earlier : Information
            What else is known of the unknowns and alternatives, on differences from the present
            values.

        Returns
        -------
        ResponseFit

        """
        known = joined(self.tested, earlier)
        size, begin = known.size, self._begin_of_states
        tested = range(len(self.model.estimated), begin)
        # New state = effect of the unknowns and of the old state + an error next to nothing.
        effect = self._effect
        fitted = np.delete(effect, tested, axis=1)
        variance = np.einsum('ij,jk,ik->i', fitted, known.without(tested).solve().inverse, fitted)
        error = CARRIED_ERROR * np.sqrt(np.where(variance > 0, variance, 1.0))
        rows = np.column_stack((-effect, np.eye(len(effect)))) / error[:, np.newaxis]
        empty = Information.empty(size + len(effect))
        whole = joined(empty, known).with_rows(rows, np.zeros(len(effect)))
        kept = [*range(begin), *range(size, whole.size)]
        following = ResponseFit(self.model, self._weights, self._rate, self._state)
        following.tested = whole.marginalised(kept)
        return following

    def begun_at(self, difference: Reals) -> 'ResponseFit':
        """
        Begin at other values and another initial state, with nothing learned.

        Parameters
        ----------
        difference : ndarray, shape (n_unknowns + n_states,)
            From the present ones; this fit has not taken any samples yet.

        Returns
        -------
        ResponseFit

        Raises
        ------
        MachineError
            If a number leaves its range.

        """
        other = ResponseFit(self.model, self._weights, self._rate, self._state)
        other.move(difference)
        return other

    def difference(self, unknowns: Reals) -> Reals:
        """
        Complete a change of the unknowns by that of the initial state which then fits best.

        Parameters
        ----------
        unknowns : ndarray, shape (n_unknowns,)

        Returns
        -------
        ndarray, shape (n_unknowns + n_states,)

        """
        count = len(unknowns)
        table = self.tested.factor
        target = table[:, -1] - table[:, :count] @ unknowns
        states = table[:, self._begin_of_states : -1]
        lengths = np.linalg.norm(states, axis=0)
        lengths[lengths == 0] = 1.0
        state = np.linalg.lstsq(states / lengths, target, rcond=1e-11)[0] / lengths
        return self.feasible(np.concatenate((unknowns, state)))

    def feasible(self, difference: Reals) -> Reals:
        """
        Keep initial hysteretic states near their range, where they can be simulated.

        Parameters
        ----------
        difference : ndarray, shape (n_unknowns + n_states,)

        Returns
        -------
        ndarray, the same shape

        """
        hidden = self.initial_state[2]
        first = len(difference) - len(hidden)
        moved = np.clip(hidden + difference[first:], -self._farthest, self._farthest)
        return np.concatenate((difference[:first], moved - hidden))

    def moved_start(self, difference: Reals) -> State:
        """
        Evaluate another initial state.

        Parameters
        ----------
        difference : ndarray, shape (n_unknowns + n_states,)

        Returns
        -------
        tuple of ndarray

        """
        return self._moved(self.initial_state, difference[len(self.model.estimated) :])

    def move(self, difference: Reals) -> None:
        """
        Linearise about other values from now on.

        Parameters
        ----------
        difference : ndarray, shape (n_unknowns + n_states,)
            Of the unknowns and the initial state, from the present ones.

        Raises
        ------
        MachineError
            If a number leaves its range.

        """
        unknowns = len(self.model.estimated)
        values = self.model.values
        values[list(self.model.estimated)] += difference[:unknowns]
        self.model = self.model.with_values(values)
        self.initial_state = self.moved_start(difference)
        whole = self.padded(difference)
        self._state = self._moved(self._state, self._effect @ whole)
        self._response.use(self.model)
        self.tested = self.tested.shifted(whole)

    @property
    def _effect(self) -> Reals:
        """Derivatives of the present state, one column each of `tested`."""
        return np.concatenate((*self._response.present, self._response.present_hidden))

    def _moved(self, state: State, change: Reals) -> State:
        n = len(state[0])
        hidden = np.clip(state[2] + change[2 * n :], -self._farthest, self._farthest)
        return state[0] + change[:n], state[1] + change[n : 2 * n], hidden


def padded(difference: Reals, unknowns: int, alternatives: int) -> Reals:
    """
    Complete a difference by that of alternatives, which is zero.

    Parameters
    ----------
    difference : ndarray, shape (n_unknowns + ...,)
    unknowns, alternatives : int

    Returns
    -------
    ndarray, shape (n_unknowns + n_alternatives + ...,)

    """
    nothing = np.zeros(alternatives)
    return np.concatenate((difference[:unknowns], nothing, difference[unknowns:]))


def joined(information: Information, other: Information) -> Information:
    """
    Join with information on the first unknowns only.

    Parameters
    ----------
    information, other : Information
        On differences from the same values, the other one on no more of them.

    Returns
    -------
    Information

    """
    names = [str(i) for i in range(information.size)]
    return merge_by_name([(information, names), (other, names[: other.size])])[0]
