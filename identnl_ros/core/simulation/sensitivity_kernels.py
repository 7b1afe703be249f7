# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled kernels of the sensitivities of a simulated motion.

The method of `integrator` in Nystrom's form: both the displacement and the
velocity at a stage are sums of the accelerations at earlier stages (Hairer, Norsett and Wanner,
Solving Ordinary Differential Equations I, section II.14). Differentiating the discrete equations
gives the linear ones integrated here, so the sensitivities are those of the computed motion, not
of the exact one. All arrays are C-contiguous.
"""

from identnl_ros.core.simulation.integrator import acceleration, NODES, STAGES
import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

Reals = NDArray[np.float64]

_A = DOP853.A[:STAGES, :STAGES]
# Weights of the accelerations at the stages: in the displacement, in the velocity.
_STAGE_WEIGHTS = np.ascontiguousarray(np.stack((_A @ _A, _A), axis=1))
_STEP_WEIGHTS = np.ascontiguousarray(np.stack((DOP853.B @ _A, DOP853.B)))


def _stage_states(
    displacement: Reals,
    velocity: Reals,
    hidden: Reals,
    step: float,
    inputs: Reals,
    *equations: Reals,
) -> tuple[Reals, Reals, Reals, Reals, Reals, Reals, Reals]:
    count, stages = inputs.shape[0], inputs.shape[1]
    n = displacement.size
    displacements = np.empty((count, stages, n))
    velocities = np.empty((count, stages, n))
    accelerated = np.empty((count, stages, n))
    hiddens = np.empty((count, stages, hidden.size))
    hidden_rates = np.empty((stages, hidden.size))
    position = displacement.copy()
    rate = velocity.copy()
    inside = hidden.copy()
    for index in range(count):
        for stage in range(stages):
            for i in range(n):
                change = 0.0
                growth = 0.0
                for earlier in range(stage):
                    change += _STAGE_WEIGHTS[stage, 0, earlier] * accelerated[index, earlier, i]
                    growth += _STAGE_WEIGHTS[stage, 1, earlier] * accelerated[index, earlier, i]
                displacements[index, stage, i] = position[i] + step * (
                    NODES[stage] * rate[i] + step * change
                )
                velocities[index, stage, i] = rate[i] + step * growth
            for i in range(hidden.size):
                growth = 0.0
                for earlier in range(stage):
                    growth += _STAGE_WEIGHTS[stage, 1, earlier] * hidden_rates[earlier, i]
                hiddens[index, stage, i] = inside[i] + step * growth
            acceleration(
                displacements[index, stage],
                velocities[index, stage],
                hiddens[index, stage],
                inputs[index, stage],
                accelerated[index, stage],
                hidden_rates[stage],
                equations,
            )
        for i in range(n):
            change = 0.0
            growth = 0.0
            for stage in range(stages):
                change += _STEP_WEIGHTS[0, stage] * accelerated[index, stage, i]
                growth += _STEP_WEIGHTS[1, stage] * accelerated[index, stage, i]
            position[i] += step * (rate[i] + step * change)
            rate[i] += step * growth
        for i in range(hidden.size):
            growth = 0.0
            for stage in range(stages):
                growth += _STEP_WEIGHTS[1, stage] * hidden_rates[stage, i]
            inside[i] += step * growth
    return displacements, velocities, accelerated, hiddens, position, rate, inside


def _variations(
    state: Reals,
    step: float,
    steps: int,
    slopes: Reals,
    lines: Reals,
    stiffness: Reals,
    damping: Reals,
    rate_slopes: Reals,
    rate_lines: Reals,
    inverse_mass: Reals,
    forcing: Reals,
    hidden_state: Reals,
    hidden_slopes: Reals,
    hidden_lines: Reals,
    hidden_pull: Reals,
) -> tuple[Reals, Reals, Reals]:
    count, stages = slopes.shape[0], slopes.shape[1]
    n = inverse_mass.size
    columns = state.shape[1]
    unknowns = forcing.shape[3]
    size = n * columns
    kept = np.empty((count // steps, 3 * n, columns))
    start = state.copy().reshape((2, size))
    place = np.empty((2 * n, columns))
    flat_place = place.reshape((2, size))
    sums = np.empty((2, size))
    accelerated = np.empty((stages, n, columns))
    flat_accelerated = accelerated.reshape((stages, size))
    tangent = np.empty((n, 2 * n))
    dampers = np.empty((n, n))
    inside = hidden_state.copy()
    inside_rates = np.empty((stages, inside.shape[0], columns))
    for i in range(n):
        for j in range(n):
            tangent[i, n + j] = -inverse_mass[i] * damping[i, j]
    for index in range(count):
        for stage in range(stages):
            if stage == 0:
                flat_place[:] = start
            else:
                np.dot(_STAGE_WEIGHTS[stage][:, :stage].copy(), flat_accelerated[:stage], sums)
                whole = NODES[stage] * step
                square = step * step
                for i in range(size):
                    flat_place[0, i] = start[0, i] + whole * start[1, i] + square * sums[0, i]
                    flat_place[1, i] = start[1, i] + step * sums[1, i]
            tangent[:, :n] = stiffness
            for line in range(lines.shape[0]):
                slope = slopes[index, stage, line]
                for i in range(n):
                    part = slope * lines[line, i]
                    if part != 0.0:
                        for j in range(n):
                            tangent[i, j] += part * lines[line, j]
            for i in range(n):
                for j in range(n):
                    tangent[i, j] *= -inverse_mass[i]
            if rate_lines.shape[0] > 0:
                dampers[:] = damping
                for line in range(rate_lines.shape[0]):
                    slope = rate_slopes[index, stage, line]
                    for i in range(n):
                        for j in range(n):
                            dampers[i, j] += slope * rate_lines[line, i] * rate_lines[line, j]
                for i in range(n):
                    for j in range(n):
                        tangent[i, n + j] = -inverse_mass[i] * dampers[i, j]
            np.dot(tangent, place, accelerated[stage])
            for i in range(n):
                for j in range(unknowns):
                    accelerated[stage, i, j] -= inverse_mass[i] * forcing[index, stage, i, j]
            for one in range(hidden_pull.size):
                by_rate, by_state = hidden_slopes[index, stage, one]
                for j in range(columns):
                    change = inside[one, j]
                    for earlier in range(stage):
                        weight = step * _STAGE_WEIGHTS[stage, 1, earlier]
                        change += weight * inside_rates[earlier, one, j]
                    inside_rates[stage, one, j] = by_state * change
                    for i in range(n):
                        accelerated[stage, i, j] -= (
                            inverse_mass[i] * hidden_pull[one] * hidden_lines[one, i] * change
                        )
                        inside_rates[stage, one, j] += (
                            by_rate * hidden_lines[one, i] * place[n + i, j]
                        )
            if stage == 0 and index % steps == 0:
                kept[index // steps, : 2 * n] = place
                kept[index // steps, 2 * n :] = accelerated[0]
        np.dot(_STEP_WEIGHTS, flat_accelerated, sums)
        for i in range(size):
            start[0, i] += step * (start[1, i] + step * sums[0, i])
            start[1, i] += step * sums[1, i]
        for stage in range(stages):
            weight = step * _STEP_WEIGHTS[1, stage]
            for one in range(hidden_pull.size):
                for j in range(columns):
                    inside[one, j] += weight * inside_rates[stage, one, j]
    return kept, start.reshape((2 * n, columns)), inside


stage_states = numba.njit(cache=True)(_stage_states)
variations = numba.njit(cache=True)(_variations)
