# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Which channel of which device a sensor of the layout is read from, and in which unit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.blocks import ChannelStatus
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.sources.device import DeviceChannel
from identnl_ros.storage.quantities import convert, same_dimension, UnitError
import numpy as np
from numpy.typing import NDArray

MOST_LISTED = 12
SIMILAR = 0.6  # as difflib has it


@dataclass(frozen=True)
class SensorChannel:
    """
    A sensor on a channel of a device.

    Parameters
    ----------
    place : int
        Of the sensor in the layout.
    sensor : Sensor
    column : int
        Of the channel in the device's samples.
    factor : float
        Recorded unit of the layout per unit of the device.

    """

    place: int
    sensor: Sensor
    column: int
    factor: float


@dataclass(frozen=True)
class Readings:
    """
    Samples in SI units and what is wrong with them.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n_sensors)
        NaN where there is no valid sample.
    status : ndarray of uint8, shape (n_sensors,)
        Bits of `ChannelStatus`.

    """

    samples: NDArray[np.float64] = field(repr=False)
    status: NDArray[np.uint8]


@dataclass(frozen=True)
class SensorsOfDevice:
    """
    The sensors that are read from one device, in the order of the layout.

    Parameters
    ----------
    channels : tuple of SensorChannel

    """

    channels: tuple[SensorChannel, ...]

    def to_si(
        self, delivered: NDArray[np.float64], first_index: int, sample_rate: float
    ) -> Readings:
        """
        Convert what the device has delivered.

        Parameters
        ----------
        delivered : ndarray, shape (n_samples, n_channels)
            All channels of the device in its units; without sample: not finite.
        first_index : int
            Of the first sample since the begin of the stream.
        sample_rate : float
            [Hz].

        Returns
        -------
        Readings

        """
        time = (first_index + np.arange(len(delivered))) / sample_rate
        samples = np.empty((len(delivered), len(self.channels)))
        status = np.zeros(len(self.channels), dtype=np.uint8)
        for i, channel in enumerate(self.channels):
            recorded = delivered[:, channel.column] * channel.factor
            missing = ~np.isfinite(recorded)
            # Infinite values are as good as none; a comparison with NaN is false.
            saturated = ~missing & (np.abs(recorded) >= channel.sensor.full_scale)
            samples[:, i] = channel.sensor.to_si(recorded, time)
            samples[missing | saturated, i] = np.nan
            if missing.any():
                status[i] |= ChannelStatus.MISSING_SAMPLES
            if saturated.any():
                status[i] |= ChannelStatus.SATURATED
        return Readings(samples, status)


def sensors_of_devices(
    layout: Layout,
    devices: Sequence[tuple[str, tuple[DeviceChannel, ...]]],
    tell: Callable[[str], None],
) -> list[SensorsOfDevice]:
    """
    Find the channel of every sensor by its key ``column``.

    Parameters
    ----------
    layout : Layout
    devices : sequence of (str, tuple of DeviceChannel)
        Names of the devices and what they have.
    tell : callable
        Takes sentences for the user.

    Returns
    -------
    list of SensorsOfDevice
        For each device.

    Raises
    ------
    LayoutError
        If a sensor has no channel, or several may be meant, or the units do not fit.

    """
    places: dict[str, list[tuple[int, int]]] = {}
    names: list[tuple[str, str]] = []
    for number, (device, channels) in enumerate(devices):
        for column, channel in enumerate(channels):
            names.append((channel.name, f'{device}/{channel.name}'))
            for name in set(names[-1]):
                places.setdefault(name, []).append((number, column))
    # With its device where a name is that of several channels.
    shown = [name if len(places[name]) == 1 else full_name for name, full_name in names]
    found: list[list[SensorChannel]] = [[] for _ in devices]
    for place, sensor in enumerate(layout.sensors):
        candidates = places.get(sensor.column, [])
        if not candidates:
            raise LayoutError(
                f'sensor {sensor.name}: found no channel "{sensor.column}" (key column), '
                f'expected one of {_closest_first(sensor.column, shown)}'
            )
        if len(candidates) > 1:
            full_names = ', '.join(f'{devices[i][0]}/{sensor.column}' for i, _ in candidates)
            raise LayoutError(
                f'sensor {sensor.name}: channel "{sensor.column}" (key column) may be any of '
                f'{full_names}; write it with its device'
            )
        ((number, column),) = candidates
        channel = devices[number][1][column]
        factor = _factor(sensor, channel, devices[number][0], tell)
        found[number].append(SensorChannel(place, sensor, column, factor))
    return [SensorsOfDevice(tuple(channels)) for channels in found]


def _factor(
    sensor: Sensor, channel: DeviceChannel, device: str, tell: Callable[[str], None]
) -> float:
    """Give the layout's recorded unit per unit of the device."""
    if channel.unit in ('', sensor.recorded_unit):
        return 1.0
    says = f'device {device} gives channel {channel.name} in {channel.unit}'
    try:
        if same_dimension(channel.unit, sensor.recorded_unit):
            return convert(1.0, channel.unit, sensor.recorded_unit)
    except UnitError:
        tell(
            f'sensor {sensor.name}: {says}, which is no known unit; taken for '
            f'{sensor.recorded_unit}, as the layout says'
        )
        return 1.0
    raise LayoutError(
        f'sensor {sensor.name}: {says}, the layout expects {sensor.recorded_unit} (key unit); '
        'correct the layout or the scaling in the device'
    )


def _closest_first(wanted: str, names: list[str]) -> str:
    def similarity(name: str) -> float:
        texts = (name.lower(), name.rpartition('/')[2].lower())
        return max(SequenceMatcher(None, wanted.lower(), text).ratio() for text in texts)

    listed = sorted(names, key=similarity, reverse=True)
    more = f' and {len(listed) - MOST_LISTED} more' if len(listed) > MOST_LISTED else ''
    similar = listed and similarity(listed[0]) >= SIMILAR
    meant = f'; did you mean "{listed[0]}"?' if similar else ''
    return f'{", ".join(listed[:MOST_LISTED])}{more}{meant}'
