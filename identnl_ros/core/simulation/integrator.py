# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled kernels of the time integration.

The `equations` of every function are the arrays of `equations.Equations`, in its order. Beside
displacement and velocity a machine has hidden states, one for every hysteretic element. Inputs
are the forces of exciters and periodic forces [N] and, last, the time [s]. All arrays are
C-contiguous.
"""

from identnl_ros.core.mechanics import element_laws, laws
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
_backlash = numba.njit(cache=True)(element_laws.backlash)
_bilinear = numba.njit(cache=True)(element_laws.bilinear)
_coulomb = numba.njit(cache=True)(element_laws.coulomb)
_stribeck = numba.njit(cache=True)(element_laws.stribeck)
_quadratic_damping = numba.njit(cache=True)(element_laws.quadratic_damping)
_hysteresis_slope = numba.njit(cache=True)(element_laws.hysteresis_slope)
_SIGNED_POWER = int(LawKind.SIGNED_POWER)
_CONTACT = int(LawKind.CONTACT)
_POLYNOMIAL = int(LawKind.POLYNOMIAL)
_BACKLASH = int(LawKind.BACKLASH)
_COULOMB = int(LawKind.COULOMB)
_STRIBECK = int(LawKind.STRIBECK)
_DRIFTING = int(LawKind.DRIFTING)


@numba.njit(cache=True)
def _acceleration(
    displacement, velocity, inputs, out,
    inverse_mass, stiffness, damping, load, lines, term_line, term_kind, term_numbers,
    directions,
):  # fmt: skip
    # Stiffness and damping are symmetric: rows serve as columns, and inner loops vectorise.
    n = displacement.size
    for i in range(n):
        out[i] = load[i]
    for j in range(directions.shape[0]):
        for i in range(n):
            out[i] += directions[j, i] * inputs[j]
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
        elif kind == _POLYNOMIAL:
            value = deformation**exponent
        elif kind == _BACKLASH:
            value = _backlash(deformation, preload)
        elif kind == _DRIFTING:
            value = deformation * inputs[-1]
        else:
            value = _bilinear(deformation, preload)
        value = coefficient * (value - rest)
        for i in range(n):
            out[i] -= lines[line, i] * value
    for i in range(n):
        out[i] *= inverse_mass[i]


@numba.njit(cache=True)
def _add_elements(
    velocity, hidden, out, hidden_out,
    inverse_mass, lines, rate_line, rate_kind, rate_numbers, hidden_line, hidden_numbers,
):  # fmt: skip
    # Apart from the other terms, which most machines have alone: those stay fast.
    n = velocity.size
    for term in range(rate_line.size):
        line = rate_line[term]
        rate = 0.0
        for i in range(n):
            rate += lines[line, i] * velocity[i]
        coefficient, transition, fading = rate_numbers[term]
        kind = rate_kind[term]
        if kind == _COULOMB:
            value = _coulomb(rate, transition)
        elif kind == _STRIBECK:
            value = _stribeck(rate, transition, fading)
        else:
            value = _quadratic_damping(rate)
        value *= coefficient
        for i in range(n):
            out[i] -= inverse_mass[i] * lines[line, i] * value
    for term in range(hidden_line.size):
        line = hidden_line[term]
        rate = 0.0
        for i in range(n):
            rate += lines[line, i] * velocity[i]
        coefficient, limit, exponent = hidden_numbers[term]
        hidden_out[term] = rate * _hysteresis_slope(rate, hidden[term], limit, exponent)
        value = coefficient * hidden[term]
        for i in range(n):
            out[i] -= inverse_mass[i] * lines[line, i] * value


@numba.njit(cache=True)
def acceleration(displacement, velocity, hidden, inputs, out, hidden_out, equations):
    """
    Evaluate the equations of motion at one state.

    Parameters
    ----------
    displacement, velocity : ndarray, shape (n,)
    hidden : ndarray, shape (n_hidden,)
    inputs : ndarray, shape (n_inputs,)
    out : ndarray, shape (n,)
        Overwritten by the acceleration.
    hidden_out : ndarray, shape (n_hidden,)
        Overwritten by the derivative of the hidden states.
    equations : tuple of arrays

    """
    _acceleration(displacement, velocity, inputs, out, *equations[:9])
    if equations[9].size > 0 or equations[12].size > 0:
        _add_elements(
            velocity, hidden, out, hidden_out, equations[0], equations[4], *equations[9:]
        )


@numba.njit(cache=True)
def _step(displacement, velocity, hidden, step, inputs, stages, equations):
    # In place; inputs at the stages, shape (STAGES, n_inputs).
    velocities, accelerations, stage_hidden, hidden_rates = stages
    n = displacement.size
    stage_displacement = np.empty(n)
    elements = equations[9].size + equations[12].size > 0
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
            stage_displacement, velocities[stage], inputs[stage], accelerations[stage],
            *equations[:9],
        )  # fmt: skip
        if elements:
            _combine(stage_hidden, hidden, step, _A[stage], hidden_rates, stage)
            _add_elements(
                velocities[stage], stage_hidden, accelerations[stage], hidden_rates[stage],
                equations[0], equations[4], *equations[9:],
            )  # fmt: skip
    for stage in range(STAGES):
        weight = step * _B[stage]
        for i in range(n):
            displacement[i] += weight * velocities[stage, i]
            velocity[i] += weight * accelerations[stage, i]
    _combine(hidden, hidden, step, _B, hidden_rates, STAGES)


@numba.njit(cache=True)
def _combine(out, start, step, weights, rates, count):
    for i in range(start.size):
        out[i] = start[i]
        for stage in range(count):
            out[i] += step * weights[stage] * rates[stage, i]


@numba.njit(cache=True)
def _stages(n, n_hidden):
    return (
        np.empty((STAGES, n)),
        np.empty((STAGES, n)),
        np.empty(n_hidden),
        np.empty((STAGES, n_hidden)),
    )


@numba.njit(cache=True)
def integrate(displacement, velocity, hidden, step, steps, inputs, *equations):
    """
    Integrate and keep the state every few steps.

    Parameters
    ----------
    displacement, velocity : ndarray, shape (n,)
        Initial state.
    hidden : ndarray, shape (n_hidden,)
        Initial hidden states.
    step : float
        [s].
    steps : int
        Steps from one kept state to the next.
    inputs : ndarray, shape (n_kept * steps, STAGES, n_inputs)
        At the stages of every step.
    *equations : arrays

    Returns
    -------
    displacements, velocities : ndarray, shape (n_kept, n)
        The first is the initial state.
    hiddens : ndarray, shape (n_kept, n_hidden)
    displacement, velocity : ndarray, shape (n,)
        State after the last step.
    hidden : ndarray, shape (n_hidden,)

    """
    n = displacement.size
    count = inputs.shape[0] // steps
    displacements = np.empty((count, n))
    velocities = np.empty((count, n))
    hiddens = np.empty((count, hidden.size))
    position = displacement.copy()
    rate = velocity.copy()
    inside = hidden.copy()
    stages = _stages(n, hidden.size)
    for index in range(count):
        displacements[index] = position
        velocities[index] = rate
        hiddens[index] = inside
        for part in range(steps):
            _step(position, rate, inside, step, inputs[index * steps + part], stages, equations)
    return displacements, velocities, hiddens, position, rate, inside


@numba.njit(cache=True)
def branch(displacements, velocities, hiddens, step, inputs, *equations):
    """
    Integrate a few steps from each of many states.

    Parameters
    ----------
    displacements, velocities : ndarray, shape (n_states, n)
    hiddens : ndarray, shape (n_states, n_hidden)
    step : float
        [s].
    inputs : ndarray, shape (n_states, n_steps, STAGES, n_inputs)
        At the stages of every step.
    *equations : arrays

    Returns
    -------
    displacements, velocities : ndarray, shape (n_states, n)
    hiddens : ndarray, shape (n_states, n_hidden)

    """
    positions = displacements.copy()
    rates = velocities.copy()
    insides = hiddens.copy()
    stages = _stages(positions.shape[1], insides.shape[1])
    for index in range(positions.shape[0]):
        for part in range(inputs.shape[1]):
            _step(
                positions[index], rates[index], insides[index], step, inputs[index, part], stages,
                equations,
            )  # fmt: skip
    return positions, rates, insides


@numba.njit(cache=True)
def accelerations(displacements, velocities, hiddens, inputs, *equations):
    """
    Evaluate the equations of motion at many states.

    Parameters
    ----------
    displacements, velocities : ndarray, shape (n_states, n)
    hiddens : ndarray, shape (n_states, n_hidden)
    inputs : ndarray, shape (n_states, n_inputs)
    *equations : arrays

    Returns
    -------
    ndarray, shape (n_states, n)

    """
    result = np.empty_like(displacements)
    rates = np.empty(hiddens.shape[1])
    for index in range(displacements.shape[0]):
        acceleration(
            displacements[index], velocities[index], hiddens[index], inputs[index],
            result[index], rates, equations,
        )  # fmt: skip
    return result
