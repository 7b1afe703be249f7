# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Bilinear stiffness at a joint."""

from identnl_ros.core.discrepancy.effects.element_effect import ElementEffect, Shares


class BilinearStiffness(ElementEffect):
    """A spring that acts beyond a deformation on one side only: a stop, or a joint that opens."""

    name = 'bilinear_stiffness'
    title = 'bilinear stiffness'
    size_name = 'stiffness'
    units = ('N/m', 'N m/rad')
    refined = ('gap',)
    sign = 0

    def fractions(self) -> Shares:
        """List inner parameters as shares of the motion."""
        return (
            {'gap': ('deformation', -0.5)},
            {'gap': ('deformation', -0.2)},
            {'gap': ('deformation', 0.0)},
            {'gap': ('deformation', 0.2)},
            {'gap': ('deformation', 0.5)},
        )
