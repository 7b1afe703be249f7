# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A contact exponent that is not the one of the model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Place
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.slideway import Slideway


class WrongExponent(ChangedMachine):
    """The pressure in a slideway follows another power of its approach."""

    name = 'wrong_exponent'
    title = 'another contact exponent'
    size_name = 'exponent'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return '1'

    def places(self, description: Description) -> Sequence[Place]:
        """List the slideways."""
        return [
            Place(joint.name, 1, words=f'{joint.name}, normal direction')
            for joint in description.machine.joints
            if isinstance(joint, Slideway)
        ]

    def unit_size(self, description: Description, place: Place) -> float:
        """Give a small step."""
        return 0.01

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the exponent, which is to be estimated then."""
        joint = description.slideway(place.part)
        exponent = Coefficient(joint.exponent.value + size, estimated=True)
        return description.with_joint(replace(joint, exponent=exponent))

    def hidden_in(self, description: Description, place: Place) -> bool:
        """Tell whether the exponent is unknown anyway."""
        exponent = description.slideway(place.part).exponent
        return exponent.estimated or exponent.tie is not None
