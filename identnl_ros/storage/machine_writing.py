# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Machines as text of a machine file, with the numbers that an identification has found."""

from collections.abc import Mapping
import math

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.elements import Element, ELEMENT_KINDS
from identnl_ros.core.mechanics.joints import frame_about, GROUND, Joint, Slideway, SpringDamper
from identnl_ros.core.mechanics.machine import (
    Body,
    ConstantForce,
    DEGREES_OF_FREEDOM,
    ExcitationPoint,
    Machine,
)
from identnl_ros.core.mechanics.periodic_force import COSINE, FREQUENCY, PeriodicForce, SINE
from identnl_ros.core.mechanics.slideway import REFERENCE_DEFORMATION
from identnl_ros.core.mechanics.ties import declared_numbers, roots_of, with_inner_ties
from identnl_ros.storage.machine_file import read_machine
from identnl_ros.storage.machine_places import AT
from identnl_ros.storage.quantities import ESTIMATE, SAME_AS, TIMES
from identnl_ros.storage.yaml_reading import KIND
from identnl_ros.storage.yaml_writing import Data, direction, Inline, number, vector, yaml_text
import numpy as np

_SAME_FRAME = 1e-12  # a slideway normalises its directions whenever it is copied
_GAUSS_POINTS = 4  # what the machine file takes where it says nothing


def machine_text(machine: Machine, values: Mapping[str, float], headline: str) -> str:
    """
    Write a machine as text of a machine file, all numbers bare SI.

    Where an estimated exponent of a slideway gets another value, the unit of its normal
    stiffness changes with it, and the number is converted: the force at 1 um remains. Where this
    leaves two numbers that are tied to each other with different units, the tie is written out
    as the number it stands for, and a comment says so.

    Parameters
    ----------
    machine : Machine
    values : mapping of str to float
        Of estimated parameters, by name, SI. An estimated parameter that is not in it or NaN
        keeps the number that it has in the machine.
    headline : str
        Comment on top, of any number of lines.

    Returns
    -------
    str

    Raises
    ------
    MachineError
        If the result is nothing that a machine file can say: a value is out of range, or a
        joint takes its place from no other one though its kind must.

    """
    numbers = _Numbers(machine, values)
    sections: dict[str, Data] = {'machine': machine.name}
    sections['rest'] = 'locked_in' if machine.gravity is None else 'computed'
    if machine.gravity is not None:
        sections['gravity'] = vector(machine.gravity)
    sections['bodies'] = {body.name: _body(body, numbers) for body in machine.bodies}
    sections['joints'] = {
        joint.name: _joint(joint, numbers, machine.joints) for joint in machine.joints
    }
    if machine.forces:
        sections['forces'] = {force.name: _force(force, numbers) for force in machine.forces}
    if machine.excitations:
        sections['excitations'] = {one.name: _excitation(one) for one in machine.excitations}
    text = yaml_text('\n'.join((headline, *numbers.remarks)).strip('\n'), sections)
    read_machine(text, f'machine {machine.name} as written')
    return text


class _Numbers:
    """Numbers of a machine as they are written."""

    def __init__(self, machine: Machine, values: Mapping[str, float]) -> None:
        machine = with_inner_ties(machine)
        self._declared = declared_numbers(machine)
        self._roots = roots_of(self._declared)
        self._values = values
        self._scales = {
            f'{joint.name}.normal_stiffness': self._scale(joint)
            for joint in machine.joints
            if isinstance(joint, Slideway)
        }
        self.remarks: list[str] = []

    def written(self, name: str, coefficient: Coefficient) -> Data:
        """Write a number that is known, to be estimated, or tied to another one."""
        tie = coefficient.tie
        if tie is None:
            value = self._value(name, coefficient)
        elif self._factor(name) == self._factor(tie.same_as):
            times = {} if tie.times == 1 else {TIMES: number(tie.times)}
            return Inline({SAME_AS: tie.same_as, **times})
        else:
            self.remarks.append(f'{name} was tied to {tie.same_as}; their units differ now.')
            value, coefficient = self._followed(name)
        if not coefficient.estimated:
            return number(self._factor(name) * value)
        if math.isnan(value):
            return ESTIMATE
        return Inline({ESTIMATE: number(self._factor(name) * value)})

    def _value(self, name: str, coefficient: Coefficient) -> float:
        """Present value, in the unit that the machine has it in."""
        found = self._values.get(name, math.nan) if coefficient.estimated else math.nan
        return coefficient.value if math.isnan(found) else float(found)

    def _followed(self, name: str) -> tuple[float, Coefficient]:
        """Value of a tied number, and what it follows in the end."""
        root = self._roots[name]
        coefficient = self._declared[root.name].coefficient
        return root.times * self._value(root.name, coefficient), coefficient

    def _factor(self, name: str) -> float:
        """Return what converts a number to the unit that it has in the file."""
        return self._scales.get(name, 1.0)

    def _scale(self, joint: Slideway) -> float:
        """Return what converts the normal stiffness to the unit of the present exponent."""
        exponent, _ = self._followed(f'{joint.name}.exponent')
        return float(REFERENCE_DEFORMATION ** (joint.exponent.value - exponent))


