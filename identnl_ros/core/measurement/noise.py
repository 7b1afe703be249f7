# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Noise of sensors whose noise nobody states, from their own samples.

Differences of a high order leave little of a smooth motion, and sums of neighbours leave nothing
at half the sample rate, where the filters of converters and of resampling take the noise away:
its density is read between the two.
"""

from functools import reduce

import numpy as np
from numpy.typing import NDArray

# Leaves of a motion at a tenth of the sample rate 3e-6 of its amplitude, of white noise all. Of
# what it leaves of that, 1.4 % lies above 0.907 of half the sample rate (where the pass band of
# delta-sigma converters ends), 0.2 % above 0.94 (where that of `resampling` does).
DIFFERENCES, SUMS = 14, 2
# Samples before one that are needed.
REACH = DIFFERENCES + SUMS


def fast_part(samples: NDArray[np.float64], differences: int = DIFFERENCES) -> NDArray[np.float64]:
    """
    Take the fastest changes out of samples, but those close to half the sample rate.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n_channels)
        NaN: no valid sample.
    differences : int
        Fewer need fewer samples in a row, and leave more of the motion; with them go fewer sums.

    Returns
    -------
    ndarray, shape (n_samples - `REACH`, n_channels)
        White noise keeps its standard deviation; NaN where a sample within reach is not valid.

    """
    sums = differences * SUMS // DIFFERENCES
    result = np.diff(samples, n=differences, axis=0)
    for _ in range(sums):
        result = result[1:] + result[:-1]
    return np.asarray(result / np.linalg.norm(_weights(differences, sums)))


def _weights(differences: int, sums: int) -> NDArray[np.float64]:
    parts = [[1.0, -1.0]] * differences + [[1.0, 1.0]] * sums
    return np.asarray(reduce(np.convolve, parts, np.ones(1)))


def _correlation() -> float:
    weights = _weights(DIFFERENCES, SUMS)
    moments = np.correlate(weights, weights, 'full')
    return float((moments**2).sum() / moments.max() ** 2)


# Mean squares of the fast part of white noise vary as if from fewer samples by this.
CORRELATION = _correlation()


class NoiseEstimate:
    """
    Running estimate of the white noise in each channel.

    The mean square of the `fast_part` of smooth motion plus white noise is that of the noise.
    Motion at high frequencies makes the estimate too large, never too small.

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
        self._tail = samples[-REACH:]
        fast = fast_part(samples)
        valid = np.isfinite(fast)
        self._squares += (np.where(valid, fast, 0.0) ** 2).sum(axis=0)
        self._counts += valid.sum(axis=0)

    @property
    def counts(self) -> NDArray[np.float64]:
        """Values that the estimate of each channel rests on, shape (n_channels,)."""
        return self._counts.copy()

    @property
    def standard_deviation(self) -> NDArray[np.float64]:
        """Of one sample of each channel; NaN before there are enough, shape (n_channels,)."""
        counts = np.where(self._counts > 0, self._counts, np.nan)
        return np.asarray(np.sqrt(self._squares / counts))
