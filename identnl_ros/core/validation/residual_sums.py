# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sums of products of residuals and of what explains them, over averages of many lengths."""

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Samples averaged over; each is a multiple of the one before.
SCALES = (1, 4, 16, 64, 256)


class ResidualSums:
    """
    Products of all columns with one another, per channel and scale, streamed.

    An average over k samples is scaled by the root of the number of valid ones among them, so
    that white noise of unit variance keeps unit variance at every scale.

    Parameters
    ----------
    channels, columns : int

    """

    def __init__(self, channels: int, columns: int) -> None:
        self.products = np.zeros((len(SCALES), channels, columns, columns))
        """Shape (n_scales, n_channels, n_columns, n_columns)."""
        self.counts = np.zeros((len(SCALES), channels))
        """Averages with at least one valid sample, shape (n_scales, n_channels)."""
        self._rows = np.empty((0, channels, columns))
        self._valid = np.empty((0, channels), dtype=np.bool_)

    def add(self, rows: Reals, valid: NDArray[np.bool_]) -> None:
        """
        Take consecutive rows.

        Parameters
        ----------
        rows : ndarray, shape (n_samples, n_channels, n_columns)
            0 where not valid.
        valid : ndarray of bool, shape (n_samples, n_channels)

        """
        self._rows = np.concatenate((self._rows, rows))
        self._valid = np.concatenate((self._valid, valid))
        longest = SCALES[-1]
        while len(self._rows) >= longest:
            self._take(self._rows[:longest], self._valid[:longest])
            self._rows, self._valid = self._rows[longest:], self._valid[longest:]

    def close(self) -> None:
        """Take what is left at the end of a run, as far as it fills averages."""
        self._take(self._rows, self._valid)
        self._rows, self._valid = self._rows[:0], self._valid[:0]

    def _take(self, rows: Reals, valid: NDArray[np.bool_]) -> None:
        counts = valid.astype(np.float64)
        scale = 1
        for level, longer in enumerate(SCALES):
            step = longer // scale
            blocks = len(rows) // step
            rows = _summed(rows, blocks, step)
            counts = _summed(counts, blocks, step)
            scale = longer
            means = (rows / np.sqrt(np.maximum(counts, 1.0))[:, :, np.newaxis]).transpose(1, 0, 2)
            self.products[level] += means.transpose(0, 2, 1) @ means
            self.counts[level] += (counts > 0).sum(axis=0)


def _summed(table: Reals, blocks: int, step: int) -> Reals:
    """Add up every so many rows; an incomplete rest is left out."""
    if step == 1:
        return table
    return np.asarray(table[: blocks * step].reshape(blocks, step, *table.shape[1:]).sum(axis=1))
