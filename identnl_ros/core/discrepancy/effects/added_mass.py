# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Mass that a body has and the model does not."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Place
from identnl_ros.core.mechanics.coefficients import Coefficient


class AddedMass(ChangedMachine):
    """A body heavier (or lighter) than described, its centre of mass and inertia the same."""

    name = 'added_mass'
    title = 'mass'
    size_name = 'mass'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 'kg'

    def places(self, description: Description) -> Sequence[Place]:
        """List the bodies."""
        return [Place(body.name, words=body.name) for body in description.machine.bodies]

    def unit_size(self, description: Description, place: Place) -> float:
        """Give a hundredth of the mass."""
        return 0.01 * description.body(place.part).mass.value

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Add to the mass, which is to be estimated then."""
        body = description.body(place.part)
        mass = Coefficient(body.mass.value + size, estimated=True)
        return description.with_body(replace(body, mass=mass))

    def hidden_in(self, description: Description, place: Place) -> bool:
        """Tell whether the mass is unknown anyway."""
        return description.body(place.part).mass.estimated
