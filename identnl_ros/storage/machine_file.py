# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The machine file: bodies, joints, unmeasured forces and excitations of a machine as YAML."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, Self

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.joints import (
    Coefficient,
    frame_about,
    GROUND,
    Joint,
    Slideway,
    SpringDamper,
)
from identnl_ros.core.mechanics.machine import (
    Body,
    ConstantForce,
    DEGREES_OF_FREEDOM,
    ExcitationPoint,
    Machine,
    STANDARD_GRAVITY,
)
from identnl_ros.core.mechanics.periodic_force import PeriodicForce
from identnl_ros.core.mechanics.ties import declared_numbers, roots_of, with_inner_ties
from identnl_ros.storage.machine_elements import ElementKey
from identnl_ros.storage.machine_places import AT, Place, place_at, Placed
from identnl_ros.storage.quantities import (
    coefficients,
    Direction,
    direction,
    FREQUENCY,
    Frequency,
    Gravity,
    LENGTH,
    Position,
    Quantity,
    shown,
    Vector,
)
from identnl_ros.storage.yaml_reading import (
    Document,
    KeyProblem,
    KIND,
    located,
    Name,
    parse,
    read_text,
    StrictModel,
    with_kind,
)
import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    field_validator,
    model_validator,
    PlainValidator,
    ValidationInfo,
)

_FORCE = Quantity('N', 'a force such as "100 daN"')
_MOMENT = Quantity('N*m', 'a moment such as "2 N*m"')
_STIFFNESS = Quantity('N/m', 'a stiffness such as "15 daN/um"')
_MASS = Quantity('kg', 'a mass such as "900 kg"')
_INERTIA = Quantity('kg*m^2', 'a moment of inertia such as "190 kg*m^2"')
_EXPONENT = Quantity('', 'a number such as 2')
_DAMPING = Quantity('N*s/m', 'a damping such as "8e3 N*s/m"')

# Along axes 1 to 3, about axes 1 to 3.
_SPRING_QUANTITIES = {
    'stiffness': (
        *3 * (_STIFFNESS,),
        *3 * (Quantity('N*m', 'a rotational stiffness such as "1e6 N*m/rad"'),),
    ),
    'damping': (
        *3 * (_DAMPING,),
        *3 * (Quantity('N*m*s', 'a rotational damping such as "50 N*m*s/rad"'),),
    ),
    'quadratic_stiffness': (
        *3 * (Quantity('N/m^2', 'a quadratic stiffness such as "30 N/um^2"'),),
        *3 * (Quantity('N*m', 'a rotational quadratic stiffness such as "1e6 N*m/rad^2"'),),
    ),
    'cubic_stiffness': (
        *3 * (Quantity('N/m^3', 'a cubic stiffness such as "2 N/um^3"'),),
        *3 * (Quantity('N*m', 'a rotational cubic stiffness such as "1e6 N*m/rad^3"'),),
    ),
}
_PLACES = {'pad': 3, 'six_spring': 6}

# Words with which errors of the core begin, and where in the file that part is.
_SECTIONS = {
    'body': 'bodies',
    'joint': 'joints',
    'force': 'forces',
    'excitation': 'excitations',
}


def _whole(value: object) -> int:
    if not (isinstance(value, str) and value.isdecimal() and 0 < int(value[:3]) <= 20):
        raise ValueError(f'found {shown(value)}, expected a whole number from 1 to 20')
    return int(value[:3])


def _direction(value: object) -> Vector | None:
    return None if value is None else direction(value)


Length = Annotated[float, PlainValidator(LENGTH.number)]
Force = Annotated[float, PlainValidator(_FORCE.number)]
Mass = Annotated[Coefficient, PlainValidator(_MASS.coefficient)]
Stiffness = Annotated[Coefficient, PlainValidator(_STIFFNESS.coefficient)]
Damping = Annotated[Coefficient, PlainValidator(_DAMPING.coefficient)]
Preload = Annotated[Coefficient, PlainValidator(LENGTH.coefficient_with_start)]
Exponent = Annotated[Coefficient, PlainValidator(_EXPONENT.coefficient_with_start)]
Inertia = Annotated[Vector, PlainValidator(_INERTIA.matrix)]


