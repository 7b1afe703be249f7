# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""viscous damping at a joint."""

from identnl_ros.core.discrepancy.effects.joint_element import SpringElement


class ViscousDamping(SpringElement):
    """Force in proportion to the rate of deformation."""

    name = 'viscous_damping'
    title = 'viscous damping'
    size_name = 'damping'
    units = ('N s/m', 'N m s/rad')
    field = 'damping'
    sign = 1