def _body(body: Body, numbers: _Numbers) -> Data:
    data: dict[str, Data] = {
        'mass': numbers.written(f'{body.name}.mass', body.mass),
        'centre_of_mass': vector(body.centre_of_mass),
    }
    if body.inertia is not None:
        data['inertia'] = [vector(row) for row in body.inertia]
    if body.degrees_of_freedom != DEGREES_OF_FREEDOM:
        data['degrees_of_freedom'] = list(body.degrees_of_freedom)
    return data


def _joint(joint: Joint, numbers: _Numbers, joints: tuple[Joint, ...]) -> Data:
    if isinstance(joint, Slideway):
        return _slideway(joint, numbers)
    if isinstance(joint, SpringDamper):
        return _springs(joint, numbers, joints)
    if isinstance(joint, Element):
        return _element(joint, numbers, joints)
    raise MachineError(f'joint {joint.name}: a machine file cannot describe the kind {joint.kind}')


def _place(joint: Joint) -> dict[str, Data]:
    return {'body': joint.body, 'to': joint.other_body, 'point': vector(joint.point)}


def _slideway(joint: Slideway, numbers: _Numbers) -> Data:
    kind = 'damping' if joint.damping_frequency is None else 'hysteretic_damping'
    data: dict[str, Data] = {
        KIND: joint.kind,
        **_place(joint),
        'normal': direction(joint.normal),
        'longitudinal': direction(joint.longitudinal),
        'length': number(joint.length),
        'width': number(joint.width),
        'law': 'coupled' if joint.coupled else 'decoupled',
    }
    for key, coefficient in (
        ('exponent', joint.exponent),
        ('preload', joint.preload),
        ('normal_stiffness', joint.normal_stiffness),
        ('tangential_stiffness', joint.tangential_stiffness),
        (f'normal_{kind}', joint.normal_damping),
        (f'tangential_{kind}', joint.tangential_damping),
    ):
        data[key] = numbers.written(f'{joint.name}.{key}', coefficient)
    if joint.damping_frequency is not None:
        data['damping_frequency'] = number(joint.damping_frequency)
    if joint.gauss_points != _GAUSS_POINTS:
        data['gauss_points'] = str(joint.gauss_points)
    return data


def _springs(joint: SpringDamper, numbers: _Numbers, joints: tuple[Joint, ...]) -> Data:
    kind = _spring_kind(joint)
    if kind == 'screw':
        return _screw(joint, numbers, joints)
    data: dict[str, Data] = {KIND: kind, **_place(joint)}
    if not np.array_equal(joint.axes, np.eye(3)):
        data |= {f'axis_{i + 1}': direction(joint.axes[:, i]) for i in range(2)}
    for key, coefficients in _spring_coefficients(joint).items():
        if coefficients or key == 'stiffness':
            data[key] = _list(f'{joint.name}.{key}', coefficients or (Coefficient(0.0),), numbers)
    return data


def _screw(joint: SpringDamper, numbers: _Numbers, joints: tuple[Joint, ...]) -> Data:
    at = None if _keeps_axes(joint) else _name_at(joint, joints)
    data: dict[str, Data] = {KIND: 'screw'}
    data |= _place(joint) | {'axis': direction(joint.axes[:, 0])} if at is None else {AT: at}
    for key in ('stiffness', 'damping'):
        (coefficient,) = getattr(joint, key) or (Coefficient(0.0),)
        data[key] = numbers.written(f'{joint.name}.{key}', coefficient)
    return data


