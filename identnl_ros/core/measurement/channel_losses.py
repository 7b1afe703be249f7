# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Channels without readings: how many samples, how long, which are lost."""

import numpy as np
from numpy.typing import NDArray

Counts = NDArray[np.int_]

# A channel that has no valid reading for so long is lost, until it has had valid ones as long [s].
LONG = 0.1
# Sets of channels lost at the same time that are told apart.
SETS = 64


class ChannelLosses:
    """
    Follow the channels of a stream.

    Parameters
    ----------
    channels : int
    sample_rate : float
        [Hz].

    Attributes
    ----------
    missing : ndarray of int, shape (n_channels,)
        Samples without a valid reading.
    longest : ndarray of int, shape (n_channels,)
        Most of them in a row.
    samples : int
        Of every channel.
    lost : frozenset of int
        Channels that are lost at present.
    together : dict of frozenset to int
        Samples that have come while these channels were lost.

    """

    def __init__(self, channels: int, sample_rate: float) -> None:
        self.missing = np.zeros(channels, np.int_)
        self.longest = np.zeros(channels, np.int_)
        self.samples = 0
        self.together: dict[frozenset[int], int] = {}
        self._long = LONG * sample_rate
        self.restart()

    def restart(self) -> None:
        """Expect another stream."""
        count = len(self.missing)
        self.lost: frozenset[int] = frozenset()
        # In a row, up to the present sample: missing, valid.
        self._missing_run = np.zeros(count, np.int_)
        self._valid_run = np.zeros(count, np.int_)

    def add(self, samples: NDArray[np.float64]) -> None:
        """
        Take samples that follow those before, but for gaps.

        A channel is lost from the block on in which it has been missing long enough and has no
        valid reading; then it is not used for the whole block.

        Parameters
        ----------
        samples : ndarray, shape (n_samples, n_channels)

        """
        if not len(samples):
            return
        valid = np.isfinite(samples)
        self.samples += len(samples)
        self.missing += (~valid).sum(axis=0)
        longest, self._missing_run = _runs(~valid, self._missing_run)
        self.longest = np.maximum(self.longest, longest)
        _, self._valid_run = _runs(valid, self._valid_run)
        dead = ~valid.any(axis=0) & (self._missing_run >= self._long)
        back = self._valid_run >= self._long
        self.lost = (self.lost - set(np.flatnonzero(back))) | set(map(int, np.flatnonzero(dead)))
        if self.lost and (self.lost in self.together or len(self.together) < SETS):
            self.together[self.lost] = self.together.get(self.lost, 0) + len(samples)


def _runs(flags: NDArray[np.bool_], before: Counts) -> tuple[Counts, Counts]:
    """Find the longest run of true flags in every column, and the one at the end."""
    if not flags.any():
        return np.zeros_like(before), np.zeros_like(before)
    if flags.all():
        return before + len(flags), before + len(flags)
    index = np.arange(1, len(flags) + 1)[:, np.newaxis]
    last_false = np.maximum.accumulate(np.where(flags, -before, index), axis=0)
    lengths = np.where(flags, index - last_false, 0)
    return lengths.max(axis=0), lengths[-1]
