# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Joints of the machine file that act along one axis of another joint: friction, backlash, ..."""

from typing import Annotated, Literal

from identnl_ros.core.mechanics.elements import ABOUT, ALONG, Element, ELEMENT_KINDS
from identnl_ros.core.mechanics.joints import Coefficient
from identnl_ros.storage.machine_places import Place
from identnl_ros.storage.quantities import Quantity, shown
from identnl_ros.storage.yaml_reading import KIND, Name, StrictModel
from pydantic import field_validator, PlainValidator, ValidationInfo

# Words for errors, by SI unit along and about an axis; as in `ELEMENT_KINDS`.
_EXPECTED = {
    ('N', 'N*m'): ('a force such as "40 N"', 'a moment such as "2 N*m"'),
    ('N/m', 'N*m'): (
        'a stiffness such as "15 daN/um"',
        'a rotational stiffness such as "1e6 N*m/rad"',
    ),
    ('N*s^2/m^2', 'N*m*s^2'): (
        'a quadratic damping such as "2e4 N*s^2/m^2"',
        'a rotational quadratic damping such as "30 N*m*s^2/rad^2"',
    ),
    ('m', 'rad'): ('a length such as "5 um"', 'an angle such as "20 urad"'),
    ('m/s', 'rad/s'): (
        'a velocity such as "10 um/s"',
        'an angular velocity such as "50 urad/s"',
    ),
    ('N/m/s', 'N*m/s'): (
        'a rate of a stiffness such as "2 N/um/s"',
        'a rate of a rotational stiffness such as "1e5 N*m/rad/s"',
    ),
    ('1', '1'): ('a number such as 2', 'a number such as 2'),
}


def _axis(value: object) -> int:
    if not (isinstance(value, str) and value in ('1', '2', '3', '4', '5', '6')):
        raise ValueError(
            f'found {shown(value)}, expected 1, 2 or 3 (along that axis) or '
            '4, 5 or 6 (about axis 1, 2 or 3)'
        )
    return int(value)


class ElementPart(StrictModel):
    """Keys that all elements have."""

    kind: str
    at: Name
    axis: Annotated[int, PlainValidator(_axis)]

    @field_validator(
        'force', 'damping', 'stiffness', 'transition_velocity', 'stribeck_velocity', 'gap',
        'limit', 'exponent', 'stiffness_rate', mode='plain', check_fields=False,
    )  # fmt: skip
    @classmethod
    def _read_number(cls, value: object, info: ValidationInfo) -> Coefficient:
        kind = ELEMENT_KINDS[info.data[KIND]]
        side = ABOUT if info.data.get('axis', 1) > 3 else ALONG
        number = next(one for one in (kind.coefficient, *kind.inner) if one.key == info.field_name)
        unit, expected = number.units[side], _EXPECTED[number.units][side]
        quantity = Quantity('' if unit == '1' else unit, expected)
        if number is kind.coefficient:
            return quantity.coefficient(value)
        if not number.estimable:
            return Coefficient(quantity.number(value))
        return quantity.coefficient_with_start(value)

    def build(self, name: str, place: Place) -> Element:
        """
        Make the joint.

        Parameters
        ----------
        name : str
        place : Place
            Of the joint that `at` names.

        Returns
        -------
        Element

        Raises
        ------
        MachineError
            If a number is out of range.

        """
        kind = ELEMENT_KINDS[self.kind]
        return Element(
            name,
            place.body,
            place.to,
            place.point,
            place.axes,
            self.kind,
            self.axis,
            getattr(self, kind.coefficient.key),
            {number.key: getattr(self, number.key) for number in kind.inner},
        )


class CoulombFriction(ElementPart):
    """Friction that does not depend on the size of the velocity."""

    kind: Literal['coulomb_friction']
    force: Coefficient
    transition_velocity: Coefficient


class StribeckFriction(ElementPart):
    """What friction has more than Coulomb's near standstill."""

    kind: Literal['stribeck_friction']
    force: Coefficient
    transition_velocity: Coefficient
    stribeck_velocity: Coefficient


class QuadraticDamping(ElementPart):
    """Damping that grows with the square of the velocity."""

    kind: Literal['quadratic_damping']
    damping: Coefficient


class Backlash(ElementPart):
    """Free play of a linear spring."""

    kind: Literal['backlash']
    stiffness: Coefficient
    gap: Coefficient


class BilinearStiffness(ElementPart):
    """A spring that begins to act behind a gap."""

    kind: Literal['bilinear_stiffness']
    stiffness: Coefficient
    gap: Coefficient = Coefficient(0.0)


class DriftingStiffness(ElementPart):
    """A stiffness that grows in proportion to time, or falls."""

    kind: Literal['drifting_stiffness']
    stiffness_rate: Coefficient


class Hysteresis(ElementPart):
    """A spring whose force fades at a limit and remembers the motion."""

    kind: Literal['hysteresis']
    stiffness: Coefficient
    limit: Coefficient
    exponent: Coefficient = Coefficient(2.0)


ElementKey = (
    CoulombFriction
    | StribeckFriction
    | QuadraticDamping
    | Backlash
    | BilinearStiffness
    | DriftingStiffness
    | Hysteresis
)
