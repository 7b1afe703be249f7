# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Known delays of sensors, taken out by interpolation."""

from identnl_ros.core.measurement.stencils import stencil
import numpy as np
from numpy.typing import NDArray

# Interpolation and differences over 17 samples: exact to 3e-9 up to a tenth of the sample rate.
HALF_WIDTH = 8


class Aligner:
    """
    Take a constant delay out of one channel.

    Parameters
    ----------
    delay : float
        [samples].

    """

    def __init__(self, delay: float) -> None:
        whole = round(delay)
        fraction = delay - whole
        self._shift = whole
        if abs(fraction) < 1e-12:
            self._weights = np.ones(1)
            self.reach = abs(whole)
        else:
            self._weights = stencil(0, fraction, HALF_WIDTH)
            self.reach = abs(whole) + HALF_WIDTH

    def correlation(self, first: int, second: int) -> float:
        """
        Correlate two derivatives of the aligned channel, per variance of its white noise.

        Parameters
        ----------
        first, second : int
            Orders of the derivatives.

        Returns
        -------
        float
            [sample^-(first + second)].

        """
        filters = [
            np.convolve(self._weights, stencil(order, 0.0, HALF_WIDTH))
            for order in (first, second)
        ]
        return float(filters[0] @ filters[1])

    def apply(self, samples: NDArray[np.float64], start: int, count: int) -> NDArray[np.float64]:
        """
        Interpolate.

        Parameters
        ----------
        samples : ndarray, shape (n_samples,)
            With `reach` of them on both sides of those wanted.
        start, count : int
            The instants wanted.

        Returns
        -------
        ndarray, shape (count,)

        """
        first = start + self._shift
        if self._weights.size == 1:
            return samples[first : first + count]
        return convolve(samples[first - HALF_WIDTH :], self._weights, count)


def convolve(
    samples: NDArray[np.float64], weights: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """
    Weigh and add up consecutive samples, tap by tap so that every bit is reproducible.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, ...)
    weights : ndarray, shape (n_taps,)
    count : int
        Sums wanted, the first one from the first sample on.

    Returns
    -------
    ndarray, shape (count, ...)

    """
    result = np.zeros((count, *samples.shape[1:]))
    for tap, weight in enumerate(weights):
        result += weight * samples[tap : tap + count]
    return result
