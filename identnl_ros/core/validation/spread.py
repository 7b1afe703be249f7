# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Mean and spread of streamed channels."""

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


class Spread:
    """
    Mean and spread of channels, from samples that come in parts.

    Parameters
    ----------
    channels : int

    """

    def __init__(self, channels: int) -> None:
        self._count = np.zeros(channels)
        self._mean = np.zeros(channels)
        self._squares = np.zeros(channels)

    def add(self, samples: Reals, valid: NDArray[np.bool_]) -> None:
        """
        Take more samples (Chan, Golub and LeVeque 1983).

        Parameters
        ----------
        samples : ndarray, shape (n_samples, n_channels)
        valid : ndarray of bool, the same shape

        """
        count = valid.sum(axis=0)
        mean = np.where(valid, samples, 0.0).sum(axis=0) / np.maximum(count, 1)
        squares = (np.where(valid, samples - mean, 0.0) ** 2).sum(axis=0)
        total = np.maximum(self._count + count, 1)
        apart = mean - self._mean
        self._squares += squares + apart**2 * self._count * count / total
        self._mean += apart * count / total
        self._count = self._count + count

    @property
    def deviation(self) -> Reals:
        """Root mean square about the mean, shape (n_channels,)."""
        return np.asarray(np.sqrt(self._squares / np.maximum(self._count, 1)))
