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

from dataclasses import replace

from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.hidden_states import hidden_motion
from identnl_ros.core.mechanics.laws import SHARP_KINDS
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.line_slopes import line_slopes
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
    hidden_start : bool
        The response to the initial hysteretic states is wanted too.

    """

    def __init__(
        self, model: Model, interval: float, disturbances: int = 0, hidden_start: bool = False
    ) -> None:
        self._interval = interval
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
        self._mass = model.mass_diagonal()

    @property
    def present(self) -> Reals:
        """Derivatives of displacement and velocity now, shape (2, n_coordinates, n_columns)."""
        return self._state[:2]

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
        forcing = -self._derivatives.of_motion(displacement, velocity, acceleration, hidden)
        span = None
        if self._sharp is not None:
            forcing -= self._mean_sharp(self._sharp, displacement, velocity, acceleration)
            span = velocity * (self._interval / 2), acceleration * (self._interval / 2)
        if disturbance is not None:
            forcing = np.concatenate((forcing, disturbance), axis=2)
        found = line_slopes(model, displacement, velocity, hidden, span)
        slopes = found.stiffness
        stiffest = np.abs(slopes).max(axis=0)
        scale = 1 / np.sqrt(self._mass)
        lines = model.lines * scale
        largest = np.linalg.eigvalsh((lines.T * stiffest) @ lines)[-1]
        fast = self._interval * np.sqrt(largest) > STABLE_STEP
        derivatives: Reals = newmark(
            self._state,
            np.ascontiguousarray(forcing),
            np.ascontiguousarray(slopes),
            np.ascontiguousarray(model.lines),
            self._mass,
            np.ascontiguousarray(found.damping),
            np.ascontiguousarray(found.rate),
            found.rate_lines,
            self._inside,
            np.ascontiguousarray(found.hidden_slopes),
            found.hidden_lines,
            found.hidden_pull,
            self._interval,
            UNCONDITIONALLY_STABLE if fast else FOURTH_ORDER,
        )
        return derivatives

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
