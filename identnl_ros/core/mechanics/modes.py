# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Small vibrations about a state of rest."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.mechanics.laws import RATE_KINDS
from identnl_ros.core.mechanics.model import Model, Term
import numpy as np
from numpy.typing import NDArray

# Below this fraction of the highest natural frequency a mode is a rigid-body motion.
RIGID_MODE = 1e-6


@dataclass(frozen=True)
class Mode:
    """
    One mode of vibration.

    Parameters
    ----------
    frequency : float
        Undamped natural frequency [Hz]; 0 for a motion that nothing holds.
    damping_ratio : float
        Fraction of critical damping [-]; NaN for a motion that nothing holds.

    """

    frequency: float
    damping_ratio: float


def stiffest_state_matrix(
    model: Model,
    displacements: NDArray[np.float64],
    velocities: NDArray[np.float64] | None = None,
    time: float = 0.0,
) -> NDArray[np.float64]:
    """
    Linearise the equations of motion, ``(q', q'') = matrix @ (q, q')``, on the stiff side.

    Parameters
    ----------
    model : Model
        All values known.
    displacements : ndarray, shape (n_states, n)
        Every spring is taken as stiff as in the stiffest of these states.
    velocities : ndarray, shape (n_states, n), or None
        Every damper is taken as steep as in the steepest of these states, friction as at
        standstill, which it passes between them; None: at rest.
    time : float
        At which stiffness that drifts is taken, since the begin of the stream [s].

    Returns
    -------
    ndarray, shape (2 n, 2 n)

    """
    inverse_mass = 1 / model.mass_diagonal()[:, np.newaxis]
    n = len(inverse_mass)
    deformation = displacements @ model.lines.T
    slopes = np.zeros(len(model.lines))
    for term in model.terms:
        value = model.parameters[term.parameter].value * term.factor
        slope = value * term.law.stiffness(deformation[:, term.line], time=time)
        # A power below one is infinitely stiff at a point, which no step can resolve.
        slopes[term.line] += np.abs(slope[np.isfinite(slope)]).max(initial=0.0)
    matrix = np.zeros((2 * n, 2 * n))
    matrix[:n, n:] = np.eye(n)
    matrix[n:, :n] = -inverse_mass * ((model.lines.T * slopes) @ model.lines)
    damping = model.damping_matrix()
    varying = [term for term in model.terms if term.law.kind in RATE_KINDS]
    if varying:
        still = np.zeros((1, n))
        rates = still if velocities is None else np.vstack((still, velocities))
        damping += _steepest_damping(model, varying, rates)
    matrix[n:, n:] = -inverse_mass * damping
    return matrix


def _steepest_damping(
    model: Model, terms: Sequence[Term], velocities: NDArray[np.float64]
) -> NDArray[np.float64]:
    slopes = np.zeros(len(model.lines))
    rates = velocities @ model.lines.T
    for term in terms:
        value = model.parameters[term.parameter].value * term.factor
        slopes[term.line] += np.abs(value * term.law.rate_slope(rates[:, term.line])).max()
    steepest: NDArray[np.float64] = (model.lines.T * slopes) @ model.lines
    return steepest


def modes(model: Model, displacement: NDArray[np.float64]) -> tuple[Mode, ...]:
    """
    Find the modes of small vibrations, slowest first.

    Damping ratios are those of each mode alone (diagonal of the modal damping matrix) and of
    viscous damping alone: the share of friction depends on the amplitude.

    Parameters
    ----------
    model : Model
        All values known.
    displacement : ndarray, shape (n,)
        State of rest.

    Returns
    -------
    tuple of Mode
        As many as the machine has coordinates.

    """
    scale = 1 / np.sqrt(model.mass_diagonal())
    stiffness = scale[:, np.newaxis] * model.tangent_stiffness(displacement) * scale
    damping = scale[:, np.newaxis] * model.damping_matrix() * scale
    squares, shapes = np.linalg.eigh((stiffness + stiffness.T) / 2)
    omega = np.sqrt(np.maximum(squares, 0.0))
    modal_damping = np.einsum('ij,ik,kj->j', shapes, damping, shapes)
    return tuple(
        Mode(0.0, float('nan'))
        if one <= RIGID_MODE * omega[-1]
        else Mode(float(one / (2 * np.pi)), float(ratio / (2 * one)))
        for one, ratio in zip(omega, modal_damping, strict=True)
    )
