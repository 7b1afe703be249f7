# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The message types in bags: their definitions, and writing them without ROS installed."""

from functools import cache
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS, SampleBlock
from identnl_ros.core.measurement.layout import Sensor
from identnl_ros.storage.cdr import SEPARATOR
from identnl_ros.storage.stand_description import StandDescription
import numpy as np

PACKAGE = 'identnl_msgs'
SAMPLE_BLOCK = f'{PACKAGE}/msg/SampleBlock'
STAND_DESCRIPTION = f'{PACKAGE}/msg/StandDescription'
ESTIMATES = f'{PACKAGE}/msg/ParameterEstimateArray'

MACHINE_FRAME = 'machine'


def package_definitions() -> dict[str, str]:
    """
    Texts of this project's own message types.

    Returns
    -------
    dict of str
        By type name, e.g. ``identnl_msgs/msg/SampleBlock``.

    """
    from importlib.resources import files

    folder = files('identnl_ros.storage') / 'message_definitions'
    return {
        f'{PACKAGE}/msg/{entry.name.removesuffix(".msg")}': entry.read_text('utf-8')
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name)
        if entry.name.endswith('.msg')
    }


@cache
def typestore() -> Any:
    """
    All message types that can be written: those of ROS 2 Jazzy and this project's.

    Returns
    -------
    rosbags.typesys.store.Typestore

    """
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in package_definitions().items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


@cache
def definition_text(type_name: str) -> str:
    """
    Definition of a type followed by those of all types it depends on.

    Parameters
    ----------
    type_name : str
        E.g. ``std_msgs/msg/String``.

    Returns
    -------
    str
        In the form ros2msg; this project's types with their comments.

    Raises
    ------
    DataError
        If the type is not known.

    """
    _check_known(type_name)
    plain, _ = typestore().generate_msgdef(type_name, ros_version=2)
    own = package_definitions()
    sections = []
    for index, section in enumerate(plain.split(f'{SEPARATOR}\n')):
        head = section.partition('\n')[0]
        package, *_, name = (head.removeprefix('MSG: ') if index else type_name).split('/')
        text = own.get(f'{package}/msg/{name}')
        if text is None:
            sections.append(section)
        else:
            sections.append(f'{head}\n{text}' if index else text)
    return f'{SEPARATOR}\n'.join(sections)


@cache
def type_hash(type_name: str) -> str:
    """
    Hash by which ROS 2 tells versions of a type apart.

    Parameters
    ----------
    type_name : str

    Returns
    -------
    str
        ``RIHS01_`` and 64 hexadecimal digits.

    Raises
    ------
    DataError
        If the type is not known.

    """
    _check_known(type_name)
    return str(typestore().hash_rihs01(type_name))


def encode_block(block: SampleBlock) -> bytes:
    """
    Serialise a block as a SampleBlock message.

    Parameters
    ----------
    block : SampleBlock

    Returns
    -------
    bytes
        CDR.

    """
    message = _new(
        'SampleBlock',
        header=_header(block.stamp_ns),
        stream_id=block.stream_id,
        first_sample_index=block.first_index,
        sample_rate=float(block.sample_rate),
        channel_count=block.samples.shape[1],
        samples=np.ascontiguousarray(block.samples, np.float64).reshape(-1),
        channel_status=np.ascontiguousarray(block.channel_status, np.uint8),
        last_block=block.last,
    )
    return bytes(typestore().serialize_cdr(message, SAMPLE_BLOCK))


def encode_description(description: StandDescription) -> bytes:
    """
    Serialise a description as a StandDescription message.

    Parameters
    ----------
    description : StandDescription

    Returns
    -------
    bytes
        CDR.

    """
    message = _new(
        'StandDescription',
        header=_header(description.stamp_ns),
        stand=description.stand,
        stream_id=description.stream_id,
        sample_rate=float(description.sample_rate),
        gravity=typestore().types['geometry_msgs/msg/Vector3'](
            *map(float, description.layout.gravity)
        ),
        channels=[_channel(sensor) for sensor in description.layout.sensors],
        machine_file=description.machine_text,
        layout_file=description.layout_text,
    )
    return bytes(typestore().serialize_cdr(message, STAND_DESCRIPTION))


def _channel(sensor: Sensor) -> Any:
    types = typestore().types
    return _new(
        'ChannelDescription',
        name=sensor.name,
        kind=getattr(types[f'{PACKAGE}/msg/ChannelDescription'], f'KIND_{sensor.kind.name}'),
        unit=sensor.kind.unit,
        body=sensor.body,
        reference_body=sensor.reference_body,
        excitation=sensor.excitation,
        point=types['geometry_msgs/msg/Point'](*map(float, sensor.point)),
        direction=types['geometry_msgs/msg/Vector3'](*map(float, sensor.direction)),
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


def _header(stamp_ns: int) -> Any:
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    if not 0 <= seconds < 2**31:
        raise DataError(
            f'a stamp is {stamp_ns} ns, expected 0 to {2**31 - 1} s; '
            'ROS messages cannot hold another time'
        )
    types = typestore().types
    stamp = types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=nanoseconds)
    return types['std_msgs/msg/Header'](stamp=stamp, frame_id=MACHINE_FRAME)


def _new(type_name: str, /, **fields: Any) -> Any:
    return typestore().types[f'{PACKAGE}/msg/{type_name}'](**fields)


def _check_known(type_name: str) -> None:
    if type_name not in typestore().types:
        raise DataError(
            f'message type {type_name} is not known; only types of ROS 2 Jazzy and of '
            f'{PACKAGE} can be written to a bag'
        )
