# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a fit may find out about the sensors themselves."""

from dataclasses import dataclass
from enum import Enum

from identnl_ros.core.layout import Layout, SensorKind


class SensorQuantity(Enum):
    """What may be unknown of a sensor."""

    OFFSET = 'offset'
    GAIN = 'gain'
    DELAY = 'delay'


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

    """

    quantity: SensorQuantity
    sensors: tuple[str, ...]

    @property
    def name(self) -> str:
        """E.g. ``delay of knee_acceleration_0x, knee_acceleration_0y``."""
        return f'{self.quantity.value} of {", ".join(self.sensors)}'


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
    return SensorUnknown(quantity, names)
