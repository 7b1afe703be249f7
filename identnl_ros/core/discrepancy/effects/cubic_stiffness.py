# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""cubic stiffness at a joint."""

from identnl_ros.core.discrepancy.effects.joint_element import SpringElement


class CubicStiffness(SpringElement):
    """Force in proportion to the third power of the deformation."""

    name = 'cubic_stiffness'
    title = 'cubic stiffness'
    size_name = 'cubic_stiffness'
    units = ('N/m^3', 'N m/rad^3')
    field = 'cubic_stiffness'
    sign = 0