def _list(name: str, coefficients: tuple[Coefficient, ...], numbers: _Numbers) -> Data:
    if len(coefficients) == 1:
        return [numbers.written(name, coefficients[0])]
    return [numbers.written(f'{name}_{i}', one) for i, one in enumerate(coefficients, 1)]


def _element(joint: Element, numbers: _Numbers, joints: tuple[Joint, ...]) -> Data:
    at = _name_at(joint, joints)
    if at is None:
        raise MachineError(
            f'joint {joint.name}: no slideway, pad, screw or six_spring acts between the same '
            f'bodies, at the same point and along the same axes; in a machine file a '
            f'{joint.kind} takes its place from one'
        )
    key = ELEMENT_KINDS[joint.kind].coefficient.key
    coefficients = {key: joint.coefficient, **joint.numbers}
    return {
        KIND: joint.kind,
        AT: at,
        'axis': str(joint.axis),
        **{key: numbers.written(f'{joint.name}.{key}', one) for key, one in coefficients.items()},
    }


def _force(force: ConstantForce | PeriodicForce, numbers: _Numbers) -> Data:
    periodic = isinstance(force, PeriodicForce)
    moment = isinstance(force, PeriodicForce) and force.moment
    kind = 'periodic_moment' if moment else 'periodic_force'
    data: dict[str, Data] = {KIND: kind} if periodic else {}
    data['body'] = force.body
    if force.reaction_body != GROUND:
        data['to'] = force.reaction_body
    if not moment:
        data['point'] = vector(force.point)
    data['direction'] = direction(force.direction)
    coefficients = (
        {COSINE: force.cosine, SINE: force.sine, FREQUENCY: force.frequency}
        if isinstance(force, PeriodicForce)
        else {'force': force.force}
    )
    for key, one in coefficients.items():
        data[key] = numbers.written(f'{force.name}.{key}', one)
    return data


def _excitation(point: ExcitationPoint) -> Data:
    data: dict[str, Data] = {'body': point.body, 'point': vector(point.point)}
    if point.reaction_body != GROUND:
        data['to'] = point.reaction_body
    if point.reaction_point is not None:
        data['to_point'] = vector(point.reaction_point)
    data['direction'] = direction(point.direction)
    data['amplitude'] = number(point.amplitude)
    data['frequency'] = number(point.frequency)
    data['band'] = vector(point.band)
    return data


def _spring_coefficients(joint: SpringDamper) -> dict[str, tuple[Coefficient, ...]]:
    return {
        'stiffness': joint.stiffness,
        'damping': joint.damping,
        'quadratic_stiffness': joint.quadratic_stiffness,
        'cubic_stiffness': joint.cubic_stiffness,
    }


def _spring_kind(joint: SpringDamper) -> str:
    """Kind of a joint, or the general one where it has more springs than its kind has."""
    counts = [len(coefficients) for coefficients in _spring_coefficients(joint).values()]
    fits = {'screw': max(counts[:2]) <= 1 and not any(counts[2:])}
    fits['pad'] = max(counts) <= 3
    return joint.kind if fits.get(joint.kind) else 'six_spring'


def _keeps_axes(joint: Joint) -> bool:
    """Whether a joint that is written with a place of its own is read with the same axes."""
    if not (isinstance(joint, SpringDamper) and _spring_kind(joint) == 'screw'):
        return not isinstance(joint, Element)
    chosen = frame_about(joint.axes[:, 0], f'joint {joint.name}')
    return bool(np.allclose(joint.axes, chosen, rtol=0, atol=_SAME_FRAME))


def _name_at(joint: Joint, joints: tuple[Joint, ...]) -> str | None:
    """Name of the joint with a place of its own that acts where this one does."""
    for other in joints:
        if (
            (other.body, other.other_body) == (joint.body, joint.other_body)
            and np.array_equal(other.point, joint.point)
            and np.allclose(other.axes, joint.axes, rtol=0, atol=_SAME_FRAME)
            and _keeps_axes(other)
        ):
            return other.name
    return None
