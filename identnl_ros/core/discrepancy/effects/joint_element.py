# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Effects that are one more scalar element along an axis of a joint."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import AddedPart, Place
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.joints import Joint, SpringDamper
from identnl_ros.core.mechanics.slideway import Slideway
import numpy as np

SLIDEWAY_AXES = {
    1: 'normal direction',
    2: 'tangential direction 2 (along its length)',
    3: 'tangential direction 3 (across its length)',
}


class JointElement(AddedPart):
    """An element along one axis of a joint of the machine."""

    units: ClassVar[tuple[str, str]]
    """SI unit of its size along an axis and about one."""
    size_name: ClassVar[str]

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return self.units[place.axis > 3]

    def places(self, description: Description) -> Sequence[Place]:
        """List the axes of all joints along which they carry force."""
        return joint_places(description)


class SpringElement(JointElement):
    """A spring or damper whose force is a power of the deformation, or the rate."""

    field: ClassVar[str]
    """Which of the coefficients of a `SpringDamper` it is."""

    def part(
        self,
        description: Description,
        place: Place,
        inner: Mapping[str, float],
        coefficient: Coefficient,
        name: str,
    ) -> Joint:
        """Make a joint that has this coefficient only."""
        host = description.joint(place.part)
        numbers = (*(Coefficient(0.0),) * (place.axis - 1), coefficient)
        joint = SpringDamper(name, host.body, host.other_body, host.point, host.axes)
        changed: dict[str, Any] = {self.field: numbers}
        return replace(joint, **changed)


def joint_places(description: Description) -> tuple[Place, ...]:
    """
    List the axes of all joints along which they carry force.

    Parameters
    ----------
    description : Description

    Returns
    -------
    tuple of Place

    """
    places: list[Place] = []
    seen: list[Joint] = []
    for joint in description.machine.joints:
        # One more element on another joint's place is no place of its own.
        if any(_same_place(joint, other) for other in seen):
            continue
        seen.append(joint)
        places += [
            Place(joint.name, axis, words=words_for(joint, axis)) for axis in joint_axes(joint)
        ]
    return tuple(places)


def _same_place(joint: Joint, other: Joint) -> bool:
    return (
        (joint.body, joint.other_body) == (other.body, other.other_body)
        and np.allclose(joint.point, other.point)
        and np.allclose(joint.axes, other.axes)
    )


def joint_axes(joint: Joint) -> tuple[int, ...]:
    """
    Find the axes along which a joint carries force.

    Parameters
    ----------
    joint : Joint

    Returns
    -------
    tuple of int
        From 1.

    """
    if isinstance(joint, Slideway):
        return 1, 2, 3
    return tuple(
        axis + 1
        for axis in range(6)
        if any(
            term.direction[axis] != 0 and abs(term.direction).max() == 1 for term in joint.terms()
        )
    )


def words_for(joint: Joint, axis: int) -> str:
    """
    Say where an axis of a joint is.

    Parameters
    ----------
    joint : Joint
    axis : int
        From 1.

    Returns
    -------
    str

    """
    if isinstance(joint, Slideway) and axis in SLIDEWAY_AXES:
        return f'{joint.name}, {SLIDEWAY_AXES[axis]}'
    return f'{joint.name}, {"along" if axis < 4 else "about"} its axis {(axis - 1) % 3 + 1}'
