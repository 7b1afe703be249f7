# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Stribeck friction at a joint."""

from identnl_ros.core.discrepancy.effects.element_effect import ElementEffect, Shares


class StribeckFriction(ElementEffect):
    """Friction that is larger near standstill: what it is more than Coulomb friction."""

    name = 'stribeck_friction'
    title = 'Stribeck friction'
    size_name = 'force'
    units = ('N', 'N m')
    refined = ('stribeck_velocity',)

    def fractions(self) -> Shares:
        """List inner parameters as shares of the motion."""
        return (
            {'transition_velocity': ('rate', 0.03), 'stribeck_velocity': ('rate', 0.15)},
            {'transition_velocity': ('rate', 0.05), 'stribeck_velocity': ('rate', 0.4)},
        )
