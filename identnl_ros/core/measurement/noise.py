# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Noise of sensors whose noise nobody states, from their own samples."""

from math import comb

import numpy as np
from numpy.typing import NDArray

# Differences of this order leave of a motion at a tenth of the sample rate 1e-5 of its
# amplitude, of white noise all; what a motion has near half the sample rate counts as noise.
DIFFERENCE_ORDER = 10


class NoiseEstimate:
    """
    Running estimate of the white noise in each channel.

    The mean square of a high-order difference of smooth motion plus white noise is that of the
    noise times a known number (the binomial coefficient of the order). Motion at high
    frequencies makes the estimate too large, never too small.

    Parameters
    ----------
    channels : int

    """

    def __init__(self, channels: int) -> None:
        self._squares = np.zeros(channels)
        self._counts = np.zeros(channels)
        self.restart()

    def restart(self) -> None:
        """Expect samples that do not follow those before."""
        self._tail = np.empty((0, len(self._squares)))

    def add(self, samples: NDArray[np.float64]) -> None:
        """
        Take consecutive samples.

        Parameters
        ----------
        samples : ndarray, shape (n_samples, n_channels)
            NaN: no valid sample.

        """
        samples = np.concatenate((self._tail, samples))
        self._tail = samples[-DIFFERENCE_ORDER:]
        difference = np.diff(samples, n=DIFFERENCE_ORDER, axis=0)
        valid = np.isfinite(difference)
        self._squares += (np.where(valid, difference, 0.0) ** 2).sum(axis=0)
        self._counts += valid.sum(axis=0)

    @property
    def counts(self) -> NDArray[np.float64]:
        """Differences that the estimate of each channel rests on, shape (n_channels,)."""
        return self._counts.copy()

    @property
    def standard_deviation(self) -> NDArray[np.float64]:
        """Of one sample of each channel; NaN before there are enough, shape (n_channels,)."""
        gain = comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER)
        counts = np.where(self._counts > 0, self._counts, np.nan)
        return np.asarray(np.sqrt(self._squares / (counts * gain)))