class _Body(StrictModel):
    mass: Mass
    centre_of_mass: Position
    inertia: Inertia | None = None
    degrees_of_freedom: list[str] = Field(default_factory=lambda: list(DEGREES_OF_FREEDOM))

    def build(self, name: str) -> Body:
        return Body(
            name, self.mass, self.centre_of_mass, self.inertia, tuple(self.degrees_of_freedom)
        )


class _Springs(Placed):
    kind: Literal['pad', 'six_spring']
    axis_1: Direction | None = None
    axis_2: Direction | None = None
    stiffness: tuple[Coefficient, ...]
    damping: tuple[Coefficient, ...] = ()
    quadratic_stiffness: tuple[Coefficient, ...] = ()
    cubic_stiffness: tuple[Coefficient, ...] = ()

    @field_validator(*_SPRING_QUANTITIES, mode='plain')
    @classmethod
    def _read_springs(cls, value: object, info: ValidationInfo) -> tuple[Coefficient, ...]:
        places = _PLACES[info.data[KIND]]
        return coefficients(value, _SPRING_QUANTITIES[info.field_name or ''][:places])

    @model_validator(mode='after')
    def _check_axes(self) -> Self:
        if (self.axis_1 is None) != (self.axis_2 is None):
            raise ValueError('axis_1 and axis_2 belong together; give both, or none for x and y')
        return self

    def build(self, name: str, place: Place | None = None) -> SpringDamper:
        if place is None:
            place = _own_place(self, _axes(self.axis_1, self.axis_2))
        return SpringDamper(
            name,
            place.body,
            place.to,
            place.point,
            place.axes,
            self.stiffness,
            self.damping,
            self.quadratic_stiffness,
            self.cubic_stiffness,
            self.kind,
        )


class _Screw(Placed):
    kind: Literal['screw']
    axis: Annotated[Vector | None, PlainValidator(_direction)]
    stiffness: Stiffness
    damping: Damping

    @classmethod
    def frame_keys(cls) -> tuple[str, ...]:
        return (*super().frame_keys(), 'axis')

    def build(self, name: str, place: Place | None = None) -> SpringDamper:
        if place is None:
            assert self.axis is not None
            place = _own_place(self, frame_about(self.axis, f'joint {name}: axis'))
        return SpringDamper(
            name,
            place.body,
            place.to,
            place.point,
            place.axes,
            (self.stiffness,),
            (self.damping,),
            kind=self.kind,
        )


def _own_place(part: Placed, axes: Vector) -> Place:
    assert part.body is not None
    assert part.to is not None
    assert part.point is not None
    return Place(part.body, part.to, part.point, axes)


@dataclass(frozen=True)
class _Unread:
    """A contact stiffness whose unit follows from the exponent of another joint."""

    found: object


class _Slideway(StrictModel):
    kind: Literal['slideway']
    body: Name
    to: Name
    point: Position
    normal: Direction
    longitudinal: Direction
    length: Length
    width: Length
    law: Literal['decoupled', 'coupled'] = 'decoupled'
    exponent: Exponent = Coefficient(2.0)
    preload: Preload = Coefficient(0.0)
    normal_stiffness: Coefficient | _Unread
    tangential_stiffness: Stiffness
    normal_hysteretic_damping: Stiffness | None = None
    tangential_hysteretic_damping: Stiffness | None = None
    damping_frequency: Frequency | None = None
    normal_damping: Damping | None = None
    tangential_damping: Damping | None = None
    gauss_points: Annotated[int, PlainValidator(_whole)] = 4

    @field_validator('normal_stiffness', mode='plain')
    @classmethod
    def _read_normal_stiffness(cls, value: object, info: ValidationInfo) -> Coefficient | _Unread:
        exponent: Coefficient = info.data.get('exponent', Coefficient(2.0))
        return _Unread(value) if exponent.tie else _contact_stiffness(value, exponent.value)

    @model_validator(mode='after')
    def _check_damping(self) -> Self:
        hysteretic = (
            self.normal_hysteretic_damping,
            self.tangential_hysteretic_damping,
            self.damping_frequency,
        )
        viscous = self.normal_damping, self.tangential_damping
        given = [[value is not None for value in choice] for choice in (hysteretic, viscous)]
        if given not in ([[True] * 3, [False] * 2], [[False] * 3, [True] * 2]):
            raise ValueError(
                'give either normal_damping and tangential_damping [N*s/m], or '
                'normal_hysteretic_damping, tangential_hysteretic_damping [N/m] and '
                'damping_frequency [Hz]'
            )
        return self

    def build(self, name: str) -> Slideway:
        choices = (
            self.normal_hysteretic_damping,
            self.normal_damping,
            self.tangential_hysteretic_damping,
            self.tangential_damping,
        )
        normal_damping, tangential_damping = (one for one in choices if one is not None)
        return Slideway(
            name=name,
            body=self.body,
            other_body=self.to,
            point=self.point,
            normal=self.normal,
            longitudinal=self.longitudinal,
            length=self.length,
            width=self.width,
            normal_stiffness=Coefficient()
            if isinstance(self.normal_stiffness, _Unread)
            else self.normal_stiffness,
            tangential_stiffness=self.tangential_stiffness,
            normal_damping=normal_damping,
            tangential_damping=tangential_damping,
            damping_frequency=self.damping_frequency,
            exponent=self.exponent,
            preload=self.preload,
            coupled=self.law == 'coupled',
            gauss_points=self.gauss_points,
        )


