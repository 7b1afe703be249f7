# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A force cell whose readings are too large or too small by a factor."""

from collections.abc import Mapping
from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Place, Reals
from identnl_ros.core.discrepancy.effects.force_fault import ForceFault

# A cell that is right by less than this part of its reading measures something else.
LEAST = 0.05


class ForceGain(ForceFault):
    """
    A share of the reading that is not there; twice the reading: a reversed polarity.

    The true force, ``1 - size`` times the reading, is linear in this share; in the relative error
    of the gain, ``size / (1 - size)``, it would not be.
    """

    name = 'force_gain'
    title = 'an error of gain'
    size_name = 'share_of_reading'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return '1'

    def lacking(self, time: Reals, measured: Reals) -> Reals:
        """Give the measured force, negative."""
        return -measured

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether a cell can be that wrong."""
        return abs(1 - size) > LEAST

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the gain."""
        sensor = description.sensor(place.part)
        return description.with_sensor(replace(sensor, gain=sensor.gain / (1 - size)))
