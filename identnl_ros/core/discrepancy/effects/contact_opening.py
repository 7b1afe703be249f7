# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A slideway that is not pressed together at rest, so that its contact opens."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Place
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.slideway import Slideway


class ContactOpening(ChangedMachine):
    """
    No preload at all: surfaces that bear pressure only, and just touch at rest.

    A finite change. A smaller preload under which nothing opens is another effect; so is the law
    of a contact that can open under its preload.
    """

    name = 'contact_opening'
    title = 'lost preload'
    size_name = 'law'

    def unit(self, place: Place) -> str:
        """Give the unit of its size: it is there or not."""
        return '1'

    def places(self, description: Description) -> Sequence[Place]:
        """List the slideways with a preload."""
        return [
            Place(joint.name, 1, words=f'{joint.name}, normal direction')
            for joint in description.machine.joints
            if isinstance(joint, Slideway) and not joint.preload.absent
        ]

    def unit_size(self, description: Description, place: Place) -> float:
        """Give one: the whole effect."""
        return 1.0

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Take the preload away, and take the law of a contact that opens."""
        joint = description.slideway(place.part)
        return description.with_joint(replace(joint, preload=Coefficient(0.0), coupled=True))

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether it is there as a whole."""
        return abs(size - 1) < 0.3

    def hidden_in(self, description: Description, place: Place) -> bool:
        """Tell whether the law can open, and its preload is unknown anyway."""
        joint = description.slideway(place.part)
        unknown = joint.preload.estimated or joint.preload.tie is not None
        return joint.coupled and unknown
