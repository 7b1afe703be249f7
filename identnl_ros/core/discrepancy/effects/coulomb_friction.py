# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction at a joint."""

from identnl_ros.core.discrepancy.effects.element_effect import ElementEffect, Shares


class CoulombFriction(ElementEffect):
    """A force of constant size against the motion, but for a transition at standstill."""

    name = 'coulomb_friction'
    title = 'Coulomb friction'
    size_name = 'force'
    units = ('N', 'N m')
    refined = ('transition_velocity',)

    def fractions(self) -> Shares:
        """List inner parameters as shares of the motion."""
        return ({'transition_velocity': ('rate', 0.03)}, {'transition_velocity': ('rate', 0.15)})
