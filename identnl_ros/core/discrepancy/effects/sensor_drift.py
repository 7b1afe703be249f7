# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A sensor whose zero moves in the course of time."""

from collections.abc import Mapping
from dataclasses import replace

from identnl_ros.core.discrepancy.circumstances import Signals
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Place, Reals
from identnl_ros.core.discrepancy.effects.sensor_faults import OneSensor

DRIFT_UNITS = {'m': 'm/s', 'm/s': 'm/s^2', 'm/s^2': 'm/s^3'}


class SensorDrift(OneSensor):
    """Readings with an offset in proportion to the time since the begin of the stream."""

    name = 'sensor_drift'
    title = 'a drift'
    size_name = 'drift'

    def unit(self, place: Place) -> str:
        """Give the unit of its size: that of the sensor, per second."""
        return DRIFT_UNITS.get(place.unit, '1/s')

    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """Give the time."""
        return {place.part: signals.time}

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the drift."""
        sensor = description.sensor(place.part)
        return description.with_sensor(replace(sensor, drift=sensor.drift + size * sensor.gain))
