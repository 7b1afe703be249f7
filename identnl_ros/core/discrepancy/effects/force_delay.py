# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A force cell whose readings come late."""

from collections.abc import Mapping
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Place, Reals
from identnl_ros.core.discrepancy.effects.force_fault import ForceFault
from identnl_ros.core.discrepancy.effects.sensor_faults import LARGEST_DELAY
from scipy.interpolate import make_interp_spline

SPLINE_DEGREE = 5


class ForceDelay(ForceFault):
    """A force that is measured late, or early."""

    name = 'force_delay'
    title = 'a delay'
    size_name = 'delay'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 's'

    def lacking(self, time: Reals, measured: Reals) -> Reals:
        """Give the derivative of the measured force: what it will be a little later."""
        spline = make_interp_spline(time, measured, SPLINE_DEGREE)
        derivative: Reals = spline.derivative()(time)
        return derivative

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether the delay is one that a linear regression can tell."""
        return abs(size) < LARGEST_DELAY

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the delay."""
        sensor = description.sensor(place.part)
        return description.with_sensor(replace(sensor, delay=sensor.delay + size))
