# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Moment of inertia that a body has and the model does not."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Place
from identnl_ros.core.mechanics.kinematics import axes_of
import numpy as np


class AddedInertia(ChangedMachine):
    """A principal moment of inertia larger (or smaller) than described."""

    name = 'added_inertia'
    title = 'moment of inertia'
    size_name = 'inertia'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 'kg m^2'

    def places(self, description: Description) -> Sequence[Place]:
        """List the principal axes of the bodies that turn."""
        return [
            Place(body.name, axis, words=f'{body.name}, about its principal axis {axis}')
            for body in description.machine.bodies
            if body.inertia is not None
            for axis in (1, 2, 3)
            if f'rotation_{axis}' in body.degrees_of_freedom
        ]

    def unit_size(self, description: Description, place: Place) -> float:
        """Give a hundredth of the moment."""
        moments, _ = axes_of(description.body(place.part))
        return 0.01 * float(moments[place.axis - 1])

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Add to the tensor."""
        body = description.body(place.part)
        assert body.inertia is not None
        _, axes = axes_of(body)
        axis = axes[:, place.axis - 1]
        return description.with_body(
            replace(body, inertia=body.inertia + size * np.outer(axis, axis))
        )
