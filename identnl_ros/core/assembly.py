# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""From the description of a machine to its equations of motion."""

from dataclasses import replace

from identnl_ros.core.joints import Coefficient
from identnl_ros.core.kinematics import (
    axes_of,
    body_motion,
    Coordinate,
    joint_deformation,
    relative_motion,
)
from identnl_ros.core.machine import DEGREES_OF_FREEDOM, Machine
from identnl_ros.core.model import Load, Model, Parameter, Term
import numpy as np
from numpy.typing import NDArray


def assemble(machine: Machine) -> Model:
    """
    Assemble the equations of motion of a machine.

    Parameters
    ----------
    machine : Machine

    Returns
    -------
    Model

    """
    coordinates = tuple(
        Coordinate(body.name, motion)
        for body in machine.bodies
        for motion in body.degrees_of_freedom
    )
    table = _ParameterTable()
    rotary_inertia = np.zeros(len(coordinates))
    mass_vectors = []
    loads = []
    for body in machine.bodies:
        moments, _ = axes_of(body)
        mass_vector = np.zeros(len(coordinates))
        for i, coordinate in enumerate(coordinates):
            if coordinate.body != body.name:
                continue
            axis = DEGREES_OF_FREEDOM.index(coordinate.motion)
            if axis < 3:
                mass_vector[i] = 1.0
            else:
                rotary_inertia[i] = moments[axis - 3]
        index = table.index(f'{body.name}.mass', 'm', 'kg', body.mass)
        mass_vectors.append((index, mass_vector))
        if machine.gravity is not None:
            motion = body_motion(machine, coordinates, body.name, body.centre_of_mass)[:3]
            loads.append(Load(machine.gravity @ motion, index))
    for force in machine.forces:
        index = table.index(f'{force.name}.force', 'F', 'N', force.force)
        vector = relative_motion(
            machine, coordinates, force.body, force.point, force.reaction_body, force.point
        )[:3]
        loads.append(Load(force.direction @ vector, index))
    lines, line_joints, terms = _joint_lines(machine, coordinates, table)
    excitation_directions = np.zeros((len(machine.excitations), len(coordinates)))
    for row, exciter in zip(excitation_directions, machine.excitations, strict=True):
        reaction = exciter.point if exciter.reaction_point is None else exciter.reaction_point
        row[:] = (
            exciter.direction
            @ relative_motion(
                machine, coordinates, exciter.body, exciter.point, exciter.reaction_body, reaction
            )[:3]
        )
    return Model(
        machine,
        coordinates,
        tuple(table.parameters),
        lines,
        line_joints,
        terms,
        rotary_inertia,
        tuple(mass_vectors),
        tuple(loads),
        excitation_directions,
    )


class _ParameterTable:
    """Parameters in order of first use, each once."""

    def __init__(self) -> None:
        self.parameters: list[Parameter] = []
        self._indices: dict[str, int] = {}

    def index(self, name: str, symbol: str, unit: str, coefficient: Coefficient) -> int:
        if name not in self._indices:
            self._indices[name] = len(self.parameters)
            self.parameters.append(
                Parameter(name, symbol, unit, coefficient.value, coefficient.estimated)
            )
        return self._indices[name]


def _joint_lines(
    machine: Machine, coordinates: tuple[Coordinate, ...], table: _ParameterTable
) -> tuple[NDArray[np.float64], tuple[str, ...], tuple[Term, ...]]:
    lines: list[NDArray[np.float64]] = []
    line_joints: list[str] = []
    terms: list[Term] = []
    for joint in machine.joints:
        deformation = joint_deformation(machine, coordinates, joint)
        known_lines: dict[bytes, int] = {}
        for term in joint.terms():
            parameter = table.index(
                f'{joint.name}.{term.key}', term.symbol, term.unit, term.coefficient
            )
            direction = term.direction.tobytes()
            if direction not in known_lines:
                known_lines[direction] = len(lines)
                lines.append(term.direction @ deformation)
                line_joints.append(joint.name)
            law = term.law
            if machine.gravity is None:
                # At rest the locked-in forces balance: only the change acts.
                law = replace(law, rest_force=float(law.force(np.zeros(1), np.zeros(1))[0]))
            terms.append(Term(known_lines[direction], law, term.factor, parameter))
    stacked = np.array(lines).reshape(len(lines), len(coordinates))
    return stacked, tuple(line_joints), tuple(terms)
