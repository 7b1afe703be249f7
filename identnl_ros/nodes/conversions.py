# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Blocks as messages and back, to the last bit."""

from array import array
from typing import Any

from builtin_interfaces.msg import Time
from identnl_msgs.msg import BodyMotionBlock, SampleBlock as SampleBlockMessage
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import MotionBlock, NANOSECONDS, SampleBlock
import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

MACHINE_FRAME = 'machine'
LAST_SECOND = 2**31 - 1

# Fields of MotionBlock and of BodyMotionBlock.msg: tables with a row a sample, then covariances.
_QUANTITIES = {
    'displacement': 'displacement',
    'velocity': 'velocity',
    'acceleration': 'acceleration',
    'force': 'generalised_force',
}
_TABLES = {
    **_QUANTITIES,
    **{f'{name}_covariance': f'{field}_covariance' for name, field in _QUANTITIES.items()},
    'displacement_acceleration_covariance': 'displacement_acceleration_covariance',
}


def to_header(stamp_ns: int) -> Header:
    """
    Make a header in the machine frame.

    Parameters
    ----------
    stamp_ns : int
        [ns].

    Returns
    -------
    Header

    Raises
    ------
    DataError
        If a message cannot hold the time.

    """
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    if not 0 <= seconds <= LAST_SECOND:
        raise DataError(
            f'a stamp is {stamp_ns} ns, expected 0 to {LAST_SECOND} s; '
            'ROS messages cannot hold another time'
        )
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=MACHINE_FRAME)


def stamp_ns(header: Header) -> int:
    """
    Read the stamp of a header.

    Parameters
    ----------
    header : Header

    Returns
    -------
    int
        [ns].

    """
    return int(header.stamp.sec * NANOSECONDS + header.stamp.nanosec)


def block_to_message(block: SampleBlock) -> SampleBlockMessage:
    """
    Make a message of a block of samples.

    Parameters
    ----------
    block : SampleBlock

    Returns
    -------
    identnl_msgs.msg.SampleBlock

    """
    return SampleBlockMessage(
        header=to_header(block.stamp_ns),
        stream_id=block.stream_id,
        first_sample_index=block.first_index,
        sample_rate=block.sample_rate,
        channel_count=block.samples.shape[1],
        samples=doubles(block.samples),
        channel_status=array('B', block.channel_status.tobytes()),
        last_block=block.last,
    )


def block_from_message(message: SampleBlockMessage) -> SampleBlock:
    """
    Make a block of samples from a message.

    Parameters
    ----------
    message : identnl_msgs.msg.SampleBlock

    Returns
    -------
    SampleBlock
        With arrays of its own.

    Raises
    ------
    DataError
        If the message contradicts itself.

    """
    channels, length = message.channel_count, len(message.samples)
    if channels == 0 or length % channels:
        raise DataError(
            f'block {message.first_sample_index}: {length} samples do not make whole rows of '
            f'{channels} channels; the block is damaged'
        )
    return SampleBlock(
        stream_id=message.stream_id,
        stamp_ns=stamp_ns(message.header),
        first_index=message.first_sample_index,
        sample_rate=message.sample_rate,
        samples=np.array(message.samples, np.float64).reshape(-1, channels),
        channel_status=np.array(message.channel_status, np.uint8),
        last=message.last_block,
    )


def motion_to_message(block: MotionBlock) -> BodyMotionBlock:
    """
    Make a message of a block of body motion.

    Parameters
    ----------
    block : MotionBlock

    Returns
    -------
    identnl_msgs.msg.BodyMotionBlock

    """
    tables = {field: doubles(getattr(block, name)) for name, field in _TABLES.items()}
    return BodyMotionBlock(
        header=to_header(block.stamp_ns),
        stream_id=block.stream_id,
        first_sample_index=block.first_index,
        sample_rate=block.sample_rate,
        coordinates=list(block.coordinates),
        **tables,
        noise_estimated=block.noise_estimated,
        velocity_derived=block.velocity_derived,
        acceleration_derived=block.acceleration_derived,
        contradictions=list(block.contradictions),
        last_block=block.last,
    )


def motion_from_message(message: BodyMotionBlock) -> MotionBlock:
    """
    Make a block of body motion from a message.

    Parameters
    ----------
    message : identnl_msgs.msg.BodyMotionBlock

    Returns
    -------
    MotionBlock
        With arrays of its own.

    Raises
    ------
    DataError
        If the message contradicts itself.

    """
    where = f'motion block {message.first_sample_index}'
    columns = len(message.coordinates)
    if columns == 0:
        raise DataError(f'{where}: no coordinates; the block is damaged')
    tables: dict[str, Any] = {
        name: _table(message, field, columns, where) for name, field in _TABLES.items()
    }
    return MotionBlock(
        stream_id=message.stream_id,
        stamp_ns=stamp_ns(message.header),
        first_index=message.first_sample_index,
        sample_rate=message.sample_rate,
        coordinates=tuple(message.coordinates),
        **tables,
        noise_estimated=message.noise_estimated,
        velocity_derived=message.velocity_derived,
        acceleration_derived=message.acceleration_derived,
        contradictions=tuple(message.contradictions),
        last=message.last_block,
    )


def doubles(values: NDArray[np.float64]) -> 'array[float]':
    """
    Make the value of a float64[] field.

    Parameters
    ----------
    values : ndarray

    Returns
    -------
    array
        Row after row.

    """
    # An array of the module array is taken as it is; a list or ndarray is checked item by item.
    return array('d', np.ascontiguousarray(values, np.float64).tobytes())


def _table(message: Any, field: str, columns: int, where: str) -> NDArray[np.float64]:
    values = getattr(message, field)
    if len(values) % columns:
        raise DataError(
            f'{where}: {len(values)} numbers of {field} do not make whole rows of {columns} '
            'coordinates; the block is damaged'
        )
    return np.array(values, np.float64).reshape(-1, columns)
