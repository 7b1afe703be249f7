# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels of the linearised motion."""

import numba
import numpy as np


@numba.njit(cache=True)
def newmark(state, forcing, slopes, lines, mass, damping, interval, beta):
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
    interval : float
        [s].
    beta : float
        Parameter of Newmark's method; its other one is 1/2.

    Returns
    -------
    ndarray, shape (n_samples, 3, n, n_columns)

    """
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
