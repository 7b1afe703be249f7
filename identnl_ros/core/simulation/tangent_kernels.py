# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels of the linearised motion."""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def newmark(
    state, forcing, slopes, lines, mass, damping, rate_slopes, rate_lines,
    inside, hidden_slopes, hidden_lines, hidden_pull, interval, beta, length,
):  # fmt: skip
    """
    Integrate the linearised equations of motion of many columns at once.

    Parameters
    ----------
    state : ndarray, shape (3, n, n_columns)
        Displacement, velocity, acceleration; overwritten by those after the last step.
    forcing : ndarray, shape (n_samples + 1, n, n_unknowns)
        On the first columns; the others move freely.
    slopes : ndarray, shape (n_samples + 1, n_lines)
        Stiffness of every line.
    lines : ndarray, shape (n_lines, n)
    mass : ndarray, shape (n,)
    damping : ndarray, shape (n, n)
        The same at all samples.
    rate_slopes : ndarray, shape (n_samples + 1, n_rate_lines)
        Further damping, along lines; varies.
    rate_lines : ndarray, shape (n_rate_lines, n)
    inside : ndarray, shape (2, n_hidden, n_columns)
        Hysteretic states and their rates; overwritten by those after the last step.
    hidden_slopes : ndarray, shape (n_samples + 1, n_hidden, 2)
        Derivatives of the rate of a hysteretic state by the rate of its line and by itself.
    hidden_lines : ndarray, shape (n_hidden, n)
    hidden_pull : ndarray, shape (n_hidden,)
        Force per hysteretic state.
    interval : float
        [s].
    beta : float
        Parameter of Newmark's method; its other one is 1/2.
    length : int
        Consecutive samples whose mean is wanted.

    Returns
    -------
    ndarray, shape (n_samples // length, 3, n, n_columns)

    """
    samples = forcing.shape[0] - 1
    n, columns = state.shape[1], state.shape[2]
    unknowns = forcing.shape[2]
    result = np.zeros((samples // length, 3, n, columns))
    part = 1.0 / length
    displacement, velocity, acceleration = state[0], state[1], state[2]
    stiffness = np.empty((n, n))
    factor = np.empty((n, n))
    right = np.empty((n, columns))
    constant = damping
    damping = constant.copy()
    for sample in range(samples + 1):
        _stiffness(stiffness, slopes[sample], lines)
        if rate_lines.shape[0] > 0:
            _stiffness(damping, rate_slopes[sample], rate_lines)
            damping += constant
        # The acceleration now is that of displacement and velocity now, at the first sample;
        # afterwards the step brings all three.
        weight = 0.0 if sample == 0 else beta * interval * interval
        half = 0.0 if sample == 0 else 0.5 * interval
        if sample > 0:
            for i in range(n):
                for j in range(columns):
                    displacement[i, j] += (
                        interval * velocity[i, j]
                        + interval * interval * (0.5 - beta) * acceleration[i, j]
                    )
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
        for one in range(hidden_pull.size):
            _pull(
                factor, right, inside[:, one], velocity, hidden_slopes[sample, one],
                hidden_lines[one], hidden_pull[one], half,
            )  # fmt: skip
        _solve(factor, right)
        for i in range(n):
            for j in range(columns):
                acceleration[i, j] = right[i, j]
                displacement[i, j] += weight * right[i, j]
                velocity[i, j] += half * right[i, j]
        for one in range(hidden_pull.size):
            _follow(inside[:, one], velocity, hidden_slopes[sample, one], hidden_lines[one], half)
        if sample < samples // length * length:
            mean = result[sample // length]
            for order in range(3):
                for i in range(n):
                    for j in range(columns):
                        mean[order, i, j] += part * state[order, i, j]
    return result


@numba.njit(cache=True, nogil=True)
def _pull(factor, right, inside, velocity, slopes, line, pull, half):
    # The trapezoidal rule gives the hysteretic state from the velocity now, which is not known
    # before the acceleration is: its share goes to the left side.
    share = 1.0 / (1.0 - half * slopes[1])
    by_velocity = half * slopes[0] * share
    n, columns = right.shape
    for j in range(columns):
        state = (inside[0, j] + half * inside[1, j]) * share
        for k in range(n):
            state += by_velocity * line[k] * velocity[k, j]
        for i in range(n):
            right[i, j] -= pull * line[i] * state
    for i in range(n):
        for k in range(n):
            factor[i, k] += half * pull * by_velocity * line[i] * line[k]


@numba.njit(cache=True, nogil=True)
def _follow(inside, velocity, slopes, line, half):
    share = 1.0 / (1.0 - half * slopes[1])
    for j in range(velocity.shape[1]):
        rate = 0.0
        for k in range(line.size):
            rate += slopes[0] * line[k] * velocity[k, j]
        inside[0, j] = (inside[0, j] + half * (inside[1, j] + rate)) * share
        inside[1, j] = rate + slopes[1] * inside[0, j]


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
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
