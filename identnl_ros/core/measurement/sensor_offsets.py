# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What sensors that see the same motion show differently on average: their unknown offsets."""

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Instants that count: as many of the latest as this, up to twice as many.
RECENT = 2**15
# A mean is one where it exceeds its standard error by this factor in a channel, over at least so
# many instants; below that, subtracting it would add more error than it removes.
SIGNIFICANT = 5.0
FEWEST = 16


class SensorOffsets:
    """
    Running mean of what a least-squares fit to redundant sensors leaves in every channel.

    Sums grow instant by instant, so that the result does not depend on how they arrive.

    Parameters
    ----------
    channels : int

    """

    def __init__(self, channels: int) -> None:
        self._count = 0
        self._sums = np.zeros((2, channels))

    def follow(self, residuals: Reals, places: NDArray[np.int_]) -> Reals:
        """
        Take the residuals of consecutive instants.

        Parameters
        ----------
        residuals : ndarray, shape (n_samples, n_channels)
        places : ndarray of int, shape (n_places,)
            Ascending; at how many of these instants offsets are wanted.

        Returns
        -------
        ndarray, shape (n_places, n_channels)
            Offsets as known after so many of the instants; zero where they are not significant.

        """
        offsets = np.zeros((len(places), residuals.shape[1]))
        first = 0
        while True:
            count = min(len(residuals) - first, 2 * RECENT - self._count)
            part = residuals[first : first + count]
            sums = np.empty((count + 1, *self._sums.shape))
            sums[0], sums[1:, 0], sums[1:, 1] = self._sums, part, part**2
            np.cumsum(sums, axis=0, out=sums)
            last = first + count == len(residuals)
            if len(places):
                here = (places >= first) & ((places < first + count) | last)
                counts = self._count + places[here] - first
                offsets[here] = _significant(sums[places[here] - first], counts)
            self._count, self._sums = self._count + count, sums[-1].copy()
            if self._count == 2 * RECENT:
                self._count, self._sums = RECENT, self._sums / 2
            first += count
            if last:
                return offsets

    @property
    def present(self) -> Reals:
        """Offsets as known now, shape (n_channels,)."""
        return np.asarray(_significant(self._sums[np.newaxis], np.array([self._count]))[0])


def _significant(sums: Reals, counts: NDArray[np.int_]) -> Reals:
    """Means, all zero where none of them is beyond chance; sums of values and of squares."""
    number = np.maximum(counts, 1)[:, np.newaxis]
    mean: Reals = sums[:, 0] / number
    variance: Reals = np.maximum(sums[:, 1] / number - mean**2, 0.0)
    beyond = (np.abs(mean) * np.sqrt(number) > SIGNIFICANT * np.sqrt(variance)).any(axis=1)
    kept = beyond & (counts >= FEWEST)
    return np.asarray(np.where(kept[:, np.newaxis], mean, 0.0))
