# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Effects that are one element of `identnl_ros.core.mechanics.elements` at a joint."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import ClassVar

from identnl_ros.core.discrepancy.circumstances import Scale
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Place
from identnl_ros.core.discrepancy.effects.joint_element import JointElement
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.elements import Element, ELEMENT_KINDS
from identnl_ros.core.mechanics.joints import Joint

# Factors about every inner parameter of the coarse grid.
FINER = (0.5, 0.66, 0.81, 1.0, 1.23, 1.52, 2.0)
# By inner parameter: ``deformation`` or ``rate``, and the share of its largest value.
Shares = tuple[Mapping[str, tuple[str, float]], ...]


class ElementEffect(JointElement):
    """An element along one axis of a joint."""

    refined: ClassVar[tuple[str, ...]] = ()
    """Inner parameters that are estimated once the effect is added."""
    sign = 1

    def part(
        self,
        description: Description,
        place: Place,
        inner: Mapping[str, float],
        coefficient: Coefficient,
        name: str,
    ) -> Joint:
        """Make the element."""
        host = description.joint(place.part)
        known = coefficient.value == 0.0
        numbers = {
            key: Coefficient(value, estimated=key in self.refined and not known)
            for key, value in inner.items()
        }
        return Element(
            name, host.body, host.other_body, host.point, host.axes, self.name, place.axis,
            coefficient, numbers,
        )  # fmt: skip

    def inner_unit(self, name: str, place: Place) -> str:
        """Give the SI unit of a number inside the law."""
        numbers = ELEMENT_KINDS[self.name].inner
        return next(one for one in numbers if one.key == name).units[place.axis > 3]

    def fractions(self) -> Shares:
        """
        List inner parameters as shares of the motion.

        Returns
        -------
        tuple of mapping of str to (str, float)
            By inner parameter: ``deformation`` or ``rate``, and the share of its largest value.

        """
        return ({},)

    def finer_variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """List inner parameters about those of `variants`."""
        return tuple(
            {
                name: value * factor
                for (name, value), factor in zip(one.items(), factors, strict=True)
            }
            for one in ElementEffect.variants(self, description, place, scale)
            if any(one.values())
            for factors in product(FINER, repeat=len(one))
        )

    def variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """List the inner parameters to try: shares of what the joint does."""
        key = place.part, place.axis
        sizes = {'deformation': scale.deformation[key], 'rate': scale.rate[key]}
        if min(sizes.values()) <= 0:
            return ()
        return tuple(
            {name: share * sizes[what] for name, (what, share) in one.items()}
            for one in self.fractions()
        )
