# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A stiffness at a joint that changes in the course of time."""

from identnl_ros.core.discrepancy.effects.element_effect import ElementEffect


class DriftingStiffness(ElementEffect):
    """A spring whose stiffness grows in proportion to time, or falls."""

    name = 'drifting_stiffness'
    title = 'a drift of the stiffness'
    size_name = 'stiffness_rate'
    units = ('N/m/s', 'N m/rad/s')
    sign = 0
