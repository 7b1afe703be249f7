# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""quadratic stiffness at a joint."""

from identnl_ros.core.discrepancy.effects.joint_element import SpringElement


class QuadraticStiffness(SpringElement):
    """Force in proportion to the square of the deformation: hardens one way only."""

    name = 'quadratic_stiffness'
    title = 'quadratic stiffness'
    size_name = 'quadratic_stiffness'
    units = ('N/m^2', 'N m/rad^2')
    field = 'quadratic_stiffness'
    sign = 0
