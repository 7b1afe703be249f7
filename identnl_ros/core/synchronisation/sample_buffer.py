# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The newest samples of a stream in one piece, each copied once or twice."""

import numpy as np
from numpy.typing import NDArray


class SampleBuffer:
    """
    A queue of samples that may be read anywhere.

    Parameters
    ----------
    channels : int

    """

    def __init__(self, channels: int) -> None:
        self._table = np.empty((0, channels))
        self._begin = self._end = 0

    @property
    def samples(self) -> NDArray[np.float64]:
        """Those that are kept, shape (n_samples, n_channels); a view until the next `add`."""
        return self._table[self._begin : self._end]

    def add(self, samples: NDArray[np.float64]) -> None:
        """
        Take the next samples.

        Parameters
        ----------
        samples : ndarray, shape (n_samples, n_channels)

        """
        end = self._end + len(samples)
        if end > len(self._table):
            kept = self.samples
            # Twice the room: copied again only when as many have come as are kept.
            table = np.empty((2 * (len(kept) + len(samples)), self._table.shape[1]))
            table[: len(kept)] = kept
            self._table, self._begin, self._end = table, 0, len(kept)
            end = self._end + len(samples)
        self._table[self._end : end] = samples
        self._end = end

    def drop(self, count: int) -> None:
        """
        Let go of the oldest.

        Parameters
        ----------
        count : int
            At most as many as there are.

        """
        self._begin += count
