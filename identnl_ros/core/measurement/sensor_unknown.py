# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a fit may find out about the sensors themselves."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import Layout, SensorKind


class SensorQuantity(Enum):
    """What may be unknown of a sensor."""

    OFFSET = 'offset'
    GAIN = 'gain'
    DELAY = 'delay'

    @property
    def symbol(self) -> str:
        """Symbol in tables."""
        return {'offset': 'b', 'gain': 'g', 'delay': 'tau'}[self.value]

    def unit_of(self, kind: SensorKind) -> str:
        """
        Give the unit of the number.

        Parameters
        ----------
        kind : SensorKind
            Of the sensor.

        Returns
        -------
        str

        """
        return {'offset': kind.unit, 'gain': '1', 'delay': 's'}[self.value]


@dataclass(frozen=True)
class SensorUnknown:
    """
    One unknown number of one or several sensors of motion.

    ``reading = (1 + gain) * quantity(t - stated delay - delay) + offset``, all in SI.

    Parameters
    ----------
    quantity : SensorQuantity
        Gain: relative error of the stated one [-]; delay: beyond the stated one [s]; offset:
        [SI unit of the sensor].
    sensors : tuple of str
        Names of the sensors that share the number.
    shared_by : str
        What these are, e.g. ``acceleration``; empty: named one by one.

    """

    quantity: SensorQuantity
    sensors: tuple[str, ...]
    shared_by: str = ''

    @property
    def name(self) -> str:
        """E.g. ``delay of knee_acceleration_0x, knee_acceleration_0y``."""
        return f'{self.quantity.value} of {", ".join(self.sensors)}'

    @property
    def label(self) -> str:
        """As a parameter is named, e.g. ``acceleration.delay``."""
        return f'{self.shared_by or "+".join(self.sensors)}.{self.quantity.value}'


def shared_unknown(layout: Layout, quantity: SensorQuantity, kind: SensorKind) -> SensorUnknown:
    """
    Describe one number that all sensors of a kind share.

    Parameters
    ----------
    layout : Layout
    quantity : SensorQuantity
    kind : SensorKind

    Returns
    -------
    SensorUnknown

    """
    names = tuple(layout.sensors[channel].name for channel in layout.of_kind(kind))
    return SensorUnknown(quantity, names, kind.value)


def sensor_unknown(label: str, layouts: Sequence[Layout]) -> SensorUnknown:
    """
    Find what a label means.

    Parameters
    ----------
    label : str
        ``kind.quantity`` or ``sensor.quantity``, e.g. ``acceleration.delay``.
    layouts : sequence of Layout
        Of the records to be fitted.

    Returns
    -------
    SensorUnknown

    Raises
    ------
    LayoutError
        If there is no such sensor or quantity.

    """
    whose, _, what = label.rpartition('.')
    quantities = {one.value: one for one in SensorQuantity}
    if what not in quantities or not whose:
        raise LayoutError(
            f'unknown "{label}": expected a kind of sensor or the name of one, a dot and one of '
            f'{", ".join(quantities)}, e.g. acceleration.delay'
        )
    kinds = {kind.value: kind for kind in SensorKind if kind is not SensorKind.FORCE}
    if whose in kinds:
        names = dict.fromkeys(
            layout.sensors[i].name for layout in layouts for i in layout.of_kind(kinds[whose])
        )
        if names:
            return SensorUnknown(quantities[what], tuple(names), whose)
    elif any(
        sensor.name == whose and sensor.kind is not SensorKind.FORCE
        for layout in layouts
        for sensor in layout.sensors
    ):
        return SensorUnknown(quantities[what], (whose,))
    raise LayoutError(
        f'unknown "{label}": no layout has a sensor of motion called "{whose}" or of that kind'
    )
