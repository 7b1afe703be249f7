# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Hysteresis with memory at a joint."""

from identnl_ros.core.discrepancy.effects.element_effect import ElementEffect, Shares


class Hysteresis(ElementEffect):
    """A spring that gives way beyond a limit and remembers (Bouc-Wen)."""

    name = 'hysteresis'
    title = 'hysteresis with memory'
    size_name = 'stiffness'
    units = ('N/m', 'N m/rad')

    def fractions(self) -> Shares:
        """List inner parameters as shares of the motion."""
        return (
            {'limit': ('deformation', 0.05)},
            {'limit': ('deformation', 0.15)},
            {'limit': ('deformation', 0.4)},
        )
