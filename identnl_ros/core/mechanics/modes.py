# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Small vibrations about a state of rest."""

from dataclasses import dataclass

from identnl_ros.core.mechanics.model import Model
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


def stiffest_state_matrix(model: Model, displacements: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Linearise the equations of motion, ``(q', q'') = matrix @ (q, q')``, on the stiff side.

    Parameters
    ----------
    model : Model
        All values known.
    displacements : ndarray, shape (n_states, n)
        Every spring is taken as stiff as in the stiffest of these states.

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
        slope = value * term.law.stiffness(deformation[:, term.line])
        # A power below one is infinitely stiff at a point, which no step can resolve.
        slopes[term.line] += np.abs(slope[np.isfinite(slope)]).max(initial=0.0)
    matrix = np.zeros((2 * n, 2 * n))
    matrix[:n, n:] = np.eye(n)
    matrix[n:, :n] = -inverse_mass * ((model.lines.T * slopes) @ model.lines)
    matrix[n:, n:] = -inverse_mass * model.damping_matrix()
    return matrix


def modes(model: Model, displacement: NDArray[np.float64]) -> tuple[Mode, ...]:
    """
    Find the modes of small vibrations, slowest first.

    Damping ratios are those of each mode alone (diagonal of the modal damping matrix).

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
