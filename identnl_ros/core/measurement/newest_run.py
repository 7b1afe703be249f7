# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The newest samples of a stream, as far back as nothing is missing."""

from collections import deque
from dataclasses import dataclass, field

from identnl_ros.core.measurement.blocks import SampleBlock, stamp_after
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
import numpy as np
from numpy.typing import NDArray


@dataclass
class NewestRun:
    """
    The newest uninterrupted run of a stream, up to a length.

    Parameters
    ----------
    longest : int
        Samples to keep.

    """

    longest: int
    follower: StreamFollower = field(default_factory=StreamFollower)
    _blocks: deque[SampleBlock] = field(default_factory=deque)
    _count: int = 0

    def __len__(self) -> int:
        """Count the samples."""
        return min(self._count, self.longest)

    @property
    def stream_id(self) -> int | None:
        """Stream of the samples; None: there are none."""
        return self._blocks[-1].stream_id if self._blocks else None

    @property
    def sample_rate(self) -> float:
        """Of the samples [Hz]; NaN: there are none."""
        return self._blocks[-1].sample_rate if self._blocks else float('nan')

    @property
    def next_index(self) -> int:
        """Running index of the first sample after the run; 0: there is none."""
        return self._blocks[-1].next_index if self._blocks else 0

    @property
    def samples(self) -> NDArray[np.float64]:
        """Of all channels, shape (n_samples, n_channels) [SI]."""
        if not self._blocks:
            return np.zeros((0, 0))
        return np.concatenate([block.samples for block in self._blocks])[-self.longest :]

    @property
    def first_index(self) -> int:
        """Running index of the first sample of the run; 0: there is none."""
        return self.next_index - len(self)

    def stamp_of(self, index: int) -> int:
        """
        Tell the time of a sample.

        Parameters
        ----------
        index : int
            Its running index.

        Returns
        -------
        int
            Acquisition clock [ns].

        """
        last = self._blocks[-1]
        return stamp_after(last.stamp_ns, index - last.first_index, last.sample_rate)

    def add(self, block: SampleBlock) -> None:
        """
        Take a block; a gap, another stream or other channels begin a new run.

        Parameters
        ----------
        block : SampleBlock

        """
        arrival = self.follower.accept(
            block.stream_id, block.first_index, block.next_index, block.last
        )
        if not arrival.usable or not len(block.samples):
            return
        if arrival is not Arrival.IN_ORDER or not self._continues(block):
            self.clear()
        self._blocks.append(block)
        self._count += len(block.samples)
        while self._count - len(self._blocks[0].samples) >= self.longest:
            self._count -= len(self._blocks.popleft().samples)

    def clear(self) -> None:
        """Forget the samples; what comes next begins a new run."""
        self._blocks.clear()
        self._count = 0

    def _continues(self, block: SampleBlock) -> bool:
        if not self._blocks:
            return True
        last = self._blocks[-1]
        return (
            block.samples.shape[1] == last.samples.shape[1]
            and block.sample_rate == last.sample_rate
        )
