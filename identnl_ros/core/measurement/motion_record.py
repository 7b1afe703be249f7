# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Uninterrupted runs of measured motion, kept for estimators that go over them more than once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from identnl_ros.core.measurement.blocks import MotionBlock
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Samples over which a straight line may replace the motion in a rough estimate.
LONGEST_BRIDGE = 16


@dataclass(frozen=True)
class NoiseSpan:
    """
    Consecutive instants whose noise is not that of the beginning of their record.

    Parameters
    ----------
    first_index, end_index : int
        From the first up to, not including, the end; indices of the stream.
    covariances : tuple of 3 ndarray, shape (n_coordinates, n_coordinates)
        Of displacement, velocity and acceleration at one sample.

    """

    first_index: int
    end_index: int
    covariances: tuple[Reals, Reals, Reals]

    def precedes(self, other: 'NoiseSpan') -> bool:
        """
        Tell whether another one goes on with the same noise.

        Parameters
        ----------
        other : NoiseSpan

        Returns
        -------
        bool

        """
        return self.end_index == other.first_index and same_noise(
            self.covariances, other.covariances
        )


def same_noise(one: Sequence[Reals], other: Sequence[Reals]) -> bool:
    """
    Compare covariances; unknown ones are alike.

    Parameters
    ----------
    one, other : sequence of ndarray

    Returns
    -------
    bool

    """
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True))


@dataclass(frozen=True)
class MotionRecord:
    """
    Motion and exciting force at consecutive instants.

    Parameters
    ----------
    sample_rate : float
        [Hz].
    displacement, velocity, acceleration : ndarray, shape (n_samples, n_coordinates)
        NaN in instants without a valid reading.
    force : ndarray, shape (n_samples, n_excitations)
        Of every exciter, finite [N].
    first_index : int
        Index of the first sample in its stream, which begins with index 0.
    spans : tuple of NoiseSpan
        Where the noise is not that of the beginning: sensors had no readings, or have them again.

    """

    sample_rate: float
    displacement: Reals
    velocity: Reals
    acceleration: Reals
    force: Reals
    first_index: int = 0
    spans: tuple[NoiseSpan, ...] = ()

    def __len__(self) -> int:
        """Count the samples."""
        return len(self.displacement)

    def part(self, first: int, end: int) -> 'MotionRecord':
        """
        Cut out consecutive instants.

        Parameters
        ----------
        first, end : int
            From the first up to, not including, the end.

        Returns
        -------
        MotionRecord

        """
        part = self._with(*(table[first:end] for table in self._tables))
        begin, last = self.first_index + first, self.first_index + min(end, len(self))
        spans = [
            replace(
                span,
                first_index=max(span.first_index, begin),
                end_index=min(span.end_index, last),
            )
            for span in self.spans
            if span.first_index < last and begin < span.end_index
        ]
        return replace(part, first_index=begin, spans=tuple(spans))

    def with_noise(self, covariances: tuple[Reals, Reals, Reals]) -> 'MotionRecord':
        """
        State the noise of all instants.

        Parameters
        ----------
        covariances : tuple of 3 ndarray, shape (n_coordinates, n_coordinates)
            Of displacement, velocity and acceleration at one sample.

        Returns
        -------
        MotionRecord

        """
        span = NoiseSpan(self.first_index, self.first_index + len(self), covariances)
        return replace(self, spans=(span,))

    def followed_by(self, *others: 'MotionRecord') -> 'MotionRecord':
        """
        Append the instants that come next.

        Parameters
        ----------
        *others : MotionRecord
            In order of time.

        Returns
        -------
        MotionRecord

        """
        tables = zip(self._tables, *(other._tables for other in others), strict=True)
        spans: list[NoiseSpan] = []
        for span in (one for record in (self, *others) for one in record.spans):
            if spans and spans[-1].precedes(span):
                spans[-1] = replace(spans[-1], end_index=span.end_index)
            else:
                spans.append(span)
        whole = self._with(*(np.concatenate(parts) for parts in tables))
        return replace(whole, spans=tuple(spans))

    @property
    def time(self) -> Reals:
        """Time of the samples since the begin of the stream [s], shape (n_samples,)."""
        return np.asarray((self.first_index + np.arange(len(self))) / self.sample_rate)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Instants with a valid reading, shape (n_samples,)."""
        return np.asarray(np.isfinite(self.displacement).all(axis=1))

    def bridged(self) -> 'MotionRecord':
        """
        Fill short gaps by straight lines: for what needs an unbroken record, not exact numbers.

        Returns
        -------
        MotionRecord

        """
        valid = np.flatnonzero(self.valid)
        if len(valid) in (0, len(self)):
            return self
        index = np.arange(len(self))
        following = np.minimum(np.searchsorted(valid, index), len(valid) - 1)
        before = np.maximum(np.searchsorted(valid, index, side='right') - 1, 0)
        near = valid[following] - valid[before] <= LONGEST_BRIDGE
        near &= (valid[0] <= index) & (index <= valid[-1])
        tables = []
        for table in self._tables[:3]:
            lines = np.column_stack([np.interp(index, valid, one[valid]) for one in table.T])
            tables.append(np.where(near[:, np.newaxis], lines, np.nan))
        displacement, velocity, acceleration = tables
        return self._with(displacement, velocity, acceleration, self.force)

    @property
    def _tables(self) -> tuple[Reals, Reals, Reals, Reals]:
        return self.displacement, self.velocity, self.acceleration, self.force

    def _with(
        self, displacement: Reals, velocity: Reals, acceleration: Reals, force: Reals
    ) -> 'MotionRecord':
        return replace(
            self,
            displacement=displacement,
            velocity=velocity,
            acceleration=acceleration,
            force=force,
        )


def records_of(block: MotionBlock, directions: Reals) -> list[MotionRecord]:
    """
    Cut a block where the force is missing: without it there is nothing to simulate with.

    Parameters
    ----------
    block : MotionBlock
    directions : ndarray, shape (n_excitations, n_coordinates)
        Generalised force per newton of each exciter.

    Returns
    -------
    list of MotionRecord
        Those between the samples without force, in order; an empty one marks where a gap is.

    """
    motion = np.stack((block.displacement, block.velocity, block.acceleration))
    # What is differentiated lacks more samples than the sensors do, and is not used.
    measured = [True, not block.velocity_derived, not block.acceleration_derived]
    motion[:, ~np.isfinite(motion[measured]).all(axis=(0, 2))] = np.nan
    force = block.force @ np.linalg.pinv(directions)
    displacement, velocity, acceleration = motion
    whole = MotionRecord(
        block.sample_rate, displacement, velocity, acceleration, force, block.first_index
    )
    missing = np.flatnonzero(~np.isfinite(force).all(axis=1))
    borders = [-1, *missing.tolist(), len(force)]
    return [whole.part(first + 1, end) for first, end in pairwise(borders)]