class _Force(StrictModel):
    kind: Literal['constant_force']
    body: Name
    to: Name = GROUND
    point: Position
    direction: Direction
    force: Annotated[Coefficient, PlainValidator(_FORCE.coefficient)]

    def build(self, name: str) -> ConstantForce:
        return ConstantForce(name, self.body, self.point, self.direction, self.force, self.to)


class _PeriodicForce(StrictModel):
    kind: Literal['periodic_force']
    body: Name
    to: Name = GROUND
    point: Position
    direction: Direction
    cosine: Annotated[Coefficient, PlainValidator(_FORCE.coefficient)]
    sine: Annotated[Coefficient, PlainValidator(_FORCE.coefficient)]
    frequency: Annotated[Coefficient, PlainValidator(FREQUENCY.coefficient_with_start)]

    def build(self, name: str) -> PeriodicForce:
        return PeriodicForce(
            name,
            self.body,
            self.point,
            self.direction,
            self.cosine,
            self.sine,
            self.frequency,
            self.to,
        )


class _PeriodicMoment(StrictModel):
    kind: Literal['periodic_moment']
    body: Name
    to: Name = GROUND
    direction: Direction
    cosine: Annotated[Coefficient, PlainValidator(_MOMENT.coefficient)]
    sine: Annotated[Coefficient, PlainValidator(_MOMENT.coefficient)]
    frequency: Annotated[Coefficient, PlainValidator(FREQUENCY.coefficient_with_start)]

    def build(self, name: str) -> PeriodicForce:
        return PeriodicForce(
            name,
            self.body,
            np.zeros(3),
            self.direction,
            self.cosine,
            self.sine,
            self.frequency,
            self.to,
            moment=True,
        )


def _constant_by_default(data: object) -> object:
    """Let a force without a kind be a constant one."""
    return {KIND: 'constant_force', **data} if isinstance(data, dict) else data


class _Excitation(StrictModel):
    body: Name
    point: Position
    direction: Direction
    to: Name = GROUND
    to_point: Position | None = None
    amplitude: Force
    frequency: Frequency
    band: Annotated[tuple[float, float], PlainValidator(FREQUENCY.pair)]

    def build(self, name: str) -> ExcitationPoint:
        return ExcitationPoint(
            name,
            self.body,
            self.point,
            self.direction,
            self.to,
            self.to_point,
            self.amplitude,
            self.frequency,
            self.band,
        )


