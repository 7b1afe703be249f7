# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Slopes of the joint forces along a motion: the linearised equations of motion."""

from dataclasses import dataclass

from identnl_ros.core.mechanics.element_laws import hysteresis_decay, hysteresis_slope
from identnl_ros.core.mechanics.laws import Law, LawKind, RATE_KINDS, SHARP_KINDS
from identnl_ros.core.mechanics.model import Model, Term
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class LineSlopes:
    """
    Derivatives of the joint forces by the state, at many states.

    Parameters
    ----------
    stiffness : ndarray, shape (n_states, n_lines)
        Slope of every line's force by its deformation [N/m or N m/rad].
    damping : ndarray, shape (n_coordinates, n_coordinates)
        Derivative of the generalised force by the velocity as far as it is constant.
    rate_lines : ndarray, shape (n_rate_lines, n_coordinates)
        Lines on which more damping acts, which varies.
    rate : ndarray, shape (n_states, n_rate_lines)
        Slope of the force of these lines by the rate [N s/m or N m s].
    hidden_lines : ndarray, shape (n_hidden, n_coordinates)
        Lines of the hysteretic terms.
    hidden_pull : ndarray, shape (n_hidden,)
        Force per hysteretic state [N/m or N m/rad].
    hidden_slopes : ndarray, shape (n_states, n_hidden, 2)
        Derivatives of the rate of a hysteretic state by the rate of its line and by itself.

    """

    stiffness: Reals
    damping: Reals
    rate_lines: Reals
    rate: Reals
    hidden_lines: Reals
    hidden_pull: Reals
    hidden_slopes: Reals


def line_slopes(
    model: Model,
    displacement: Reals,
    velocity: Reals,
    hidden: Reals,
    span: tuple[Reals, Reals] | None = None,
    time: Reals | None = None,
) -> LineSlopes:
    """
    Differentiate the joint forces by the state, at many states.

    Parameters
    ----------
    model : Model
    displacement, velocity : ndarray, shape (n_states, n_coordinates)
    hidden : ndarray, shape (n_states, n_hidden)
        Hysteretic states.
    span : pair of ndarray, each shape (n_states, n_coordinates), or None
        Half the change of displacement and of velocity from one state to the next. Where a law
        bends sharply, the slope is then the mean over that change rather than that at the state.
    time : ndarray, shape (n_states,), or None
        Since the begin of the stream [s]; needed where stiffness drifts.

    Returns
    -------
    LineSlopes

    Raises
    ------
    MachineError
        If the time is needed and not given.

    """
    time = model.times(time, len(displacement))
    deformation, rate = displacement @ model.lines.T, velocity @ model.lines.T
    changes = [0 * deformation] * 2 if span is None else [one @ model.lines.T for one in span]
    stiffness = np.zeros_like(deformation)
    rate_lines = sorted({term.line for term in model.terms if term.law.kind in RATE_KINDS})
    rates = np.zeros((len(deformation), len(rate_lines)))
    inside = [model.terms[index] for index in model.hidden_columns]
    for term in model.terms:
        value = model.parameters[term.parameter].value * term.factor
        line = term.line
        if term.law.kind in RATE_KINDS:
            slope = _rate_slope(term.law, rate[:, line], changes[1][:, line])
            rates[:, rate_lines.index(line)] += value * slope
        elif term.law.kind is not LawKind.HYSTERESIS:
            slope = _stiffness(term.law, deformation[:, line], changes[0][:, line], time)
            # A power below one is infinitely steep at a point, where it has no stiffness to add.
            stiffness[:, line] += value * np.where(np.isfinite(slope), slope, 0.0)
    return LineSlopes(
        stiffness,
        model.damping_matrix(),
        np.ascontiguousarray(model.lines[rate_lines]),
        rates,
        np.ascontiguousarray(model.lines[[term.line for term in inside]]),
        np.array([model.parameters[one.parameter].value * one.factor for one in inside]),
        _hidden_slopes(inside, rate, hidden),
    )


def _hidden_slopes(terms: list[Term], rate: Reals, hidden: Reals) -> Reals:
    slopes = np.empty((*hidden.shape, 2))
    for column, (term, state) in enumerate(zip(terms, hidden.T, strict=True)):
        numbers = rate[:, term.line], state, term.law.limit, term.law.exponent
        slopes[:, column, 0] = hysteresis_slope(*numbers)
        slopes[:, column, 1] = hysteresis_decay(*numbers)
    return slopes


def _stiffness(law: Law, deformation: Reals, change: Reals, time: Reals) -> Reals:
    slope = law.stiffness(deformation, time=time)
    if law.kind not in SHARP_KINDS or not change.any():
        return slope
    still = np.zeros_like(deformation)
    forces = [law.force(deformation + sign * change, still) for sign in (1, -1)]
    return _mean_slope(forces[0] - forces[1], 2 * change, slope)


def _rate_slope(law: Law, rate: Reals, change: Reals) -> Reals:
    slope = law.rate_slope(rate)
    if law.kind is LawKind.QUADRATIC_DAMPING or not change.any():
        return slope
    still = np.zeros_like(rate)
    forces = [law.force(still, rate + sign * change) for sign in (1, -1)]
    return _mean_slope(forces[0] - forces[1], 2 * change, slope)


def _mean_slope(difference: Reals, change: Reals, slope: Reals) -> Reals:
    large = np.abs(change) > 0
    return np.where(large, difference / np.where(large, change, 1.0), slope)
