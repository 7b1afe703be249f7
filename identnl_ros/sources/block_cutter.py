# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Samples as a device delivers them, cut into blocks of the size that travels."""

from collections.abc import Iterator

from identnl_ros.core.measurement.blocks import stamp_after
from identnl_ros.sources.device import DeviceBlock
import numpy as np


class BlockCutter:
    """
    Join and cut consecutive samples.

    Parameters
    ----------
    size : int
        Samples of a block.
    sample_rate : float
        [Hz].

    """

    def __init__(self, size: int, sample_rate: float) -> None:
        self._size = size
        self._rate = sample_rate
        self._parts: list[DeviceBlock] = []
        self._count = 0

    def add(self, block: DeviceBlock) -> Iterator[DeviceBlock]:
        """
        Take samples; a jump of the running index ends a block early.

        Parameters
        ----------
        block : DeviceBlock

        Yields
        ------
        DeviceBlock
            What is complete, with the stamp of its own first sample.

        """
        if self._parts and block.first_index != self._parts[0].first_index + self._count:
            yield from self.flush()
        self._parts.append(block)
        self._count += len(block.samples)
        while self._count >= self._size:
            yield self._cut(self._size)

    def flush(self) -> Iterator[DeviceBlock]:
        """Yield what has come since the last complete block, if anything."""
        if self._count:
            yield self._cut(self._count)

    def _cut(self, size: int) -> DeviceBlock:
        # The cut lies in the last part: without it there was less than a block.
        first, last = self._parts[0], self._parts[-1]
        samples = np.concatenate([part.samples for part in self._parts])
        self._parts = []
        self._count -= size
        if self._count:
            begin = len(last.samples) - self._count
            self._parts = [
                DeviceBlock(
                    last.first_index + begin,
                    stamp_after(last.stamp_ns, begin, self._rate),
                    last.samples[begin:],
                )
            ]
        return DeviceBlock(first.first_index, first.stamp_ns, samples[:size])
