# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""One source of a stream: its newest samples, and their readings at points of the grid."""

from identnl_ros.core.synchronisation.grid_line import Line
from identnl_ros.core.synchronisation.resampling import interpolate, reach_of
from identnl_ros.core.synchronisation.sample_buffer import SampleBuffer
from identnl_ros.core.synchronisation.stamped_clock import StampedClock
from identnl_ros.core.synchronisation.stream_source import StreamSource
import numpy as np
from numpy.typing import NDArray

Block = tuple[int, int, NDArray[np.float64]]

# A jump of the index by more is a new beginning [s].
LONGEST_GAP = 10.0
# Longest part that is kept of a source that the others do not follow [s].
LONGEST_BUFFER = 15.0


class SourceStream:
    """
    What has come from a source and is still needed.

    Parameters
    ----------
    source : StreamSource
    grid_rate : float
        [Hz].
    places : list of int
        Columns of the layout that its channels are.

    """

    def __init__(self, source: StreamSource, grid_rate: float, places: list[int]) -> None:
        self.source = source
        self.rate = source.sample_rate
        self.places = places
        self.stretch = max(1.0, self.rate / grid_rate)
        self.line: Line | None = None
        """None: the source is not aligned (yet)."""
        self.silent = False
        self.longest_block = 0.0
        """Of those that have come [s]."""
        self.later: list[Block] = []
        """Blocks that began anew while the ones before are still being given."""
        self.lost = 0
        """Samples that the index told to be lost and nobody has been told of."""
        self.clock = StampedClock(source)
        self.restart()

    def restart(self, keep_from: int | None = None) -> None:
        """
        Forget the clock, and all samples or those before one.

        Parameters
        ----------
        keep_from : int or None
            Index of the sample; None: all.

        """
        self.line = None
        self.clock.restart(keep_from)
        if keep_from is None:
            self.begin = self.end = 0
            self._buffer = SampleBuffer(len(self.places))
        else:
            self.forget(keep_from)

    @property
    def samples(self) -> NDArray[np.float64]:
        """Those that are kept, from `begin` to `end`, shape (n_samples, n_channels)."""
        return self._buffer.samples

    @property
    def began(self) -> bool:
        """Whether there are samples, or have been since it began."""
        return self.end > self.begin or self.line is not None

    def add(self, first_index: int, stamp_ns: int, samples: NDArray[np.float64]) -> bool:
        """
        Take a block.

        Parameters
        ----------
        first_index, stamp_ns, samples
            As `StreamAlignment.add` has them.

        Returns
        -------
        bool
            Whether it goes on where the last one ended, but for samples that were lost; else
            it is in `later`.

        """
        if self.later:
            self.later.append((first_index, stamp_ns, samples))
            return True
        if self.began:
            lost = first_index - self.end
            if lost < 0 or lost > LONGEST_GAP * self.rate:
                self.later.append((first_index, stamp_ns, samples))
                return False
            self.lost += lost
            if lost:
                self._buffer.add(np.full((lost, len(self.places)), np.nan))
        else:
            self.begin = first_index
        self._buffer.add(samples)
        self.end = first_index + len(samples)
        self.clock.stamps.append((first_index, stamp_ns))
        self.longest_block = max(self.longest_block, len(samples) / self.rate)
        excess = self.end - self.begin - int(LONGEST_BUFFER * self.rate)
        if excess > 0 and self.line is None:
            self.forget(self.begin + excess)
        return True

    def begin_anew(self) -> None:
        """Let the blocks that came later take the place of all."""
        blocks, self.later = self.later, []
        self.restart()
        for block in blocks:
            self.add(*block)

    def forget(self, before: int) -> None:
        """
        Let go of old samples.

        Parameters
        ----------
        before : int
            Index of the first one that is needed.

        """
        drop = int(np.clip(before - self.begin, 0, self.end - self.begin))
        self._buffer.drop(drop)
        self.begin += drop

    def read(
        self, points: NDArray[np.float64], line: Line, stretch: float | None = None
    ) -> NDArray[np.float64]:
        """
        Give the readings at points of the grid.

        Parameters
        ----------
        points : ndarray, shape (n_points,)
        line : Line
        stretch : float or None
            Samples of the source per point, if the points are coarser than the grid.

        Returns
        -------
        ndarray, shape (n_points, n_channels)
            NaN where there is nothing; bit for bit the samples where points lie on them.

        """
        place = line.at(points) - self.begin
        if stretch is None and line.step == 1.0 and float(line.place).is_integer():
            rows = place.astype(np.int64)
            result = np.full((len(points), len(self.places)), np.nan)
            known = (rows >= 0) & (rows < len(self.samples))
            result[known] = self.samples[rows[known]]
            return result
        return interpolate(self.samples, place, self.stretch if stretch is None else stretch)

    def needed_after(self, line: Line) -> int:
        """
        Count the samples after a point that its reading is made from.

        Parameters
        ----------
        line : Line

        Returns
        -------
        int

        """
        on_samples = line.step == 1.0 and float(line.place).is_integer()
        return 1 if on_samples else reach_of(self.stretch) + 1
