# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Messages of a bag turned into the values of the core."""

from dataclasses import dataclass
from enum import Enum
import math
import struct
from types import SimpleNamespace
from typing import TypeVar

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.estimation.estimate import (
    CombinationEstimate,
    Estimate,
    EstimateStatus,
    ParameterEstimate,
)
from identnl_ros.core.measurement.blocks import NANOSECONDS, SampleBlock
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.mechanics.machine import STANDARD_GRAVITY
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

_Member = TypeVar('_Member', bound=Enum)


@dataclass(frozen=True)
class RecordedEstimate:
    """
    An estimate that was published while a bag was recorded.

    Parameters
    ----------
    topic : str
    stand : str
        Name of the stand.
    stream_id : int
        Stream of the last sample used.
    stamp_ns : int
        Acquisition clock at the last sample used [ns].
    last_index : int
        Running index of the last sample seen.
    stream_ended : bool
        The estimate uses all of the stream.
    estimate : Estimate

    """

    topic: str
    stand: str
    stream_id: int
    stamp_ns: int
    last_index: int
    stream_ended: bool
    estimate: Estimate


def block_from_message(message: SimpleNamespace) -> SampleBlock:
    """
    Make a block from a SampleBlock message.

    Parameters
    ----------
    message : SimpleNamespace
        With the fields of SampleBlock.msg.

    Returns
    -------
    SampleBlock
        With arrays of its own.

    Raises
    ------
    DataError
        If the message contradicts itself.

    """
    channels = message.channel_count
    if channels == 0 or message.samples.size % channels:
        raise DataError(
            f'block {message.first_sample_index}: {message.samples.size} samples do not make '
            f'whole rows of {channels} channels; the block is damaged'
        )
    return SampleBlock(
        stream_id=message.stream_id,
        stamp_ns=_stamp_ns(message),
        first_index=message.first_sample_index,
        sample_rate=message.sample_rate,
        samples=np.array(message.samples, np.float64).reshape(-1, channels),
        channel_status=np.array(message.channel_status, np.uint8),
        last=message.last_block,
    )


def block_position(data: bytes | memoryview) -> tuple[int, int, int, bool]:
    """
    Find where a block stands in its stream without touching its samples.

    Unlike `block_from_message` it knows the present SampleBlock.msg only.

    Parameters
    ----------
    data : bytes or memoryview
        A SampleBlock message in plain CDR.

    Returns
    -------
    stream_id : int
    first_index : int
        Running index of the first sample.
    next_index : int
        Running index of the sample after the last.
    last : bool
        The stream ends with this block.

    Raises
    ------
    DataError
        If the message is damaged.

    """
    try:
        order = {b'\0\0': '>', b'\0\1': '<'}[bytes(data[:2])]
        (offset,) = struct.unpack_from(order + '8xI', data, 4)  # after the stamp: frame_id
        offset += 16
        offset += (4 - offset) % 8  # alignment counts from the end of the four bytes of encoding
        stream_id, first, channels, count = struct.unpack_from(order + 'QQ8xII', data, offset)
        offset += 32
        if count:
            offset += (4 - offset) % 8 + 8 * count
        (statuses,) = struct.unpack_from(order + 'I', data, offset)
        last = data[offset + 4 + statuses]
        rows, rest = divmod(count, channels)
    except (KeyError, struct.error, IndexError, ZeroDivisionError):
        rest = 1
    if rest:
        raise DataError(f'a block of {len(data)} bytes contradicts itself; it is damaged')
    return stream_id, first, first + rows, bool(last)


def description_from_message(message: SimpleNamespace) -> StandDescription:
    """
    Make a description from a StandDescription message.

    Parameters
    ----------
    message : SimpleNamespace
        With the fields of StandDescription.msg.

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
            tuple(_sensor(channel) for channel in message.channels),
            message.stand,
            message.sample_rate,
            _gravity(message),
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
        stamp_ns=_stamp_ns(message),
    )


def estimate_from_message(topic: str, message: SimpleNamespace) -> RecordedEstimate:
    """
    Make an estimate from a ParameterEstimateArray message.

    Parameters
    ----------
    topic : str
        Where it was published.
    message : SimpleNamespace
        With the fields of ParameterEstimateArray.msg.

    Returns
    -------
    RecordedEstimate

    Raises
    ------
    DataError
        If the message contradicts itself.

    """
    size = len(message.parameters)
    if message.covariance.size != size**2:
        raise DataError(
            f'topic {topic}: an estimate of {size} parameters has {message.covariance.size} '
            f'covariances, expected {size**2}; the message is damaged'
        )
    return RecordedEstimate(
        topic=topic,
        stand=message.stand,
        stream_id=message.stream_id,
        stamp_ns=_stamp_ns(message),
        last_index=message.last_sample_index,
        stream_ended=message.stream_ended,
        estimate=Estimate(
            estimator=message.estimator,
            parameters=tuple(_parameter(parameter) for parameter in message.parameters),
            covariance=np.array(message.covariance, np.float64).reshape(size, size),
            samples=message.samples_used,
            rejected_samples=message.samples_rejected,
            residual=message.residual,
            condition_number=message.condition_number,
            combinations=tuple(
                CombinationEstimate(one.in_words, one.value, one.standard_deviation)
                for one in message.combinations
            ),
            notes=tuple(message.notes),
        ),
    )


def _sensor(channel: SimpleNamespace) -> Sensor:
    kind = _by_constant(channel, 'KIND_', channel.kind, SensorKind)
    if kind is None:
        raise DataError(
            f'channel {channel.name} measures the unknown quantity {channel.kind}, expected '
            'one of the KIND_ constants of ChannelDescription.msg'
        )
    return Sensor(
        name=channel.name,
        kind=kind,
        body=channel.body,
        point=np.array([channel.point.x, channel.point.y, channel.point.z]),
        direction=np.array([channel.direction.x, channel.direction.y, channel.direction.z]),
        reference_body=channel.reference_body,
        excitation=channel.excitation,
        column=channel.column,
        recorded_unit=channel.recorded_unit,
        gain=channel.gain,
        offset=channel.offset,
        # bags recorded before these fields were there do not have them
        drift=getattr(channel, 'drift', 0.0),
        full_scale=getattr(channel, 'full_scale', math.nan),
        reads_gravity=getattr(channel, 'reads_gravity', False),
        front_mass=getattr(channel, 'front_mass', 0.0),
        delay=channel.delay,
        resolution=getattr(channel, 'resolution', 0.0),
        noise=channel.noise_standard_deviation,
    )


def _gravity(message: SimpleNamespace) -> NDArray[np.float64]:
    vector = getattr(message, 'gravity', None)
    return np.array(STANDARD_GRAVITY if vector is None else (vector.x, vector.y, vector.z))


def _parameter(message: SimpleNamespace) -> ParameterEstimate:
    return ParameterEstimate(
        name=message.name,
        symbol=message.symbol,
        unit=message.unit,
        value=message.value,
        standard_deviation=message.standard_deviation,
        status=_by_constant(message, 'STATUS_', message.status, EstimateStatus)
        or EstimateStatus.UNKNOWN,
        note=message.note,
        lower=message.lower,
        upper=message.upper,
    )


def _by_constant(
    message: SimpleNamespace, prefix: str, number: int, members: type[_Member]
) -> _Member | None:
    """Find the member that a number stands for by the constants of the message's definition."""
    for member in members:
        if getattr(message, prefix + member.name, None) == number:
            return member
    return None


def _stamp_ns(message: SimpleNamespace) -> int:
    stamp = message.header.stamp
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)
