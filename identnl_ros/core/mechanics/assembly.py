# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""From the description of a machine to its equations of motion."""

from collections.abc import Mapping
from dataclasses import replace

from identnl_ros.core.mechanics.joints import Joint
from identnl_ros.core.mechanics.kinematics import (
    axes_of,
    body_motion,
    Coordinate,
    joint_deformation,
    relative_motion,
)
from identnl_ros.core.mechanics.machine import DEGREES_OF_FREEDOM, Machine
from identnl_ros.core.mechanics.model import InnerLink, Load, Model, Parameter, Term, Tied
from identnl_ros.core.mechanics.periodic_force import FREQUENCY, PeriodicForce
from identnl_ros.core.mechanics.ties import declared_numbers, roots_of, with_inner_ties
import numpy as np
from numpy.typing import NDArray


def assemble(machine: Machine, inner: Mapping[str, float] | None = None) -> Model:
    """
    Assemble the equations of motion of a machine.

    Parameters
    ----------
    machine : Machine
    inner : mapping of str to float, optional
        Present values of estimated preloads, exponents and other numbers inside laws, by name;
        by default those of the machine.

    Returns
    -------
    Model

    Raises
    ------
    MachineError
        If a number is tied to one that does not exist, has another unit or is itself, or a
        number inside a law is out of range.

    """
    machine = with_inner_ties(machine)
    coordinates = tuple(
        Coordinate(body.name, motion)
        for body in machine.bodies
        for motion in body.degrees_of_freedom
    )
    table = _ParameterTable(machine, inner or {})
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
        index, times = table.parameter(f'{body.name}.mass')
        mass_vectors.append((index, times * mass_vector))
        if machine.gravity is not None:
            motion = body_motion(machine, coordinates, body.name, body.centre_of_mass)[:3]
            loads.append(Load(times * machine.gravity @ motion, index))
    for force in machine.forces:
        motion = relative_motion(
            machine, coordinates, force.body, force.point, force.reaction_body, force.point
        )
        if isinstance(force, PeriodicForce):
            vector = force.direction @ (motion[3:] if force.moment else motion[:3])
            frequency = table.inner_links(force).get(FREQUENCY)
            for key, wave in force.waves(table.inner_values(force)):
                index, times = table.parameter(f'{force.name}.{key}')
                loads.append(Load(times * vector, index, wave, frequency))
        else:
            index, times = table.parameter(f'{force.name}.force')
            loads.append(Load(times * force.direction @ motion[:3], index))
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
        table.parameters,
        lines,
        line_joints,
        terms,
        rotary_inertia,
        tuple(mass_vectors),
        tuple(loads),
        excitation_directions,
        table.tied,
    )


class _ParameterTable:
    """Parameters of a machine, and what of its numbers follows which of them."""

    def __init__(self, machine: Machine, inner: Mapping[str, float]) -> None:
        self._numbers = declared_numbers(machine)
        self._roots = roots_of(self._numbers)
        self._inner = inner
        listed = [
            number
            for number in self._numbers.values()
            if number.coefficient.tie is None
            and (number.coefficient.estimated or not number.inner)
        ]
        self._indices = {number.name: index for index, number in enumerate(listed)}
        self.parameters = tuple(
            Parameter(
                number.name,
                number.symbol,
                number.unit,
                self._value(number.name),
                number.coefficient.estimated,
                number.inner,
            )
            for number in listed
        )
        self.tied = tuple(
            Tied(number.name, number.symbol, number.unit, *self.parameter(number.name))
            for number in self._numbers.values()
            if number.coefficient.tie is not None and self._follows(number.name)
        )

    def parameter(self, name: str) -> tuple[int, float]:
        """Index of the parameter that a number is or follows, and its factor."""
        root = self._roots[name]
        return self._indices[root.name], root.times

    def inner_values(self, part: Joint | PeriodicForce) -> dict[str, float]:
        """Present values of the inner parameters of a part, by key."""
        roots = {one.key: self._roots[f'{part.name}.{one.key}'] for one in part.inner}
        return {key: root.times * self._value(root.name) for key, root in roots.items()}

    def inner_links(self, part: Joint | PeriodicForce) -> dict[str, InnerLink]:
        """Parameters that the inner parameters of a part follow, by key."""
        return {
            one.key: InnerLink(one.key, *self.parameter(f'{part.name}.{one.key}'))
            for one in part.inner
            if self._follows(f'{part.name}.{one.key}')
        }

    def _follows(self, name: str) -> bool:
        """Whether a number is or follows a parameter, and is not known inside a law."""
        return self._roots[name].name in self._indices

    def _value(self, name: str) -> float:
        return self._inner.get(name, self._numbers[name].coefficient.value)


def _joint_lines(
    machine: Machine, coordinates: tuple[Coordinate, ...], table: _ParameterTable
) -> tuple[NDArray[np.float64], tuple[str, ...], tuple[Term, ...]]:
    lines: list[NDArray[np.float64]] = []
    line_joints: list[str] = []
    terms: list[Term] = []
    for joint in machine.joints:
        deformation = joint_deformation(machine, coordinates, joint)
        known_lines: dict[bytes, int] = {}
        links = table.inner_links(joint)
        for term in joint.terms(table.inner_values(joint)):
            parameter, times = table.parameter(f'{joint.name}.{term.key}')
            direction = term.direction.tobytes()
            if direction not in known_lines:
                known_lines[direction] = len(lines)
                lines.append(term.direction @ deformation)
                line_joints.append(joint.name)
            law = term.law
            if machine.gravity is None:
                # At rest the locked-in forces balance: only the change acts.
                law = replace(law, rest_force=float(law.force(np.zeros(1), np.zeros(1))[0]))
            terms.append(
                Term(
                    known_lines[direction],
                    law,
                    times * term.factor,
                    parameter,
                    tuple(links[key] for key in term.inner if key in links),
                    times * term.factor_slope,
                )
            )
    stacked = np.array(lines).reshape(len(lines), len(coordinates))
    return stacked, tuple(line_joints), tuple(terms)
