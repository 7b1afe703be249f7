# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The description of a stand as a message; a bag reader and the nodes take it back alike."""

from geometry_msgs.msg import Point, Vector3
from identnl_msgs.msg import ChannelDescription, StandDescription as StandDescriptionMessage
from identnl_ros.core.measurement.layout import Sensor, SensorKind
from identnl_ros.nodes.conversions import to_header
from identnl_ros.storage.stand_description import StandDescription

_KIND_NUMBERS = {kind: getattr(ChannelDescription, f'KIND_{kind.name}') for kind in SensorKind}


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
    down_x, down_y, down_z = (float(value) for value in description.layout.gravity)
    return StandDescriptionMessage(
        header=to_header(description.stamp_ns),
        stand=description.stand,
        stream_id=description.stream_id,
        sample_rate=description.sample_rate,
        gravity=Vector3(x=down_x, y=down_y, z=down_z),
        channels=[_to_channel(sensor) for sensor in description.layout.sensors],
        machine_file=description.machine_text,
        layout_file=description.layout_text,
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
        drift=float(sensor.drift),
        full_scale=float(sensor.full_scale),
        reads_gravity=sensor.reads_gravity,
        front_mass=float(sensor.front_mass),
        delay=float(sensor.delay),
        resolution=float(sensor.resolution),
        noise_standard_deviation=float(sensor.noise),
    )
