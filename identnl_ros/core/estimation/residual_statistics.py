# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Tell whether the deviation of measurement from simulation is sensor noise and nothing else.

Sensor noise is white; what a model lacks moves with the machine, slowly beside the sample rate.
The noise is therefore read off the fastest changes of the residual, and averages over a few
samples must be as small as that noise makes them.
"""

from identnl_ros.core.measurement.noise import CORRELATION, fast_part, REACH
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

TABLES = 5
# Samples less noisy than stated by more than this factor count as that noisy: what remains is
# then the arithmetic's, or does not matter beside the stated noise.
QUIETEST = 0.1


class ResidualStatistics:
    """
    Sums over whitened residuals: all, averaged over a few samples, and their fastest changes.

    The averages are summed twice: all alike, and weighted with how much the machine moves, so that
    rest does not hide what shows only in motion.

    Parameters
    ----------
    channels : int
    average : int
        Samples to average over.

    """

    def __init__(self, channels: int, average: int) -> None:
        self._average = average
        self._tail = np.empty((0, channels))
        # Residuals, averages, fast part, weighted averages; squares of these weights.
        self._sums = np.zeros((TABLES, channels))
        self._counts = np.zeros((TABLES, channels))

    @classmethod
    def of(cls, tables: Reals, average: int) -> 'ResidualStatistics':
        """
        Continue from what has been gathered before.

        Parameters
        ----------
        tables : ndarray, shape (2, 5, n_channels)
            Of three rows where nothing was weighted.
        average : int

        Returns
        -------
        ResidualStatistics

        """
        statistics = cls(tables.shape[2], average)
        statistics._sums[: tables.shape[1]], statistics._counts[: tables.shape[1]] = tables
        return statistics

    @property
    def tables(self) -> Reals:
        """Sums of squares and their counts: residuals, averages, fast part, weighted averages."""
        return np.stack((self._sums, self._counts))

    @property
    def average(self) -> int:
        """Samples to average over."""
        return self._average

    @property
    def channels(self) -> int:
        """Number of residuals at an instant."""
        return int(self._sums.shape[1])

    def restart(self) -> None:
        """Expect residuals that do not follow those before."""
        self._tail = self._tail[:0]

    def add(
        self, residuals: Reals, places: NDArray[np.int_] | None = None, energy: float = 0.0
    ) -> None:
        """
        Take consecutive residuals.

        Parameters
        ----------
        residuals : ndarray, shape (n_samples, n_residuals)
            Of unit variance if the stated noise is right; NaN: no valid sample.
        places : ndarray of int, shape (n_residuals,), or None
            Channel of every residual; the other channels have none. None: as they come.
        energy : float
            Mean square of the simulated motion: weight of these averages among all.

        """
        if places is not None:
            table = np.full((len(residuals), self.channels), np.nan)
            table[:, places] = residuals
            residuals = table
        count = len(residuals) // self._average
        shape = count, self._average, residuals.shape[1]
        averages = residuals[: count * self._average].reshape(shape)
        joined = np.concatenate((self._tail, residuals))
        self._tail = residuals[-REACH:]
        for row, table in enumerate(
            (
                residuals,
                averages.mean(axis=1) * np.sqrt(self._average),
                fast_part(joined),
            )
        ):
            valid = np.isfinite(table)
            self._sums[row] += (np.where(valid, table, 0.0) ** 2).sum(axis=0)
            self._counts[row] += valid.sum(axis=0)
            if row == 1:
                squares = (np.where(valid, table, 0.0) ** 2).sum(axis=0)
                self._sums[3] += energy * squares
                self._counts[3] += energy * valid.sum(axis=0)
                self._sums[4] += energy**2 * valid.sum(axis=0)

    def discount(self, share: float) -> None:
        """
        Let everything so far count less.

        Parameters
        ----------
        share : float
            From 0 to 1.

        """
        self._sums *= share
        # Weights shrink, and their squares do twice.
        self._sums[4] *= share
        self._counts *= share

    def merge(self, other: 'ResidualStatistics') -> None:
        """
        Take the residuals that others have gathered, of the same channels.

        Parameters
        ----------
        other : ResidualStatistics

        """
        self._sums += other._sums
        self._counts += other._counts
        self._tail = other._tail

    @property
    def noise(self) -> Reals:
        """Noise in the samples over the stated one, of every channel; NaN: too few samples."""
        counts = np.where(self._counts[2] > 0, self._counts[2], np.nan)
        return np.asarray(np.sqrt(self._sums[2] / counts))

    @property
    def excess(self) -> float:
        """Root mean square of the residuals over the stated noise."""
        total = self._counts[0].sum()
        return float(np.sqrt(self._sums[0].sum() / total)) if total else float('nan')

    def slow_excess(self, fitted: int, quietest: float = QUIETEST) -> tuple[float, float]:
        """
        Compare the slow part of the residuals with their noise.

        Parameters
        ----------
        fitted : int
            Numbers that were fitted to these data.
        quietest : float
            Channels less noisy than that, in units of the stated noise, count as that noisy.

        Returns
        -------
        ratio : float
            Mean square of the averages over what the noise makes them; 1 where nothing is
            missing, NaN where there are too few samples.
        deviation : float
            Standard deviation of the ratio, if nothing is missing.

        """
        used = (self._counts[1] > 0) & (self._counts[2] > 2 * REACH)
        slow, fast = self._counts[1:3, used]
        if slow.sum() <= 2 * fitted:
            return float('nan'), float('nan')
        noise = np.maximum(self._sums[2, used] / fast, quietest**2)
        ratios = self._sums[1, used] / noise
        # What the fit has absorbed is not all slow; without making up for it the test is a little
        # cautious on short records, and raises no false alarms.
        free = slow.sum()
        # Averages and the noise they are compared with: both are uncertain.
        variance = 2 / free + (2 * CORRELATION / fast * (slow / slow.sum()) ** 2).sum()
        return float(ratios.sum() / free), float(np.sqrt(variance))

    def moving_excess(self, fitted: int, quietest: float = QUIETEST) -> tuple[float, float]:
        """
        Compare the slow part of the residuals with their noise, where the machine moves.

        Parameters
        ----------
        fitted : int
            Numbers that were fitted to these data.
        quietest : float
            As for `slow_excess`.

        Returns
        -------
        ratio, deviation : float
            As of `slow_excess`, of averages weighted with the energy of the motion.

        """
        used = (self._counts[3] > 0) & (self._counts[2] > 2 * REACH)
        weight, fast = self._counts[3, used], self._counts[2, used]
        whole = weight.sum()
        # As many averages of one weight would vary as much.
        if not whole or whole**2 / self._sums[4, used].sum() <= 2 * fitted:
            return float('nan'), float('nan')
        noise = np.maximum(self._sums[2, used] / fast, quietest**2)
        ratio = float((self._sums[3, used] / noise).sum() / whole)
        variance = 2 * self._sums[4, used].sum() / whole**2
        variance += (2 * CORRELATION / fast * (weight / whole) ** 2).sum()
        return ratio, float(np.sqrt(variance))
