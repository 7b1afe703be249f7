# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Range of every channel over the last second, and whether it moves as much as usual."""

import numpy as np
from numpy.typing import NDArray

MEMORY = 1.0  # [s]
STRETCH = 128  # samples, about
LEAST_STRETCHES = 8
# A range of so many steps or standard deviations is motion.
WIDE = 12.0
# Of the usual range of a stretch: what counts as moving on.
USUAL_SHARE = 0.5
RENEWED = 8  # stretches


class RecentRange:
    """
    Largest and smallest values of the stretches of about the last second.

    Parameters
    ----------
    channels : int
    sample_rate : float
        [Hz].

    """

    def __init__(self, channels: int, sample_rate: float) -> None:
        count = max(LEAST_STRETCHES, round(MEMORY * sample_rate / STRETCH))
        self._tops = np.full((count, channels), -np.inf)
        self._bottoms = np.full((count, channels), np.inf)
        self._ties = np.zeros((2, count, channels), dtype=np.intp)
        self._next = 0
        self.usual = np.zeros(channels)
        self.moving = np.zeros(channels, dtype=bool)
        # Samples of the last second that have the largest, the smallest value.
        self.at_top = self.at_bottom = np.zeros(channels, dtype=np.intp)

    def add(
        self, values: NDArray[np.float64], spread: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """
        Take a stretch.

        Parameters
        ----------
        values : ndarray, shape (n_samples, n_channels)
            NaN: no valid sample.
        spread : ndarray, shape (n_channels,)
            Size of noise and converter steps.

        Returns
        -------
        top, bottom : ndarray, shape (n_channels,)
            Of the last second, with this stretch.
        wide : ndarray of bool, shape (n_channels,)
            Whether that is much more than noise.

        """
        row = self._next % len(self._tops)
        self._tops[row] = np.fmax.reduce(values, axis=0, initial=-np.inf)
        self._bottoms[row] = np.fmin.reduce(values, axis=0, initial=np.inf)
        self._ties[:, row] = (
            (values == self._tops[row]).sum(axis=0),
            (values == self._bottoms[row]).sum(axis=0),
        )
        self._next += 1
        span = np.maximum(self._tops[row] - self._bottoms[row], 0.0)
        if self._next % RENEWED == 1:
            filled = slice(0, min(self._next, len(self._tops)))
            spans = np.maximum(self._tops[filled] - self._bottoms[filled], 0.0)
            self.usual = np.sort(spans, axis=0)[len(spans) // 2]
        self.moving = (span >= USUAL_SHARE * self.usual) & (span > WIDE * spread)
        top, bottom = self._tops.max(axis=0), self._bottoms.min(axis=0)
        self.at_top = np.where(self._tops == top, self._ties[0], 0).sum(axis=0)
        self.at_bottom = np.where(self._bottoms == bottom, self._ties[1], 0).sum(axis=0)
        return top, bottom, np.asarray(top - bottom > WIDE * spread)
