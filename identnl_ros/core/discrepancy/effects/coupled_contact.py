# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A contact whose pressure resists tilting and opens, where the model has separate springs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Place
from identnl_ros.core.mechanics.slideway import Slideway


class CoupledContact(ChangedMachine):
    """Pressure integrated over the face of a slideway instead of one spring per direction."""

    name = 'coupled_contact'
    title = 'coupled contact: tilting under preload'
    size_name = 'law'

    def unit(self, place: Place) -> str:
        """Give the unit of its size: it is there or not."""
        return '1'

    def places(self, description: Description) -> Sequence[Place]:
        """List the slideways with the decoupled law."""
        return [
            Place(joint.name, words=joint.name)
            for joint in description.machine.joints
            if isinstance(joint, Slideway) and not joint.coupled
        ]

    def unit_size(self, description: Description, place: Place) -> float:
        """Give one: the whole effect."""
        return 1.0

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the law."""
        return description.with_joint(replace(description.slideway(place.part), coupled=True))

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether it is there as a whole."""
        return abs(size - 1) < 0.3
