# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Rows of samples that were delivered before: a buffer read twice, a row held."""

from collections import deque

from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.mark import chance_per_sample, Mark
import numpy as np
from numpy.typing import NDArray

# Rows remembered: 1.6 s at 10 kHz.
MEMORY = 2**14
# One channel of arbitrary fine resolution gives at most this evidence: 1 in 1000 by chance.
MOST_EVIDENCE = float(np.log(1e3))


class RepeatedRows:
    """
    Find rows that equal earlier ones, all channels at once, in the same order.

    Statistic: over the rows that repeat with one distance, the sum of the logarithms of the
    probabilities that the noise of the channels hits the same step of the converter again.
    Threshold: the false-alarm rate, over the rows remembered. Channels without noise give no
    evidence: a perfect machine at rest, or in periodic motion, repeats itself rightly. Ten
    noisy channels betray a single row, two betray three rows.

    Parameters
    ----------
    channels : int
    sample_rate : float
        [Hz].

    """

    def __init__(self, channels: int, sample_rate: float) -> None:
        self._threshold = float(np.log(MEMORY) - np.log(chance_per_sample(sample_rate)))
        generator = np.random.default_rng(0)
        # Odd multipliers: a sum of products modulo 2^64 of different rows is hardly ever equal.
        self._weights = generator.integers(0, 2**63, channels, dtype=np.uint64) * 2 + 1
        self._seen: dict[int, int] = {}
        self._order: deque[tuple[int, int]] = deque()
        self._ring = [0] * MEMORY
        self._distance = 0
        self._first = 0
        self._evidence = 0.0

    def judge(
        self,
        first_index: int,
        samples: NDArray[np.float64],
        log_chance: NDArray[np.float64],
    ) -> list[Mark]:
        """
        Take the next rows.

        Parameters
        ----------
        first_index : int
            Of the first row.
        samples : ndarray, shape (n_samples, n_channels)
            As delivered.
        log_chance : ndarray, shape (n_channels,)
            Logarithm of the probability that a sample equals an earlier one by chance.

        Returns
        -------
        list of Mark
            Of all channels; from the first row that repeats, also if it is in earlier samples.

        """
        bits = np.ascontiguousarray(samples).view(np.uint64)
        mixed = (bits ^ (bits >> np.uint64(29))) * self._weights
        hashes = (mixed ^ (mixed >> np.uint64(32))).sum(axis=1).tolist()
        marks: list[Mark] = []
        for row, value in enumerate(hashes):
            index = first_index + row
            earlier = self._seen.get(value)
            # Coarse rows may also equal a later one than that which comes again.
            if self._distance and self._ring[(index - self._distance) % MEMORY] == value:
                earlier = index - self._distance
            if earlier is None:
                self._distance = 0
            else:
                if index - earlier != self._distance:
                    self._distance, self._first, self._evidence = index - earlier, index, 0.0
                self._evidence += self._of_row(samples[row], log_chance)
                if self._evidence > self._threshold:
                    if marks and marks[-1].next_index == index:
                        self._first = marks.pop().first_index
                    marks.append(Mark(-1, Condition.REPEAT, self._first, index + 1))
            self._remember(value, index)
        return marks

    def _of_row(self, row: NDArray[np.float64], log_chance: NDArray[np.float64]) -> float:
        valid = np.isfinite(row)
        # A single channel that holds its value is another fault.
        if valid.sum() < 2 and self._distance == 1:
            return 0.0
        return float(np.minimum(-log_chance[valid], MOST_EVIDENCE).sum())

    def _remember(self, value: int, index: int) -> None:
        self._seen[value] = index
        self._order.append((value, index))
        self._ring[index % MEMORY] = value
        if len(self._order) > MEMORY:
            old, at = self._order.popleft()
            if self._seen.get(old) == at:
                del self._seen[old]
