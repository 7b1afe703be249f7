# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Backlash at a joint."""

from identnl_ros.core.discrepancy.effects.element_effect import ElementEffect, Shares


class Backlash(ElementEffect):
    """A dead zone in which a spring of the joint carries nothing."""

    name = 'backlash'
    title = 'backlash'
    size_name = 'stiffness'
    units = ('N/m', 'N m/rad')
    refined = ('gap',)

    def fractions(self) -> Shares:
        """List inner parameters as shares of the motion."""
        return (
            {'gap': ('deformation', 0.05)},
            {'gap': ('deformation', 0.15)},
            {'gap': ('deformation', 0.4)},
            {'gap': ('deformation', 0.7)},
        )
