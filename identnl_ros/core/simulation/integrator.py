# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled kernels of the time integration.

The `equations` of every function are the arrays of `simulation.Equations`, in its
order. All arrays are C-contiguous.
"""

from identnl_ros.core.mechanics import laws
from identnl_ros.core.mechanics.laws import LawKind
import numba
import numpy as np
from scipy.integrate import DOP853

STAGES = DOP853.n_stages
NODES = np.ascontiguousarray(DOP853.C[:STAGES])
_A = np.ascontiguousarray(DOP853.A[:STAGES, :STAGES])
_B = np.ascontiguousarray(DOP853.B)

_signed_power = numba.njit(cache=True)(laws.signed_power)
_contact = numba.njit(cache=True)(laws.contact)
_SIGNED_POWER = int(LawKind.SIGNED_POWER)
_CONTACT = int(LawKind.CONTACT)


@numba.njit(cache=True)
def _acceleration(
    displacement, velocity, force, out,
    inverse_mass, stiffness, damping, load, lines, term_line, term_kind, term_numbers,
    directions,
):  # fmt: skip
    # Stiffness and damping are symmetric: rows serve as columns, and inner loops vectorise.
    n = displacement.size
    for i in range(n):
        out[i] = load[i]
    for j in range(force.size):
        for i in range(n):
            out[i] += directions[j, i] * force[j]
    for j in range(n):
        position = displacement[j]
        rate = velocity[j]
        for i in range(n):
            out[i] -= stiffness[j, i] * position + damping[j, i] * rate
    line = -1
    deformation = 0.0
    for term in range(term_line.size):
        if term_line[term] != line:
            line = term_line[term]
            deformation = 0.0
            for i in range(n):
                deformation += lines[line, i] * displacement[i]
        coefficient, exponent, preload, rest = term_numbers[term]
        kind = term_kind[term]
        if kind == _SIGNED_POWER:
            value = _signed_power(deformation, exponent, preload)
        elif kind == _CONTACT:
            value = _contact(deformation, exponent, preload)
        else:
            value = deformation**exponent
        value = coefficient * (value - rest)
        for i in range(n):
            out[i] -= lines[line, i] * value
    for i in range(n):
        out[i] *= inverse_mass[i]


@numba.njit(cache=True)
def _step(displacement, velocity, step, forces, stages, equations):
    # In place; forces at the stages, shape (STAGES, n_excitations).
    velocities, accelerations = stages
    n = displacement.size
    stage_displacement = np.empty(n)
    for stage in range(STAGES):
        for i in range(n):
            stage_displacement[i] = displacement[i]
            velocities[stage, i] = velocity[i]
        for earlier in range(stage):
            weight = step * _A[stage, earlier]
            if weight == 0.0:
                continue
            for i in range(n):
                stage_displacement[i] += weight * velocities[earlier, i]
                velocities[stage, i] += weight * accelerations[earlier, i]
        _acceleration(
            stage_displacement, velocities[stage], forces[stage], accelerations[stage],
            *equations,
        )  # fmt: skip
    for stage in range(STAGES):
        weight = step * _B[stage]
        for i in range(n):
            displacement[i] += weight * velocities[stage, i]
            velocity[i] += weight * accelerations[stage, i]


@numba.njit(cache=True)
def integrate(displacement, velocity, step, steps, forces, *equations):
    """
    Integrate and keep the state every few steps.

    Parameters
    ----------
    displacement, velocity : ndarray, shape (n,)
        Initial state.
    step : float
        [s].
    steps : int
        Steps from one kept state to the next.
    forces : ndarray, shape (n_kept * steps, STAGES, n_excitations)
        At the stages of every step [N].
    *equations : arrays

    Returns
    -------
    displacements, velocities : ndarray, shape (n_kept, n)
        The first is the initial state.
    displacement, velocity : ndarray, shape (n,)
        State after the last step.

    """
    n = displacement.size
    count = forces.shape[0] // steps
    displacements = np.empty((count, n))
    velocities = np.empty((count, n))
    position = displacement.copy()
    rate = velocity.copy()
    stages = (np.empty((STAGES, n)), np.empty((STAGES, n)))
    for index in range(count):
        displacements[index] = position
        velocities[index] = rate
        for part in range(steps):
            _step(position, rate, step, forces[index * steps + part], stages, equations)
    return displacements, velocities, position, rate


@numba.njit(cache=True)
def branch(displacements, velocities, step, forces, *equations):
    """
    Integrate a few steps from each of many states.

    Parameters
    ----------
    displacements, velocities : ndarray, shape (n_states, n)
    step : float
        [s].
    forces : ndarray, shape (n_states, n_steps, STAGES, n_excitations)
        At the stages of every step [N].
    *equations : arrays

    Returns
    -------
    displacements, velocities : ndarray, shape (n_states, n)

    """
    positions = displacements.copy()
    rates = velocities.copy()
    n = positions.shape[1]
    stages = (np.empty((STAGES, n)), np.empty((STAGES, n)))
    for index in range(positions.shape[0]):
        for part in range(forces.shape[1]):
            _step(positions[index], rates[index], step, forces[index, part], stages, equations)
    return positions, rates


@numba.njit(cache=True)
def accelerations(displacements, velocities, forces, *equations):
    """
    Evaluate the equations of motion at many states.

    Parameters
    ----------
    displacements, velocities : ndarray, shape (n_states, n)
    forces : ndarray, shape (n_states, n_excitations)
        [N].
    *equations : arrays

    Returns
    -------
    ndarray, shape (n_states, n)

    """
    result = np.empty_like(displacements)
    for index in range(displacements.shape[0]):
        _acceleration(
            displacements[index], velocities[index], forces[index], result[index],
            *equations,
        )  # fmt: skip
    return result
