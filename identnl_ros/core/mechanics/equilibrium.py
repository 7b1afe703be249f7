# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Static equilibrium of a machine under weight, preload and constant forces."""

from collections.abc import Callable
from dataclasses import replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

MAX_ITERATIONS = 200
# Out-of-balance force relative to the loads at which the equilibrium is accepted.
TOLERANCE = 1e-12
# Displacement tried where the stiffness at rest is zero [m] or [rad].
FIRST_PUSH = 1e-6


def static_equilibrium(model: Model) -> Vector:
    """
    Find the displacement at which joints, weights and constant forces balance.

    Newton's method with step halving; the load of a contact without preload, whose stiffness at
    rest is zero, is found from a small displacement in the direction of the load. Friction and
    hysteretic springs bear nothing at rest; periodic forces and drifting stiffness are left out.

    Parameters
    ----------
    model : Model
        All values known.

    Returns
    -------
    ndarray, shape (n_coordinates,)
        Zero where nothing acts at the reference configuration.

    Raises
    ------
    MachineError
        If a value is missing, or nothing holds the machine against its loads.

    """
    model.require_values()
    hysteretic = model.hidden_columns
    model = replace(
        model, terms=tuple(one for i, one in enumerate(model.terms) if i not in hysteretic)
    )
    load = model.constant_load()
    displacement = np.zeros(len(load))

    def unbalance(at: Vector) -> Vector:
        still = np.zeros((1, len(load)))
        return np.asarray(load - model.joint_force(at[np.newaxis], still, time=np.zeros(1))[0])

    mass = model.mass_diagonal()
    residual = unbalance(displacement)
    # Forces and moments on one footing: divide by the square root of the inertia.
    weight = 1 / np.sqrt(mass)
    accepted = TOLERANCE * max(
        float(np.linalg.norm(weight * load)),
        float(np.linalg.norm(weight * residual)),
    )
    if accepted == 0.0:
        return displacement
    for _ in range(MAX_ITERATIONS):
        size = float(np.linalg.norm(weight * residual))
        if size <= accepted:
            return displacement
        stiffness = weight[:, np.newaxis] * model.tangent_stiffness(displacement) * weight
        step = weight * np.linalg.lstsq(stiffness, weight * residual, rcond=1e-13)[0]
        left = weight * residual - stiffness @ (step / weight)
        if np.linalg.norm(left) > 1e-6 * size:
            # Nothing holds this part of the load here: a contact without preload, perhaps.
            push = weight * left
            step = step + FIRST_PUSH * push / np.abs(push).max()
        displacement, residual = _shortened(unbalance, displacement, step, weight, size)
    # Rounding may keep the last digits from balancing; that is still an equilibrium.
    if float(np.linalg.norm(weight * residual)) <= 1e3 * accepted:
        return displacement
    worst = model.coordinates[int(np.argmax(np.abs(weight * residual)))]
    raise MachineError(
        f'machine {model.machine.name}: no static equilibrium found; nothing holds '
        f'{worst.in_words} against its load, check joints and preload there'
    )


def _shortened(
    unbalance: Callable[[Vector], Vector],
    displacement: Vector,
    step: Vector,
    weight: Vector,
    size: float,
) -> tuple[Vector, Vector]:
    """Halve a Newton step until it reduces the unbalance."""
    for _ in range(40):
        trial = displacement + step
        residual = unbalance(trial)
        if float(np.linalg.norm(weight * residual)) < size:
            break
        step = step / 2
    return trial, residual
