# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Generalised forces that hypothetical effects would add, along a given motion."""

from collections.abc import Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import AddedPart, ChangedMachine, Hypothesis
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.hidden_states import hidden_motion
from identnl_ros.core.mechanics.joints import Joint
from identnl_ros.core.mechanics.kinematics import body_motion
from identnl_ros.core.mechanics.machine import ConstantForce
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


class Features:
    """
    Forces per unit of the size of each hypothesis about the machine.

    Parameters
    ----------
    description : Description
        As assumed so far.
    model : Model
        Assembled from its machine, with the values that fit best.
    hypotheses : sequence of Hypothesis
        Of added parts and changed machines.

    """

    def __init__(
        self, description: Description, model: Model, hypotheses: Sequence[Hypothesis]
    ) -> None:
        self._model = model
        self._count = len(hypotheses)
        self._added: list[tuple[int, int]] = []
        self._changed: list[tuple[int, float, Model, Reals]] = []
        joints: list[Joint] = []
        forces: list[ConstantForce] = []
        for i, one in enumerate(hypotheses):
            if isinstance(one.effect, AddedPart):
                part = one.effect.part(
                    description, one.place, one.inner, Coefficient(0.0, True), f'part_{i}'
                )
                if isinstance(part, ConstantForce):
                    forces.append(part)
                else:
                    joints.append(part)
            elif isinstance(one.effect, ChangedMachine):
                unit = one.effect.unit_size(description, one.place)
                changed = assemble(one.applied(description, unit).machine)
                changed = _with_values_of(changed, model)
                transfer = _transfer(model, changed)
                self._changed.append((i, unit, changed, transfer))
        machine = replace(
            description.machine,
            joints=(*description.machine.joints, *joints),
            forces=(*description.machine.forces, *forces),
        )
        whole = assemble(machine)
        names = {f'part_{i}': i for i in range(self._count)}
        for column, index in enumerate(whole.estimated):
            owner = whole.parameters[index].name.split('.')[0]
            if owner in names:
                self._added.append((column, names[owner]))
        self._whole = whole
        self._derivatives = ForceDerivatives(whole)
        self._hidden: Reals | None = None

    def along(self, displacement: Reals, velocity: Reals, acceleration: Reals) -> Reals:
        """
        Evaluate along the next part of a motion, which begins with the last sample before.

        Parameters
        ----------
        displacement, velocity, acceleration : ndarray, shape (n_samples, n_coordinates)

        Returns
        -------
        ndarray, shape (n_samples, n_coordinates, n_hypotheses)
            Added to the right-hand side of the equations of motion [N, N m per unit].

        """
        result = np.zeros((*displacement.shape, self._count))
        hidden = hidden_motion(self._whole, displacement, velocity, self._hidden)
        self._hidden = hidden[-1]
        derivatives = self._derivatives.of_motion(displacement, velocity, acceleration, hidden)
        for column, place in self._added:
            result[:, :, place] = -derivatives[:, :, column]
        own = left_hand_side(self._model, displacement, velocity, acceleration)
        for place, unit, model, transfer in self._changed:
            motion = (one @ transfer.T for one in (displacement, velocity, acceleration))
            changed = left_hand_side(model, *motion) @ transfer
            result[:, :, place] = (own - changed) / unit
        return result


def left_hand_side(
    model: Model, displacement: Reals, velocity: Reals, acceleration: Reals
) -> Reals:
    """
    Evaluate inertia and joint forces minus constant loads, (1) of Berczynski et al. (2010).

    Parameters
    ----------
    model : Model
    displacement, velocity, acceleration : ndarray, shape (n_samples, n_coordinates)

    Returns
    -------
    ndarray, shape (n_samples, n_coordinates)
        [N, N m].

    """
    inertia = model.mass_diagonal() * acceleration
    return np.asarray(inertia + model.joint_force(displacement, velocity) - model.constant_load())


def _with_values_of(model: Model, other: Model) -> Model:
    values = model.values
    known = {one.name: one.value for one in other.parameters}
    changed = {one.name for one in model.parameters if one.inner}
    for i, one in enumerate(model.parameters):
        if one.name in known and one.name not in changed and not one.name.endswith('.mass'):
            values[i] = known[one.name]
    return model.with_values(values)


def _transfer(model: Model, changed: Model) -> Reals:
    """Find the coordinates of a changed machine from those of the present one."""
    motions = []
    for one in (model, changed):
        rows = [
            body_motion(one.machine, one.coordinates, body.name, body.centre_of_mass)
            for body in model.machine.bodies
        ]
        motions.append(np.vstack(rows))
    return np.asarray(np.linalg.lstsq(motions[1], motions[0], rcond=None)[0])
