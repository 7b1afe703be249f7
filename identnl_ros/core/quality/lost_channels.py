# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Channels that have no valid sample for long, and when they may be trusted again."""

import numpy as np
from numpy.typing import NDArray

LOST_AFTER = 0.1  # [s]
# An outage of this share of the time starts the wait for recovery anew.
RELAPSE = 0.1


class LostChannels:
    """
    Channels without a valid sample for a time are lost until they were valid for as long.

    Parameters
    ----------
    channels : int
    sample_rate : float
        [Hz].
    lost_after : float
        [s].

    """

    def __init__(self, channels: int, sample_rate: float, lost_after: float = LOST_AFTER) -> None:
        self._wait = max(1, round(lost_after * sample_rate))
        self._relapse = max(1, round(RELAPSE * self._wait))
        self._last_valid = np.full(channels, -1)
        self._last_outage = np.full(channels, -1)
        self.lost = np.zeros(channels, dtype=bool)

    def restart(self, index: int) -> None:
        """
        Expect samples that do not follow those before; outages are counted anew.

        Parameters
        ----------
        index : int
            Of the first one.

        """
        self._last_valid[:] = index - 1
        self._last_outage[:] = index - 1

    def judge(self, first_index: int, valid: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
        """
        Take the next samples.

        Parameters
        ----------
        first_index : int
        valid : ndarray, shape (n_samples, n_channels)

        Returns
        -------
        ndarray or None
            Where channels are lost, the same shape; None: nowhere.

        """
        next_index = first_index + len(valid)
        if not len(valid):
            return None
        if not self.lost.any() and valid.all():
            self._last_valid[:] = next_index - 1
            return None
        index = np.arange(first_index, next_index)[:, np.newaxis]
        last_valid = _latest(valid, index, self._last_valid)
        gap = index - last_valid
        last_outage = _latest(gap >= self._relapse, index, self._last_outage)
        fails, recovers = gap >= self._wait, valid & (index - last_outage >= self._wait)
        nothing = np.full(valid.shape[1], -1)
        failed, recovered = _latest(fails, index, nothing), _latest(recovers, index, nothing)
        lost = np.where(failed == recovered, self.lost, failed > recovered)
        self._last_valid, self._last_outage = last_valid[-1], last_outage[-1]
        self.lost = lost[-1]
        return lost if lost.any() else None


def _latest(
    condition: NDArray[np.bool_], index: NDArray[np.intp], before: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Index at which a condition held last, up to every sample."""
    return np.asarray(
        np.maximum(np.maximum.accumulate(np.where(condition, index, -1), axis=0), before)
    )
