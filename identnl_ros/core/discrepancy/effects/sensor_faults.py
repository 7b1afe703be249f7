# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensors that do not read what the layout says: gain, offset, delay, polarity, direction."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

from identnl_ros.core.discrepancy.circumstances import Signals
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Place, Reals, SensorFault
from identnl_ros.core.measurement.layout import SensorKind
import numpy as np

MOTION = (SensorKind.DISPLACEMENT, SensorKind.VELOCITY, SensorKind.ACCELERATION)
# A fault that is there as a whole is estimated at one within this.
WHOLE = 0.3
LARGEST_ANGLE = 0.6  # [rad]
LARGEST_DELAY = 5e-3  # [s]


class OneSensor(SensorFault):
    """A fault of a single sensor of motion."""

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return '1'

    def places(self, description: Description) -> Sequence[Place]:
        """List the sensors of motion."""
        return [
            Place(sensor.name, words=f'sensor {sensor.name}', unit=sensor.kind.unit)
            for sensor in description.layout.sensors
            if sensor.kind in MOTION
        ]


class SensorGain(OneSensor):
    """Readings too large or too small by a factor."""

    name = 'sensor_gain'
    title = 'an error of gain'
    size_name = 'gain'

    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """Give the reading."""
        return {place.part: signals.readings[place.part]}

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the gain."""
        sensor = description.sensor(place.part)
        return description.with_sensor(replace(sensor, gain=sensor.gain * (1 + size)))

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether it is not a reversed polarity."""
        return size > -1 - WHOLE


class SwappedPolarity(OneSensor):
    """Readings with the wrong sign."""

    name = 'swapped_polarity'
    title = 'swapped polarity'
    size_name = 'gain'

    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """Give twice the reading, negative."""
        return {place.part: -2 * signals.readings[place.part]}

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Turn the sign of the gain."""
        sensor = description.sensor(place.part)
        return description.with_sensor(replace(sensor, gain=-sensor.gain))

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether it is there as a whole."""
        return abs(size - 1) < WHOLE


class SensorOffset(OneSensor):
    """Readings with a constant added."""

    name = 'sensor_offset'
    title = 'an offset'
    size_name = 'offset'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size: that of the reading."""
        return place.unit or '1'

    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """Give a constant."""
        return {place.part: np.ones_like(signals.time)}

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the offset."""
        sensor = description.sensor(place.part)
        offset = sensor.offset + size * sensor.gain
        return description.with_sensor(replace(sensor, offset=offset))


class SensorDelay(OneSensor):
    """Readings that come late."""

    name = 'sensor_delay'
    title = 'a delay'
    size_name = 'delay'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 's'

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether the delay is one that a linear regression can tell."""
        return abs(size) < LARGEST_DELAY

    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """Give the derivative of the reading, negative."""
        return {place.part: -signals.rates[place.part]}

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change the delay."""
        sensor = description.sensor(place.part)
        return description.with_sensor(replace(sensor, delay=sensor.delay + size))


class KindDelay(SensorFault):
    """All sensors of a kind late, as after a filter or on a device of their own."""

    name = 'delay_of_kind'
    title = 'a common delay'
    size_name = 'delay'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 's'

    def places(self, description: Description) -> Sequence[Place]:
        """List the kinds of sensors of motion."""
        return [
            Place(kind.value, words=f'all {kind.value} sensors')
            for kind in MOTION
            if len(description.layout.of_kind(kind)) > 1
        ]

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether the delay is one that a linear regression can tell."""
        return abs(size) < LARGEST_DELAY

    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """Give the derivatives of the readings, negative."""
        return {
            name: -rate
            for name, rate in signals.rates.items()
            if signals.kinds[name].value == place.part
        }

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Change all delays."""
        for sensor in description.layout.sensors:
            if sensor.kind.value == place.part:
                description = description.with_sensor(replace(sensor, delay=sensor.delay + size))
        return description


class ExchangedChannels(SensorFault):
    """Two sensors of a kind with their cables exchanged."""

    name = 'exchanged_channels'
    title = 'exchanged channels'
    size_name = 'column'

    def unit(self, place: Place) -> str:
        """Give the unit of its size: it is there or not."""
        return '1'

    def places(self, description: Description) -> Sequence[Place]:
        """List the pairs of sensors of the same kind."""
        sensors = description.layout.sensors
        return [
            Place(
                sensors[i].name,
                0,
                sensors[j].name,
                f'sensors {sensors[i].name} and {sensors[j].name}',
            )
            for kind in MOTION
            for i, j in combinations(description.layout.of_kind(kind), 2)
        ]

    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """Give the difference of the two."""
        difference = signals.readings[place.other] - signals.readings[place.part]
        return {place.part: difference, place.other: -difference}

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Exchange what the two columns mean."""
        first, second = description.sensor(place.part), description.sensor(place.other)
        moved = ('body', 'point', 'direction', 'reference_body')
        return description.with_sensor(
            replace(first, **{key: getattr(second, key) for key in moved})
        ).with_sensor(replace(second, **{key: getattr(first, key) for key in moved}))

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether it is there as a whole."""
        return abs(size - 1) < WHOLE


class WrongDirection(OneSensor):
    """A sensor that points elsewhere by an angle about an axis of the machine frame."""

    name = 'wrong_direction'
    title = 'a wrong direction'
    size_name = 'direction'

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 'rad'

    def places(self, description: Description) -> Sequence[Place]:
        """List the sensors of motion with the two axes that turn them."""
        return [
            Place(sensor.name, axis, words=f'sensor {sensor.name}, turned about {"xyz"[axis - 1]}')
            for sensor in description.layout.sensors
            if sensor.kind in MOTION
            for axis in (1, 2, 3)
            if np.linalg.norm(np.cross(np.eye(3)[axis - 1], sensor.direction)) > 0.5
        ]

    def admits(self, size: float, deviation: float) -> bool:
        """Tell whether the direction is still roughly the stated one."""
        return abs(size) < LARGEST_ANGLE

    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """Give what is read across the direction."""
        turned = np.cross(np.eye(3)[place.axis - 1], signals.directions[place.part])
        return {place.part: signals.triads[place.part] @ turned}

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Turn the direction."""
        sensor = description.sensor(place.part)
        axis = np.eye(3)[place.axis - 1]
        direction = np.cos(size) * sensor.direction + np.sin(size) * np.cross(
            axis, sensor.direction
        )
        direction += (1 - np.cos(size)) * (axis @ sensor.direction) * axis
        return description.with_sensor(replace(sensor, direction=direction))
