# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
How a simulated motion changes with the unknowns and with its initial state, step by step.

The linearised equations of motion are integrated at the sample instants by Newmark's method with
the parameters of Fox and Goodwin, fourth-order accurate where damping is light. The derivatives
so found serve as instruments of an estimate: errors in them cost a little of its efficiency,
never its consistency, as the motion itself is integrated by `simulation`. Forces that bend sharply
within a sample, of friction and backlash, count with their mean over it.
"""

from dataclasses import dataclass, replace

from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.hidden_states import hidden_motion
from identnl_ros.core.mechanics.laws import SHARP_KINDS
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.line_slopes import line_slopes, LineSlopes
from identnl_ros.core.simulation.tangent_kernels import newmark
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

FOURTH_ORDER = 1.0 / 12.0
UNCONDITIONALLY_STABLE = 0.25
# Fourth-order steps are stable while step times frequency is below the square root of six.
STABLE_STEP = 2.2
# Places within a sample at which forces that bend sharply are averaged.
PLACES = (np.arange(8) - 3.5) / 8


@dataclass(frozen=True)
class LinearisedEquations:
    """
    Equations of motion linearised along a motion.

    Parameters
    ----------
    model : Model
    slopes : LineSlopes
        At every sample.
    interval : float
        Between samples [s].
    beta : float
        Parameter of Newmark's method.

    """

    model: Model
    slopes: LineSlopes
    interval: float
    beta: float

    def respond(
        self,
        state: Reals,
        forcing: Reals,
        inside: Reals | None = None,
        begin: int = 0,
        length: int = 1,
    ) -> Reals:
        """
        Integrate over a number of samples, many columns at once.

        Parameters
        ----------
        state : ndarray, shape (3, n_coordinates, n_columns)
            Displacement, velocity, acceleration; overwritten by those after the last sample.
        forcing : ndarray, shape (n_samples + 1, n_coordinates, n_forced)
            On the first columns; the others move freely [N, N m].
        inside : ndarray, shape (2, n_hidden, n_columns), or None
            Hysteretic states and their rates; overwritten. None: there are none.
        begin : int
            Sample of the motion at which the forcing begins.
        length : int
            Consecutive samples whose mean is wanted.

        Returns
        -------
        ndarray, shape (n_samples // length, 3, n_coordinates, n_columns)

        """
        part = slice(begin, begin + len(forcing))
        found = self.slopes
        if inside is None:
            inside = np.zeros((2, len(found.hidden_pull), state.shape[2]))
        responses: Reals = newmark(
            state,
            np.ascontiguousarray(forcing),
            np.ascontiguousarray(found.stiffness[part]),
            np.ascontiguousarray(self.model.lines),
            self.model.mass_diagonal(),
            np.ascontiguousarray(found.damping),
            np.ascontiguousarray(found.rate[part]),
            found.rate_lines,
            inside,
            np.ascontiguousarray(found.hidden_slopes[part]),
            found.hidden_lines,
            found.hidden_pull,
            self.interval,
            self.beta,
            length,
        )
        return responses


def linearise(
    model: Model,
    displacement: Reals,
    velocity: Reals,
    acceleration: Reals,
    hidden: Reals,
    interval: float,
    time: Reals | None = None,
) -> LinearisedEquations:
    """
    Linearise the equations of motion along a motion.

    Parameters
    ----------
    model : Model
    displacement, velocity, acceleration : ndarray, shape (n_samples, n_coordinates)
    hidden : ndarray, shape (n_samples, n_hidden)
    interval : float
        Between samples [s].
    time : ndarray, shape (n_samples,), or None
        Since the begin of the stream [s]; None where nothing depends on it.

    Returns
    -------
    LinearisedEquations

    """
    sharp = any(term.law.kind in SHARP_KINDS for term in model.terms)
    span = (velocity * (interval / 2), acceleration * (interval / 2)) if sharp else None
    slopes = line_slopes(model, displacement, velocity, hidden, span, time)
    stiffest = np.abs(slopes.stiffness).max(axis=0)
    lines = model.lines / np.sqrt(model.mass_diagonal())
    largest = np.linalg.eigvalsh((lines.T * stiffest) @ lines)[-1]
    fast = interval * np.sqrt(largest) > STABLE_STEP
    beta = UNCONDITIONALLY_STABLE if fast else FOURTH_ORDER
    return LinearisedEquations(model, slopes, interval, beta)


class TangentResponse:
    """
    Derivatives of a motion, advanced along with it.

    Columns: the unknowns in the order of `Model.estimated`, disturbances, then the initial
    displacements, the initial velocities and, if wanted, the initial hysteretic states.

    Parameters
    ----------
    model : Model
        At whose values the derivatives are taken.
    interval : float
        Between samples [s].
    disturbances : int
        Further forces whose response is wanted.
    start : float
        Time of the first sample since the begin of the stream [s].
    hidden_start : bool
        The response to the initial hysteretic states is wanted too.

    Attributes
    ----------
    time : float
        Time of the present sample since the begin of the stream [s]; may be set. Matters to
        periodic forces and to stiffness that drifts.

    """

    def __init__(
        self,
        model: Model,
        interval: float,
        disturbances: int = 0,
        start: float = 0.0,
        hidden_start: bool = False,
    ) -> None:
        self._interval = interval
        self.time = start
        n = len(model.coordinates)
        self._unknowns = len(model.estimated) + disturbances
        count = len(model.hidden_columns)
        columns = self._unknowns + 2 * n + (count if hidden_start else 0)
        self._state = np.zeros((3, n, columns))
        self._state[0, :, self._unknowns : self._unknowns + n] = np.eye(n)
        self._state[1, :, self._unknowns + n : self._unknowns + 2 * n] = np.eye(n)
        self._hidden: Reals | None = None
        self._inside = np.zeros((2, count, columns))
        if hidden_start:
            self._inside[0, :, self._unknowns + 2 * n :] = np.eye(count)
        self.use(model)

    def use(self, model: Model) -> None:
        """
        Go on with other values of the same unknowns.

        Parameters
        ----------
        model : Model

        """
        self._model = model
        sharp = tuple(term for term in model.terms if term.law.kind in SHARP_KINDS)
        smooth = tuple(term for term in model.terms if term.law.kind not in SHARP_KINDS)
        self._derivatives = ForceDerivatives(replace(model, terms=smooth) if sharp else model)
        self._sharp = (
            ForceDerivatives(replace(model, terms=sharp, mass_vectors=(), loads=()))
            if sharp
            else None
        )

    @property
    def present(self) -> Reals:
        """Derivatives of displacement and velocity now, shape (2, n_coordinates, n_columns)."""
        return self._state[:2]

    @property
    def latest(self) -> Reals:
        """Those of displacement, velocity and acceleration, shape (3, n_coordinates, ...)."""
        return self._state

    @property
    def present_hidden(self) -> Reals:
        """Derivatives of the hysteretic states now, shape (n_hidden, n_columns)."""
        state: Reals = self._inside[0]
        return state

    def advance(
        self,
        displacement: Reals,
        velocity: Reals,
        acceleration: Reals,
        disturbance: Reals | None = None,
        hidden: Reals | None = None,
    ) -> Reals:
        """
        Follow the motion over a number of samples.

        Parameters
        ----------
        displacement, velocity, acceleration : ndarray, shape (n_samples + 1, n_coordinates)
            Of the simulated motion, from the present instant on; the last one is where the
            next call goes on.
        disturbance : ndarray, shape (n_samples + 1, n_coordinates, n_disturbances), or None
            Generalised forces [N, N m].
        hidden : ndarray, shape (n_samples + 1, n_hidden), or None
            Hysteretic states along the motion, as simulated; None: they are found from the
            samples of the motion, from zero at its begin.

        Returns
        -------
        ndarray, shape (n_samples, 3, n_coordinates, n_columns)
            Derivatives of displacement, velocity and acceleration.

        """
        model = self._model
        if hidden is None:
            hidden = hidden_motion(model, displacement, velocity, self._hidden)
        self._hidden = hidden[-1]
        times: Reals = self.time + self._interval * np.arange(len(displacement), dtype=np.float64)
        self.time = float(times[-1])
        forcing = self.forcing(displacement, velocity, acceleration, hidden, times)
        if disturbance is not None:
            forcing = np.concatenate((forcing, disturbance), axis=2)
        linearised = linearise(
            model, displacement, velocity, acceleration, hidden, self._interval, times
        )
        derivatives: Reals = linearised.respond(self._state, forcing, self._inside)
        return derivatives

    def forcing(
        self,
        displacement: Reals,
        velocity: Reals,
        acceleration: Reals,
        hidden: Reals,
        time: Reals | None = None,
    ) -> Reals:
        """
        Give the forces by which errors of the unknowns disturb the motion.

        Parameters
        ----------
        displacement, velocity, acceleration : ndarray, shape (n_samples, n_coordinates)
        hidden : ndarray, shape (n_samples, n_hidden)
        time : ndarray, shape (n_samples,), or None
            Since the begin of the stream [s]; None where nothing depends on it.

        Returns
        -------
        ndarray, shape (n_samples, n_coordinates, n_unknowns)
            [N, N m per unit of each].

        """
        forcing = -self._derivatives.of_motion(displacement, velocity, acceleration, hidden, time)
        if self._sharp is not None:
            forcing -= self._mean_sharp(self._sharp, displacement, velocity, acceleration)
        return forcing

    def _mean_sharp(
        self, sharp: ForceDerivatives, displacement: Reals, velocity: Reals, acceleration: Reals
    ) -> Reals:
        """Average over a sample the derivatives of forces that bend sharply."""
        derivatives = [
            sharp.of_motion(
                displacement + shift * (velocity + shift / 2 * acceleration),
                velocity + shift * acceleration,
                acceleration,
            )
            for shift in PLACES * self._interval
        ]
        return np.asarray(np.mean(derivatives, axis=0))
