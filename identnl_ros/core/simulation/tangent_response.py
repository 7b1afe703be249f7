# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
How a simulated motion changes with the unknowns and with its initial state, step by step.

The linearised equations of motion are integrated at the sample instants by Newmark's method with
the parameters of Fox and Goodwin, fourth-order accurate where damping is light. The derivatives
so found serve as instruments of an estimate: errors in them cost a little of its efficiency,
never its consistency, as the motion itself is integrated by `simulation`.
"""

from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.sensitivity import line_slopes
from identnl_ros.core.simulation.tangent_kernels import newmark
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

FOURTH_ORDER = 1.0 / 12.0
UNCONDITIONALLY_STABLE = 0.25
# Fourth-order steps are stable while step times frequency is below the square root of six.
STABLE_STEP = 2.2


class TangentResponse:
    """
    Derivatives of a motion, advanced along with it.

    Columns: the unknowns in the order of `Model.estimated`, disturbances, then the initial
    displacements and the initial velocities.

    Parameters
    ----------
    model : Model
        At whose values the derivatives are taken.
    interval : float
        Between samples [s].
    disturbances : int
        Further forces whose response is wanted.

    """

    def __init__(self, model: Model, interval: float, disturbances: int = 0) -> None:
        self._interval = interval
        n = len(model.coordinates)
        self._unknowns = len(model.estimated) + disturbances
        columns = self._unknowns + 2 * n
        self._state = np.zeros((3, n, columns))
        self._state[0, :, self._unknowns : self._unknowns + n] = np.eye(n)
        self._state[1, :, self._unknowns + n :] = np.eye(n)
        self._started = False
        self.use(model)

    def use(self, model: Model) -> None:
        """
        Go on with other values of the same unknowns.

        Parameters
        ----------
        model : Model

        """
        self._model = model
        self._derivatives = ForceDerivatives(model)
        self._mass = model.mass_diagonal()

    @property
    def present(self) -> Reals:
        """Derivatives of displacement and velocity now, shape (2, n_coordinates, n_columns)."""
        return self._state[:2]

    def advance(
        self,
        displacement: Reals,
        velocity: Reals,
        acceleration: Reals,
        disturbance: Reals | None = None,
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

        Returns
        -------
        ndarray, shape (n_samples, 3, n_coordinates, n_columns)
            Derivatives of displacement, velocity and acceleration.

        """
        model = self._model
        forcing = -self._derivatives.of_motion(displacement, velocity, acceleration)
        if disturbance is not None:
            forcing = np.concatenate((forcing, disturbance), axis=2)
        slopes, damping = line_slopes(model, displacement, velocity)
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
            np.ascontiguousarray(damping),
            self._interval,
            UNCONDITIONALLY_STABLE if fast else FOURTH_ORDER,
        )
        return derivatives
