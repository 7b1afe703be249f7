# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Hysteretic states along a motion that is given by samples in time order."""

from collections.abc import Sequence
from typing import Any, TYPE_CHECKING

from identnl_ros.core.mechanics.element_laws import hysteresis_slope
from identnl_ros.core.mechanics.laws import LawKind
import numba
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from identnl_ros.core.mechanics.model import Model, Term

Reals = NDArray[np.float64]

# Largest change of state in one step of the integration, relative to limit / exponent.
LARGEST_CHANGE = 0.1
LARGEST_STEPS = 1000

_slope: Any = numba.njit(cache=True)(hysteresis_slope)


def hysteretic_terms(terms: Sequence['Term']) -> tuple[int, ...]:
    """
    Find the terms that have a hidden state.

    Parameters
    ----------
    terms : sequence of Term

    Returns
    -------
    tuple of int
        Their indices, in the order of the hidden states.

    """
    return tuple(i for i, term in enumerate(terms) if term.law.kind is LawKind.HYSTERESIS)


def hidden_motion(
    model: 'Model', displacement: Reals, velocity: Reals, initial: Reals | None = None
) -> Reals:
    """
    Follow the hysteretic states along a motion.

    A state depends on the path of the deformation, not on time. Between two samples the path is
    straight; where the rate changes its sign it turns at the extremum of a parabola. The time
    between samples that this takes follows from the motion itself: samples are equally spaced.

    Parameters
    ----------
    model : Model
    displacement, velocity : ndarray, shape (n_samples, n_coordinates)
        In time order. Where one is missing (NaN), the states remain.
    initial : ndarray, shape (n_hidden,), or None
        States at the first sample; None: zero.

    Returns
    -------
    ndarray, shape (n_samples, n_hidden)

    """
    terms = [model.terms[i] for i in hysteretic_terms(model.terms)]
    states = np.zeros((len(displacement), len(terms)))
    for column, term in enumerate(terms):
        deformation = displacement @ model.lines[term.line]
        rate = velocity @ model.lines[term.line]
        states[:, column] = _followed(
            deformation,
            _overshoots(deformation, rate),
            0.0 if initial is None else float(initial[column]),
            term.law.limit,
            term.law.exponent,
        )
    return states


def _overshoots(deformation: Reals, rate: Reals) -> Reals:
    """How far the path goes on from every sample before it turns; 0 where it does not turn."""
    found = np.zeros(len(deformation))
    change, before, after = np.diff(deformation), rate[:-1], rate[1:]
    onward = (before * after > 0) & np.isfinite(change)
    passed = np.abs(before + after)[onward].sum() / 2
    if not passed > 0:
        return found
    interval = np.abs(change[onward]).sum() / passed
    turning = before * after < 0
    # Constant acceleration: the velocity is zero after this part of the interval.
    part = before[turning] / (before - after)[turning]
    found[:-1][turning] = before[turning] * part * interval / 2
    return found


def _move(state: float, change: float, limit: float, exponent: float) -> float:
    # Classical Runge-Kutta method along a straight path.
    if change == 0.0:
        return state
    steps = int(min(LARGEST_STEPS, 1 + abs(change) * exponent / (LARGEST_CHANGE * limit)))
    step = change / steps
    for _ in range(steps):
        first = _slope(step, state, limit, exponent)
        second = _slope(step, state + 0.5 * step * first, limit, exponent)
        third = _slope(step, state + 0.5 * step * second, limit, exponent)
        fourth = _slope(step, state + step * third, limit, exponent)
        state += step * (first + 2.0 * second + 2.0 * third + fourth) / 6.0
    return state


_moved: Any = numba.njit(cache=True)(_move)


def _follow(
    deformation: Reals, overshoot: Reals, state: float, limit: float, exponent: float
) -> Reals:
    result = np.empty(deformation.size)
    for i in range(deformation.size):
        result[i] = state
        if i + 1 == deformation.size:
            break
        change = deformation[i + 1] - deformation[i]
        if not np.isfinite(change):
            continue
        beyond = overshoot[i] if np.isfinite(overshoot[i]) else 0.0
        state = _moved(state, beyond, limit, exponent)
        state = _moved(state, change - beyond, limit, exponent)
    return result


_followed: Any = numba.njit(cache=True)(_follow)
