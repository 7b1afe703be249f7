# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Blocks of samples: what travels from the sensors to the identifier, live and from a bag."""

from dataclasses import dataclass
from enum import IntFlag

from identnl_ros.core.errors import DataError
import numpy as np
from numpy.typing import NDArray

NANOSECONDS = 1_000_000_000
BLOCK_DURATION = 0.01  # [s]
SMALLEST_BLOCK = 50  # samples
# Beyond this index, a time as a floating-point number tells instants no better than to 1/32 of a
# sample; at 1 MHz, it is reached after nine years.
LARGEST_INDEX = 2**48
# No number in SI that a sensor of a machine reads is larger; of such, products overflow.
LARGEST_READING = 1e30
MOTION = ('displacement', 'velocity', 'acceleration', 'force')


class ChannelStatus(IntFlag):
    """Condition of one channel in one block; the values are those of SampleBlock.msg."""

    OK = 0
    MISSING_SAMPLES = 1
    SATURATED = 2


@dataclass(frozen=True)
class SampleBlock:
    """
    Synchronised samples of all channels of a stand.

    Parameters
    ----------
    stream_id : int
        The same for all blocks of one uninterrupted source.
    stamp_ns : int
        Time of the first sample on the acquisition clock [ns].
    first_index : int
        Running index of the first sample.
    sample_rate : float
        [Hz].
    samples : ndarray, shape (n_samples, n_channels)
        SI units; NaN where there is no valid sample.
    channel_status : ndarray of uint8, shape (n_channels,)
        Bits of `ChannelStatus`.
    last : bool
        Nothing follows in this stream.

    Raises
    ------
    DataError
        If shapes disagree, the sample rate is not positive or the index is negative or too large.

    """

    stream_id: int
    stamp_ns: int
    first_index: int
    sample_rate: float
    samples: NDArray[np.float64]
    channel_status: NDArray[np.uint8]
    last: bool = False

    def __post_init__(self) -> None:
        """Check what every consumer relies on."""
        _check_head(self.first_index, self.sample_rate)
        if self.samples.ndim != 2:
            raise DataError(
                f'block {self.first_index}: samples must be a table [sample, channel], '
                f'found {self.samples.ndim} dimension(s)'
            )
        if self.channel_status.shape != (self.samples.shape[1],):
            raise DataError(
                f'block {self.first_index}: {self.samples.shape[1]} channels but '
                f'{self.channel_status.size} channel states; the block is damaged'
            )

    @property
    def next_index(self) -> int:
        """Index of the first sample after this block."""
        return self.first_index + int(self.samples.shape[0])

    def require(self, channels: int, sample_rate: float) -> None:
        """
        Make sure that the block is of the stream it is taken for.

        Parameters
        ----------
        channels : int
            Of the layout.
        sample_rate : float
            Of the stream [Hz].

        Raises
        ------
        DataError
            If it has others.

        """
        if self.samples.shape[1] != channels:
            raise DataError(
                f'block {self.first_index}: {self.samples.shape[1]} channels, '
                f'the layout has {channels}; is another source publishing on the topic?'
            )
        if self.sample_rate != sample_rate:
            raise DataError(
                f'block {self.first_index}: sample rate {self.sample_rate} Hz, '
                f'the stream has {sample_rate} Hz'
            )


@dataclass(frozen=True)
class MotionBlock:
    """
    Motion of all bodies and the force on them, along their principal central axes.

    Parameters
    ----------
    stream_id, stamp_ns, first_index, sample_rate, last
        As in `SampleBlock`; several motion blocks may come from one sample block.
    coordinates : tuple of str
        Names of the columns, e.g. ``knee.rotation_3``.
    displacement, velocity, acceleration, force : ndarray, shape (n_samples, n_coordinates)
        [m, rad], [m/s, rad/s], [m/s^2, rad/s^2], [N, N m]; NaN: not known at this sample.
    displacement_covariance, velocity_covariance, acceleration_covariance, force_covariance,
    displacement_acceleration_covariance :
        ndarray, shape (n_coordinates, n_coordinates). Covariance of one sample under the
        sensors' noise; NaN while that is neither stated nor estimated. The last one is of
        displacement (rows) with acceleration (columns).
    noise_estimated : bool
        Some sensor's noise is not stated but estimated from its samples.
    velocity_derived, acceleration_derived : bool
        At least partly the first, second derivative of displacement, not measured.
    contradictions : tuple of str
        Sensors that have contradicted the motion of rigid bodies so far, in sentences.

    Raises
    ------
    DataError
        If shapes disagree, the sample rate is not positive or the index is negative or too large.

    """

    stream_id: int
    stamp_ns: int
    first_index: int
    sample_rate: float
    coordinates: tuple[str, ...]
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    force: NDArray[np.float64]
    displacement_covariance: NDArray[np.float64]
    velocity_covariance: NDArray[np.float64]
    acceleration_covariance: NDArray[np.float64]
    force_covariance: NDArray[np.float64]
    displacement_acceleration_covariance: NDArray[np.float64]
    noise_estimated: bool = False
    velocity_derived: bool = False
    acceleration_derived: bool = False
    contradictions: tuple[str, ...] = ()
    last: bool = False

    def __post_init__(self) -> None:
        """Check what every consumer relies on."""
        _check_head(self.first_index, self.sample_rate)
        n_coordinates = len(self.coordinates)
        shape = (self.displacement.shape[0], n_coordinates)
        for name in MOTION:
            found = getattr(self, name).shape
            if found != shape:
                raise DataError(
                    f'motion block {self.first_index}: {name} is {found}, expected {shape} '
                    '[sample, coordinate]; the block is damaged'
                )
        for name in (*MOTION, 'displacement_acceleration'):
            found = getattr(self, f'{name}_covariance').shape
            if found != (n_coordinates, n_coordinates):
                raise DataError(
                    f'motion block {self.first_index}: the covariance of {name} is {found}, '
                    f'expected {(n_coordinates, n_coordinates)}; the block is damaged'
                )

    @property
    def next_index(self) -> int:
        """Index of the first sample after this block."""
        return self.first_index + int(self.displacement.shape[0])


def samples_per_block(sample_rate: float) -> int:
    """
    Choose how many samples travel together.

    Parameters
    ----------
    sample_rate : float
        [Hz].

    Returns
    -------
    int
        `BLOCK_DURATION`, but at least `SMALLEST_BLOCK`.

    """
    return max(SMALLEST_BLOCK, round(BLOCK_DURATION * sample_rate))


def stamp_after(stamp_ns: int, samples: int, sample_rate: float) -> int:
    """
    Time of a sample a number of samples after a stamped one.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the earlier sample [ns].
    samples : int
        How many samples later.
    sample_rate : float
        [Hz].

    Returns
    -------
    int
        [ns].

    """
    return stamp_ns + round(samples / sample_rate * NANOSECONDS)


def _check_head(first_index: int, sample_rate: float) -> None:
    if first_index < 0:
        raise DataError(f'block: the first sample index is {first_index}, expected 0 or more')
    if first_index > LARGEST_INDEX:
        raise DataError(
            f'block: the first sample index is {first_index}, expected no more than '
            f'{LARGEST_INDEX}; let the source count from the begin of the stream'
        )
    if not (np.isfinite(sample_rate) and sample_rate > 0):
        raise DataError(
            f'block {first_index}: the sample rate is {sample_rate} Hz, expected a positive number'
        )
