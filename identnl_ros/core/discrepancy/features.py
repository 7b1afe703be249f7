# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Generalised forces that hypothetical effects would add, along a given motion."""

from collections.abc import Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.circumstances import Course
from identnl_ros.core.discrepancy.effect import AddedForce, AddedPart, ChangedMachine, Hypothesis
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
    course : Course
        Of the record, with the description as assumed so far.
    hypotheses : sequence of Hypothesis
        Of added parts, added forces and changed machines.

    """

    def __init__(self, course: Course, hypotheses: Sequence[Hypothesis]) -> None:
        self._course = course
        self._series: list[list[tuple[Reals, Reals]]] = [[] for _ in hypotheses]
        self._whole: dict[int, Reals] = {}
        added = []
        for i, one in enumerate(hypotheses):
            if isinstance(one.effect, AddedPart):
                added.append((i, one, one.effect))
            elif isinstance(one.effect, AddedForce):
                self._series[i].append(one.effect.force(course, one.place, one.inner))
            elif isinstance(one.effect, ChangedMachine):
                self._whole[i] = self._change(one, one.effect)
        self._add_parts(added)

    def forces(self, chosen: Sequence[int], begin: int, end: int) -> Reals:
        """
        Evaluate some hypotheses over some samples.

        Parameters
        ----------
        chosen : sequence of int
            Places among the hypotheses.
        begin, end : int
            Samples.

        Returns
        -------
        ndarray, shape (end - begin, n_coordinates, n_chosen)
            Added to the right-hand side of the equations of motion [N, N m per unit].

        """
        coordinates = self._course.displacement.shape[1]
        result = np.zeros((len(chosen), coordinates, end - begin))
        for column, i in enumerate(chosen):
            for series, direction in self._series[i]:
                result[column] += direction[:, np.newaxis] * series[begin:end]
            if i in self._whole:
                result[column] += self._whole[i][begin:end].T
        return np.asarray(result.transpose(2, 1, 0))

    def _add_parts(self, added: Sequence[tuple[int, Hypothesis, AddedPart]]) -> None:
        """Evaluate parts all at once: as those of one machine."""
        course = self._course
        joints: list[Joint] = []
        forces: list[ConstantForce] = []
        for i, one, effect in added:
            part = effect.part(
                course.description, one.place, one.inner, Coefficient(0.0, True), f'part_{i}'
            )
            if isinstance(part, ConstantForce):
                forces.append(part)
            else:
                joints.append(part)
        machine = course.description.machine
        # Joints that are there already add nothing: their unknowns are none of these.
        whole = assemble(
            replace(machine, joints=(*machine.joints, *joints), forces=(*machine.forces, *forces))
        )
        names = {f'part_{i}': i for i, _, _ in added}
        owner = [
            names.get(whole.parameters[index].name.split('.')[0]) for index in whole.estimated
        ]
        hidden = hidden_motion(whole, course.displacement, course.velocity)
        lines = ForceDerivatives(whole).along_lines(
            course.displacement, course.velocity, hidden, course.time
        )
        for column, of_line in lines.items():
            place = owner[column]
            if place is not None:
                for line, series in of_line.items():
                    self._series[place].append((series, -whole.lines[line]))
        column_of = {index: column for column, index in enumerate(whole.estimated)}
        for load in whole.loads:
            place = owner[column_of[load.parameter]] if load.parameter in column_of else None
            if place is not None:
                self._series[place].append((np.ones(len(course.time)), load.vector))

    def _change(self, hypothesis: Hypothesis, effect: ChangedMachine) -> Reals:
        """
        Evaluate what a change of the machine's numbers changes, per unit.

        Joints that remain exert the same forces in the same physical motion, whatever the
        coordinates: they cancel.
        """
        course, model = self._course, self._course.model
        unit = effect.unit_size(course.description, hypothesis.place)
        before = course.description.machine
        after = hypothesis.applied(course.description, unit).machine
        kept = {id(one) for one in before.joints} & {id(one) for one in after.joints}
        described = assemble(before)
        sides = []
        for machine in (before, after):
            joints = tuple(one for one in machine.joints if id(one) not in kept)
            changed = assemble(replace(machine, joints=joints, forces=()))
            changed = _with_values_of(changed, model, described)
            transfer = _transfer(model, changed)
            moved = [
                one @ transfer.T
                for one in (course.displacement, course.velocity, course.acceleration)
            ]
            side = left_hand_side(changed, moved[0], moved[1], moved[2], course.time)
            sides.append(side @ transfer)
        return (sides[0] - sides[1]) / unit


def left_hand_side(
    model: Model,
    displacement: Reals,
    velocity: Reals,
    acceleration: Reals,
    time: Reals,
    hidden: Reals | None = None,
) -> Reals:
    """
    Evaluate inertia and joint forces minus loads, (1) of Berczynski et al. (2010).

    Parameters
    ----------
    model : Model
    displacement, velocity, acceleration : ndarray, shape (n_samples, n_coordinates)
    time : ndarray, shape (n_samples,)
        Since the begin of the stream [s].
    hidden : ndarray, shape (n_samples, n_hidden), or None
        Hysteretic states; None: they follow the motion, from zero at its first sample.

    Returns
    -------
    ndarray, shape (n_samples, n_coordinates)
        [N, N m].

    """
    inertia = model.mass_diagonal() * acceleration
    force = model.joint_force(displacement, velocity, hidden, time)
    return np.asarray(inertia + force - model.constant_load() - model.periodic_load(time))


def _with_values_of(model: Model, fitted: Model, described: Model) -> Model:
    """Carry fitted values over, but those that the effect itself has changed."""
    values = model.values
    known = {one.name: one.value for one in fitted.parameters}
    before = {one.name: one.value for one in described.parameters}
    for i, one in enumerate(model.parameters):
        if one.name in known and (one.value == before[one.name] or np.isnan(one.value)):
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
