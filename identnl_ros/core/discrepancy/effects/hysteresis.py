# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Hysteresis with memory at a joint."""

from collections.abc import Mapping, Sequence

from identnl_ros.core.discrepancy.circumstances import Scale
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Place
from identnl_ros.core.discrepancy.effects.element_effect import ElementEffect, Shares
from identnl_ros.core.mechanics.joint_terms import EXPONENT

JENKINS, BOUC_WEN = 10.0, 2.0


class Hysteresis(ElementEffect):
    """
    A spring that gives way beyond a limit and remembers.

    Exponents: that of Bouc and Wen, which gives way gradually, and one so large that it is
    Jenkins' element, a spring behind dry friction.
    """

    name = 'hysteresis'
    title = 'hysteresis with memory'
    size_name = 'stiffness'
    units = ('N/m', 'N m/rad')

    def fractions(self) -> Shares:
        """List limits as shares of the motion."""
        return ({'limit': ('deformation', 0.07)}, {'limit': ('deformation', 0.25)})

    def variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """List limits as shares of what the joint does."""
        return _with(super().variants(description, place, scale), BOUC_WEN)

    def finer_variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """List limits more closely, with both exponents."""
        limits = super().finer_variants(description, place, scale)
        return (*_with(limits, BOUC_WEN), *_with(limits, JENKINS))


def _with(
    variants: Sequence[Mapping[str, float]], exponent: float
) -> Sequence[Mapping[str, float]]:
    return tuple({**one, EXPONENT: exponent} for one in variants)
