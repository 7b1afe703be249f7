# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The description of a stand as a message and back."""

from geometry_msgs.msg import Point, Vector3
from identnl_msgs.msg import ChannelDescription, StandDescription as StandDescriptionMessage
from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.layout import Layout, Sensor, SensorKind
from identnl_ros.nodes.conversions import stamp_ns, to_header
from identnl_ros.storage.stand_description import StandDescription
import numpy as np

_KIND_NUMBERS = {kind: getattr(ChannelDescription, f'KIND_{kind.name}') for kind in SensorKind}
_KINDS = {number: kind for kind, number in _KIND_NUMBERS.items()}


def description_to_message(description: StandDescription) -> StandDescriptionMessage:
    """
    Make a message of a description.

    Parameters
    ----------
    description : StandDescription

    Returns
    -------
    identnl_msgs.msg.StandDescription

    """
    return StandDescriptionMessage(
        header=to_header(description.stamp_ns),
        stand=description.stand,
        stream_id=description.stream_id,
        sample_rate=description.sample_rate,
        channels=[_to_channel(sensor) for sensor in description.layout.sensors],
        machine_file=description.machine_text,
        layout_file=description.layout_text,
    )


def description_from_message(message: StandDescriptionMessage) -> StandDescription:
    """
    Make a description from a message.

    Parameters
    ----------
    message : identnl_msgs.msg.StandDescription

    Returns
    -------
    StandDescription
        With a layout made from the channels, not from the text of the layout file.

    Raises
    ------
    DataError
        If a channel cannot be understood.

    """
    try:
        layout = Layout(
            tuple(_from_channel(channel) for channel in message.channels),
            message.stand,
            message.sample_rate,
        )
    except LayoutError as error:
        raise DataError(f'the description of stand {message.stand} is unsound: {error}') from None
    return StandDescription(
        stand=message.stand,
        stream_id=message.stream_id,
        sample_rate=message.sample_rate,
        layout=layout,
        machine_text=message.machine_file,
        layout_text=message.layout_file,
        stamp_ns=stamp_ns(message.header),
    )


def _to_channel(sensor: Sensor) -> ChannelDescription:
    x, y, z = (float(value) for value in sensor.point)
    along_x, along_y, along_z = (float(value) for value in sensor.direction)
    return ChannelDescription(
        name=sensor.name,
        kind=_KIND_NUMBERS[sensor.kind],
        unit=sensor.kind.unit,
        body=sensor.body,
        reference_body=sensor.reference_body,
        excitation=sensor.excitation,
        point=Point(x=x, y=y, z=z),
        direction=Vector3(x=along_x, y=along_y, z=along_z),
        recorded_unit=sensor.recorded_unit,
        column=sensor.column,
        gain=float(sensor.gain),
        offset=float(sensor.offset),
        delay=float(sensor.delay),
        noise_standard_deviation=float(sensor.noise),
    )


def _from_channel(channel: ChannelDescription) -> Sensor:
    if channel.kind not in _KINDS:
        raise DataError(
            f'channel {channel.name} measures the unknown quantity {channel.kind}, expected one '
            f'of {sorted(_KINDS)} (the KIND_ constants of ChannelDescription.msg)'
        )
    point, direction = channel.point, channel.direction
    return Sensor(
        name=channel.name,
        kind=_KINDS[channel.kind],
        body=channel.body,
        point=np.array([point.x, point.y, point.z]),
        direction=np.array([direction.x, direction.y, direction.z]),
        reference_body=channel.reference_body,
        excitation=channel.excitation,
        column=channel.column,
        recorded_unit=channel.recorded_unit,
        gain=channel.gain,
        offset=channel.offset,
        delay=channel.delay,
        noise=channel.noise_standard_deviation,
    )
