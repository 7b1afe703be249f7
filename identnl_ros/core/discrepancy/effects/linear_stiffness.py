# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""linear stiffness at a joint."""

from identnl_ros.core.discrepancy.effects.joint_element import SpringElement


class LinearStiffness(SpringElement):
    """Force in proportion to the deformation; a negative one where the model is too stiff."""

    name = 'linear_stiffness'
    title = 'linear stiffness'
    size_name = 'stiffness'
    units = ('N/m', 'N m/rad')
    field = 'stiffness'
    sign = 0
