# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A constant force on a body."""

from collections.abc import Mapping, Sequence

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import AddedPart, Place
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.machine import ConstantForce
import numpy as np


class UnknownConstantForce(AddedPart):
    """A force that does not change, at a body's centre of mass: a hose, a counterweight."""

    name = 'constant_force'
    title = 'a constant force'
    size_name = 'force'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 'N'

    def places(self, description: Description) -> Sequence[Place]:
        """List the axes of the machine frame at every body."""
        return [
            Place(body.name, axis, words=f'{body.name}, along {"xyz"[axis - 1]}')
            for body in description.machine.bodies
            for axis in (1, 2, 3)
        ]

    def part(
        self,
        description: Description,
        place: Place,
        inner: Mapping[str, float],
        coefficient: Coefficient,
        name: str,
    ) -> ConstantForce:
        """Make the force."""
        body = description.body(place.part)
        direction = np.eye(3)[place.axis - 1]
        return ConstantForce(name, body.name, body.centre_of_mass, direction, coefficient)
