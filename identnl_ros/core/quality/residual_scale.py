# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Running size of what no smooth motion explains: noise, and motion at high frequencies."""

from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

DIFFERENCE_ORDER = 10
# Samples on either side of one that its difference takes in.
REACH = DIFFERENCE_ORDER // 2
# Of the difference, and of the sum of two neighbouring ones, per variance of white noise.
GAIN = float(np.sqrt(comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER)))
PAIR_GAIN = float(
    np.sqrt(
        2 * comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER)
        - 2 * comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER - 1)
    )
)
MEDIAN_OF_ABSOLUTE = float(norm.ppf(0.75))
# One difference in so many is looked at: neighbours tell little more.
SPARSE = 4
RECENT, LONG = 8, 64  # stretches


class ResidualScale:
    """
    Standard deviation, per sample, of what a high-order difference leaves of each channel.

    Statistic: median of the absolute tenth differences of a stretch, over that of white noise
    of standard deviation one; of the last `RECENT` stretches, and of the last `LONG`, the
    median. For white noise that is its standard deviation; a blow or a fault in less than half
    of the stretches does not change it, lasting motion at high frequencies raises it.

    Parameters
    ----------
    channels : int

    """

    def __init__(self, channels: int) -> None:
        self._stretches = np.full((LONG, channels), np.nan)
        self._next = 0
        self.recent = np.full(channels, np.nan)
        self.lasting = np.full(channels, np.nan)

    def add(self, differences: NDArray[np.float64]) -> None:
        """
        Take the tenth differences of a stretch.

        Parameters
        ----------
        differences : ndarray, shape (n_samples, n_channels)
            NaN where a sample is missing.

        """
        if len(differences):
            size = median_of_valid(np.abs(differences[::SPARSE])) / (MEDIAN_OF_ABSOLUTE * GAIN)
            self._stretches[self._next % LONG] = size
            self._next += 1
            newest = np.arange(self._next - RECENT, self._next) % LONG
            self.recent = median_of_valid(self._stretches[newest])
            if self._next % RECENT == 1:
                self.lasting = median_of_valid(self._stretches)


def median_of_valid(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Median of every column, without its NaN; of an even number the lower one.

    Parameters
    ----------
    values : ndarray, shape (n_rows, n_columns)
        At least one row.

    Returns
    -------
    ndarray, shape (n_columns,)
        NaN where a column has no number.

    """
    ordered = np.sort(values, axis=0)  # NaN last
    valid = np.isfinite(ordered).sum(axis=0)
    return np.asarray(ordered[np.maximum(valid - 1, 0) // 2, np.arange(values.shape[1])])