class _Machine(StrictModel):
    machine: Name
    rest: Literal['locked_in', 'computed'] = 'locked_in'
    gravity: Gravity | None = None
    bodies: dict[Name, _Body]
    joints: dict[
        Name,
        Annotated[
            _Springs | _Screw | _Slideway | ElementKey,
            Field(discriminator=KIND),
            BeforeValidator(with_kind),
        ],
    ]
    forces: dict[
        Name,
        Annotated[
            _Force | _PeriodicForce | _PeriodicMoment,
            Field(discriminator=KIND),
            BeforeValidator(_constant_by_default),
        ],
    ] = Field(default_factory=dict)
    excitations: dict[Name, _Excitation] = Field(default_factory=dict)

    @model_validator(mode='after')
    def _check_gravity(self) -> Self:
        if self.rest == 'locked_in' and self.gravity is not None:
            raise KeyProblem(
                'gravity',
                'found a value, but with "rest: locked_in" weight is balanced and has no '
                'effect; write "rest: computed" or leave gravity out',
            )
        return self

    def build(self) -> Machine:
        gravity = None
        if self.rest == 'computed':
            gravity = np.array(STANDARD_GRAVITY) if self.gravity is None else self.gravity
        return Machine(
            self.machine,
            bodies=tuple(part.build(name) for name, part in self.bodies.items()),
            joints=self._joints(),
            excitations=tuple(part.build(name) for name, part in self.excitations.items()),
            forces=tuple(part.build(name) for name, part in self.forces.items()),
            gravity=gravity,
        )

    def _joints(self) -> tuple[Joint, ...]:
        """Make the joints: first those with a place of their own."""
        placed: dict[str, Joint] = {
            name: part.build(name)
            for name, part in self.joints.items()
            if isinstance(part, _Slideway) or (isinstance(part, Placed) and part.at is None)
        }
        return tuple(
            placed[name] if name in placed else self._built_at(name, placed)
            for name in self.joints
        )

    def _built_at(self, name: str, placed: dict[str, Joint]) -> Joint:
        part = self.joints[name]
        assert not isinstance(part, _Slideway)
        assert part.at is not None
        try:
            place = place_at(part.at, placed, self.joints)
        except ValueError as error:
            raise MachineError(f'joint {name}: {AT}: {error}') from None
        return part.build(name, place)


@dataclass(frozen=True)
class MachineFile:
    """
    A machine and the text it was read from.

    Parameters
    ----------
    path : Path
    text : str
        Whole content; bags carry it, so that they stay readable when the file changes.
    machine : Machine

    """

    path: Path
    text: str
    machine: Machine


def load_machine(path: str | Path) -> MachineFile:
    """
    Read a machine file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    MachineFile

    Raises
    ------
    MachineError
        If the file cannot be read or does not describe a machine; names file, line and key.

    """
    path = Path(path)
    text = read_text(path, MachineError)
    return MachineFile(path, text, read_machine(text, str(path)))


def read_machine(text: str, where: str) -> Machine:
    """
    Read a machine from the text of a machine file.

    Parameters
    ----------
    text : str
    where : str
        Where the text comes from, for errors.

    Returns
    -------
    Machine

    Raises
    ------
    MachineError
        If the text does not describe a machine; names `where`, line and key.

    """
    document = parse(text, where, MachineError)
    model = document.validated(_Machine)
    with located(document, _SECTIONS):
        machine = with_inner_ties(model.build())
    machine = replace(
        machine, joints=tuple(_with_stiffness(joint, model, document) for joint in machine.joints)
    )
    with located(document, _SECTIONS):
        roots_of(declared_numbers(machine))
    return machine


def _with_stiffness(joint: Joint, model: _Machine, document: Document) -> Joint:
    """Read what could not be read before the joint's exponent was known."""
    stiffness = getattr(model.joints[joint.name], 'normal_stiffness', None)
    if not (isinstance(joint, Slideway) and isinstance(stiffness, _Unread)):
        return joint
    try:
        read = _contact_stiffness(stiffness.found, joint.exponent.value)
    except ValueError as error:
        path = ('joints', joint.name, 'normal_stiffness')
        raise document.problem(path, str(error)) from None
    return replace(joint, normal_stiffness=read)


def _contact_stiffness(value: object, exponent: float) -> Coefficient:
    power = '' if exponent == 1 else f'^{exponent:.12g}'
    quantity = Quantity(f'N/m{power}', f'a contact stiffness such as "380 daN/um{power}"')
    return quantity.coefficient(value)


def _axes(axis_1: Vector | None, axis_2: Vector | None) -> Vector:
    """Axes 1 to 3 as columns; those of the machine where none are given."""
    if axis_1 is None or axis_2 is None:
        return np.eye(3)
    first, second = (axis / (np.linalg.norm(axis) or 1.0) for axis in (axis_1, axis_2))
    return np.column_stack((first, second, np.cross(first, second)))
