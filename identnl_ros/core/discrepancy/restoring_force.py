# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Force of a joint along one of its axes: what a model says, and what the measurement leaves.

What a model leaves unexplained is a force on the bodies; as a force along an axis of a joint it is
the one that explains most of it, if all of it acts there.
"""

from dataclasses import dataclass

from identnl_ros.core.discrepancy.effect import Place
from identnl_ros.core.discrepancy.force_error import ForceError
from identnl_ros.core.mechanics.hidden_states import hidden_motion
from identnl_ros.core.mechanics.joints import Joint
from identnl_ros.core.mechanics.kinematics import joint_deformation
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class RestoringForce:
    """
    Force along (or about) an axis of a joint along a measured motion.

    Parameters
    ----------
    deformation, rate : ndarray, shape (n_samples,)
        [m, m/s] or [rad, rad/s].
    elastic : ndarray, shape (n_samples,)
        Force of the model at this deformation and at rest [N, N m].
    damping : ndarray, shape (n_samples,)
        What the rate adds to that [N, N m].
    missing : ndarray, shape (n_samples,)
        What the measurement adds to the model's force [N, N m].

    """

    deformation: Reals
    rate: Reals
    elastic: Reals
    damping: Reals
    missing: Reals


def restoring_force(model: Model, error: ForceError, place: Place) -> RestoringForce:
    """
    Reconstruct the force along an axis of a joint.

    Parameters
    ----------
    model : Model
    error : ForceError
        Of this model.
    place : Place
        Axis of a joint of its machine.

    Returns
    -------
    RestoringForce
        Of all joints at that place together.

    """
    host = _joint(model, place)
    rows = joint_deformation(model.machine, model.coordinates, host)
    own = {one.name for one in model.machine.joints if _is_at(one, host)}
    # What each line does along the axis of the joint.
    shares = (model.lines @ np.linalg.pinv(rows))[:, place.axis - 1]
    motion = error.motion
    deformation = motion.displacement @ model.lines.T
    rate = motion.velocity @ model.lines.T
    columns = model.hidden_columns
    states = hidden_motion(model, motion.displacement, motion.velocity) if columns else None
    elastic, damping = np.zeros(len(rate)), np.zeros(len(rate))
    for index, term in enumerate(model.terms):
        if model.line_joints[term.line] not in own:
            continue
        value = model.parameters[term.parameter].value * term.factor * shares[term.line]
        state = states[:, columns[index]] if states is not None and index in columns else None
        along, fast = deformation[:, term.line], rate[:, term.line]
        at_rest = value * term.law.force(along, np.zeros_like(fast), state, error.time)
        elastic += at_rest
        damping += value * term.law.force(along, fast, state, error.time) - at_rest
    row = rows[place.axis - 1]
    # Joint forces stand on the left-hand side of the equations of motion.
    missing = (error.unexplained / error.masses) @ row / (row @ (row / error.masses))
    return RestoringForce(
        motion.displacement @ row, motion.velocity @ row, elastic, damping, missing
    )


def residual_along(model: Model, error: ForceError, place: Place) -> tuple[float, float]:
    """
    Measure how much of the unexplained force may act along an axis of a joint.

    Parameters
    ----------
    model : Model
    error : ForceError
        Of this model.
    place : Place
        Axis of a joint of its machine.

    Returns
    -------
    residual, noise : float
        Strength of the part that acts there, and of what the sensors' noise makes of it, over the
        strength of the exciters [-]; 0 where nothing can move along the axis.

    """
    row = joint_deformation(model.machine, model.coordinates, _joint(model, place))[place.axis - 1]
    length = float(row @ (row / error.masses))
    if not length > 0:
        return 0.0, 0.0
    parts = [(one / error.masses) @ row for one in (error.unexplained, error.noise)]
    scale = np.sqrt(length * len(row)) * error.strength
    residual, noise = (float(np.sqrt(np.mean(one**2))) / scale for one in parts)
    return residual, noise


def _joint(model: Model, place: Place) -> Joint:
    return next(one for one in model.machine.joints if one.name == place.part)


def _is_at(joint: Joint, host: Joint) -> bool:
    """Tell whether a joint is at the place of another, in the same direction."""
    return (joint.body, joint.other_body) == (host.body, host.other_body) and bool(
        np.allclose(joint.point, host.point) and np.allclose(joint.axes, host.axes)
    )
