# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A centre of mass that is not where the model has it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Place
import numpy as np


class ShiftedCentreOfMass(ChangedMachine):
    """A centre of mass elsewhere, the inertia about it the same."""

    name = 'shifted_centre_of_mass'
    title = 'a shift of the centre of mass'
    size_name = 'centre_of_mass'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 'm'

    def places(self, description: Description) -> Sequence[Place]:
        """List the axes of the machine frame at every body that turns."""
        return [
            Place(body.name, axis, words=f'{body.name}, along {"xyz"[axis - 1]}')
            for body in description.machine.bodies
            if any(one.startswith('rotation') for one in body.degrees_of_freedom)
            for axis in (1, 2, 3)
        ]

    def unit_size(self, description: Description, place: Place) -> float:
        """Give a millimetre."""
        return 1e-3

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Move the centre of mass."""
        body = description.body(place.part)
        centre = body.centre_of_mass + size * np.eye(3)[place.axis - 1]
        return description.with_body(replace(body, centre_of_mass=centre))
