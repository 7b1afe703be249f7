# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
How a simulated motion changes with the unknowns and with its initial state, step by step.

The linearised equations of motion are integrated at the sample instants by Newmark's method with
the parameters of Fox and Goodwin, fourth-order accurate where damping is light. The derivatives
so found serve as instruments of an estimate: errors in them cost a little of its efficiency,
never its consistency, as the motion itself is integrated by `identnl_ros.core.simulation`.
"""

from identnl_ros.core.force_derivatives import ForceDerivatives
from identnl_ros.core.model import Model
from identnl_ros.core.sensitivity import line_slopes
import numba
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

    Columns: the unknowns in the order of `Model.estimated`, then the initial displacements and
    the initial velocities.

    Parameters
    ----------
    model : Model
        At whose values the derivatives are taken.
    interval : float
        Between samples [s].

    """

    def __init__(self, model: Model, interval: float) -> None:
        self._interval = interval
        n = len(model.coordinates)
        self._unknowns = len(model.estimated)
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

    def advance(self, displacement: Reals, velocity: Reals, acceleration: Reals) -> Reals:
        """
        Follow the motion over a number of samples.

        Parameters
        ----------
        displacement, velocity, acceleration : ndarray, shape (n_samples + 1, n_coordinates)
            Of the simulated motion, from the present instant on; the last one is where the
            next call goes on.

        Returns
        -------
        ndarray, shape (n_samples, 3, n_coordinates, n_columns)
            Derivatives of displacement, velocity and acceleration.

        """
        model = self._model
        forcing = -self._derivatives.of_motion(displacement, velocity, acceleration)
        slopes, damping = line_slopes(model, displacement, velocity)
        stiffest = np.abs(slopes).max(axis=0)
        scale = 1 / np.sqrt(self._mass)
        lines = model.lines * scale
        largest = np.linalg.eigvalsh((lines.T * stiffest) @ lines)[-1]
        fast = self._interval * np.sqrt(largest) > STABLE_STEP
        return _newmark(
            self._state,
            np.ascontiguousarray(forcing),
            np.ascontiguousarray(slopes),
            np.ascontiguousarray(model.lines),
            self._mass,
            np.ascontiguousarray(damping),
            self._interval,
            UNCONDITIONALLY_STABLE if fast else FOURTH_ORDER,
        )


@numba.njit(cache=True)
def _newmark(state, forcing, slopes, lines, mass, damping, interval, beta):
    # state (3, n, columns) is overwritten; forcing (samples + 1, n, unknowns).
    samples = forcing.shape[0] - 1
    n, columns = state.shape[1], state.shape[2]
    unknowns = forcing.shape[2]
    result = np.empty((samples, 3, n, columns))
    displacement, velocity, acceleration = state[0], state[1], state[2]
    stiffness = np.empty((n, n))
    factor = np.empty((n, n))
    right = np.empty((n, columns))
    for sample in range(samples + 1):
        _stiffness(stiffness, slopes[sample], lines)
        # The acceleration now is that of displacement and velocity now, at the first sample;
        # afterwards the step brings all three.
        weight = 0.0 if sample == 0 else beta * interval * interval
        half = 0.0 if sample == 0 else 0.5 * interval
        if sample > 0:
            for i in range(n):
                for j in range(columns):
                    displacement[i, j] += interval * velocity[i, j] + interval * interval * (
                        0.5 - beta
                    ) * acceleration[i, j]
                    velocity[i, j] += half * acceleration[i, j]
        for i in range(n):
            for j in range(n):
                factor[i, j] = half * damping[i, j] + weight * stiffness[i, j]
            factor[i, i] += mass[i]
            for j in range(columns):
                right[i, j] = forcing[sample, i, j] if j < unknowns else 0.0
        for i in range(n):
            for k in range(n):
                spring = stiffness[i, k]
                damper = damping[i, k]
                for j in range(columns):
                    right[i, j] -= spring * displacement[k, j] + damper * velocity[k, j]
        _solve(factor, right)
        for i in range(n):
            for j in range(columns):
                acceleration[i, j] = right[i, j]
                displacement[i, j] += weight * right[i, j]
                velocity[i, j] += half * right[i, j]
        if sample < samples:
            result[sample] = state
    return result


@numba.njit(cache=True)
def _stiffness(stiffness, slopes, lines):
    n = lines.shape[1]
    stiffness[:] = 0.0
    for line in range(slopes.size):
        slope = slopes[line]
        if slope == 0.0:
            continue
        for i in range(n):
            part = slope * lines[line, i]
            if part == 0.0:
                continue
            for j in range(n):
                stiffness[i, j] += part * lines[line, j]


@numba.njit(cache=True)
def _solve(matrix, right):
    # Symmetric positive definite up to strong softening: elimination without pivoting.
    n, columns = right.shape
    for k in range(n):
        pivot = 1.0 / matrix[k, k]
        for i in range(k + 1, n):
            share = matrix[i, k] * pivot
            if share == 0.0:
                continue
            for j in range(k + 1, n):
                matrix[i, j] -= share * matrix[k, j]
            for j in range(columns):
                right[i, j] -= share * right[k, j]
    for k in range(n - 1, -1, -1):
        for i in range(k + 1, n):
            share = matrix[k, i]
            for j in range(columns):
                right[k, j] -= share * right[i, j]
        pivot = 1.0 / matrix[k, k]
        for j in range(columns):
            right[k, j] *= pivot
