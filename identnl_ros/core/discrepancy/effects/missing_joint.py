# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A joint that the model lacks, between two bodies or a body and the ground."""

from collections.abc import Mapping, Sequence
from itertools import combinations

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import AddedPart, Place
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.joints import GROUND, Joint, SpringDamper
import numpy as np


class MissingJoint(AddedPart):
    """A spring between two parts, at the centre of mass of the first, along an axis."""

    name = 'missing_joint'
    title = 'a joint'
    size_name = 'stiffness'
    sign = 1

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 'N/m' if place.axis < 4 else 'N m/rad'

    def places(self, description: Description) -> Sequence[Place]:
        """List the pairs of bodies, and of bodies and ground, with every axis."""
        names = [body.name for body in description.machine.bodies]
        pairs = [*combinations(names, 2), *((name, GROUND) for name in names)]
        return [
            Place(
                first, axis, second,
                f'between {first} and {second}, {"along" if axis < 4 else "about"} '
                f'{"xyz"[(axis - 1) % 3]}',
            )
            for first, second in pairs
            for axis in range(1, 7)
        ]  # fmt: skip

    def part(
        self,
        description: Description,
        place: Place,
        inner: Mapping[str, float],
        coefficient: Coefficient,
        name: str,
    ) -> Joint:
        """Make a joint with this spring only."""
        numbers = (*(Coefficient(0.0),) * (place.axis - 1), coefficient)
        centre = description.body(place.part).centre_of_mass
        return SpringDamper(name, place.part, place.other, centre, np.eye(3), stiffness=numbers)

    def part_name(self, place: Place) -> str:
        """Name the joint after both parts."""
        return f'joint_{place.part}_{place.other}_{place.axis}'
