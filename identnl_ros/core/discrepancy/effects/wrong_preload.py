# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A preload that is not the one of the model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Place
from identnl_ros.core.discrepancy.effects.wrong_exponent import WrongExponent
from identnl_ros.core.mechanics.coefficients import Coefficient


class WrongPreload(ChangedMachine):
    """A slideway that is pressed together more or less at rest than described."""

    name = 'wrong_preload'
    title = 'another preload'
    size_name = 'preload'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 'm'

    def places(self, description: Description) -> Sequence[Place]:
        """List the slideways."""
        return WrongExponent().places(description)

    def unit_size(self, description: Description, place: Place) -> float:
        """Give a hundredth of the preload, or ten nanometres."""
        return max(0.01 * description.slideway(place.part).preload.value, 1e-8)

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the preload, which is to be estimated then."""
        joint = description.slideway(place.part)
        preload = Coefficient(joint.preload.value + size, estimated=True)
        return description.with_joint(replace(joint, preload=preload))

    def hidden_in(self, description: Description, place: Place) -> bool:
        """Tell whether the preload is unknown anyway."""
        preload = description.slideway(place.part).preload
        return preload.estimated or preload.tie is not None
