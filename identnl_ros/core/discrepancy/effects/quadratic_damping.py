# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Quadratic damping at a joint."""

from identnl_ros.core.discrepancy.effects.element_effect import ElementEffect, Shares


class QuadraticDamping(ElementEffect):
    """A force in proportion to the square of the rate, against the motion."""

    name = 'quadratic_damping'
    title = 'quadratic damping'
    size_name = 'damping'
    units = ('N s^2/m^2', 'N m s^2/rad^2')

    def fractions(self) -> Shares:
        """List inner parameters as shares of the motion."""
        return ({},)
