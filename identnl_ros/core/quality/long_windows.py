# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sums over longer and longer stretches of a stream, in bounded memory."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.quality.consistency_spectra import Chunk
from identnl_ros.core.quality.leave_one_out import Flags, Reals
import numpy as np

LEVELS = 3
# A window consists of so many; so many windows of a level make one part of the next.
PARTS = 4


@dataclass(frozen=True)
class StretchSums:
    """
    Chunks taken together.

    Parameters
    ----------
    first_index, next_index : int
        Samples.
    products : ndarray, shape (n_sums, n_channels, n_channels)
    power : ndarray, shape (n_sums, 4)
    segments : int
    valid : ndarray of bool, shape (n_channels,)
        In all of them.
    largest : ndarray, shape (n_channels,)

    """

    first_index: int
    next_index: int
    products: Reals
    power: Reals
    segments: int
    valid: Flags
    largest: Reals


def sums_of(chunk: Chunk) -> StretchSums:
    """
    Take the sums of one chunk.

    Parameters
    ----------
    chunk : Chunk

    Returns
    -------
    StretchSums

    """
    return StretchSums(
        chunk.first_index, chunk.next_index, chunk.products, chunk.power, len(chunk.means),
        chunk.valid, chunk.largest,
    )  # fmt: skip


def together(stretches: Sequence[StretchSums]) -> StretchSums:
    """
    Add up.

    Parameters
    ----------
    stretches : sequence of StretchSums
        In order, at least one.

    Returns
    -------
    StretchSums

    """
    return StretchSums(
        stretches[0].first_index,
        stretches[-1].next_index,
        np.asarray(sum(one.products for one in stretches)),
        np.asarray(sum(one.power for one in stretches)),
        sum(one.segments for one in stretches),
        np.all([one.valid for one in stretches], axis=0),
        np.max([one.largest for one in stretches], axis=0),
    )


class LongWindows:
    """
    Windows of the newest parts, each level four times as long as the one before.

    A part of the first level is as long as `chunks`; every new part makes a window of its level,
    of up to four parts.

    Parameters
    ----------
    chunks : int
        In a part of the first level.

    """

    def __init__(self, chunks: int) -> None:
        self._sizes = (chunks, *(PARTS,) * (LEVELS - 1))
        self.restart()

    def restart(self) -> None:
        """Forget everything: what comes is not like what was."""
        self._parts: list[deque[StretchSums]] = [deque(maxlen=PARTS) for _ in range(LEVELS)]
        self._gathered: list[list[StretchSums]] = [[] for _ in range(LEVELS)]

    def add(self, sums: StretchSums) -> list[StretchSums]:
        """
        Take the next chunk.

        Parameters
        ----------
        sums : StretchSums

        Returns
        -------
        list of StretchSums
            Windows that are to be judged now: those with a new part, of two or more.

        """
        windows = []
        for size, gathered, parts in zip(self._sizes, self._gathered, self._parts, strict=True):
            gathered.append(sums)
            if len(gathered) < size:
                break
            sums = together(gathered)
            gathered.clear()
            parts.append(sums)
            if len(parts) > 1:
                windows.append(together(parts))
        return windows

    def finish(self) -> list[StretchSums]:
        """
        Take what there is, at the end of a stream.

        Returns
        -------
        list of StretchSums
            The longest window, up to the newest chunk, if it has not been given out.

        """
        rest: list[StretchSums] = []
        longest: list[StretchSums] = []
        for gathered, parts in zip(self._gathered, self._parts, strict=True):
            rest = gathered + rest
            if parts or gathered:
                longest = [*parts, *rest]
        return [together(longest)] if rest and len(longest) > 1 else []
