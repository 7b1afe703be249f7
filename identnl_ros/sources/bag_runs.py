# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Uninterrupted runs of the streams of a bag, as long as memory allows."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.short_gaps import LONGEST_GAP
from identnl_ros.core.quality.monitor import monitored, QualityMonitor
from identnl_ros.storage.bag_reader import Bag
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

# Samples of a run; longer ones are divided.
LONGEST_RUN = 2**16
# Shorter ones tell too little beside the initial state that each of them needs.
SHORTEST_RUN = 256


@dataclass
class BagRuns:
    """
    The runs of one stream.

    Parameters
    ----------
    bag : Bag
    stream : StandDescription

    """

    bag: Bag
    stream: StandDescription
    left_out: int = 0
    """Samples in runs that are too short, or without a force; complete after `runs` has ended."""

    def __post_init__(self) -> None:
        """Prepare to judge the samples."""
        self.monitor = QualityMonitor(self.stream.layout, self.stream.sample_rate)

    def runs(self) -> Iterator[MeasuredRecord]:
        """
        Yield every run.

        Yields
        ------
        MeasuredRecord
            Without the samples that are at fault. The force is known all along, but for gaps
            that can be bridged.

        """
        for samples, first_index in self._uninterrupted(monitored(self._blocks(), self.monitor)):
            used = runs_with_force(
                self.stream.layout, self.stream.sample_rate, samples, first_index
            )
            self.left_out += len(samples) - sum(len(record.samples) for record in used)
            yield from used

    def runs_of_any(self) -> Iterator[MeasuredRecord]:
        """
        Yield every run as it was recorded, whether the force is known or not.

        Yields
        ------
        MeasuredRecord

        """
        for samples, first_index in self._uninterrupted(self._blocks()):
            if len(samples) >= SHORTEST_RUN:
                yield MeasuredRecord(
                    self.stream.layout, self.stream.sample_rate, samples, first_index
                )
            else:
                self.left_out += len(samples)

    def _blocks(self) -> Iterator[SampleBlock]:
        return self.bag.blocks(self.stream.stream_id)

    @staticmethod
    def _uninterrupted(
        blocks: Iterable[SampleBlock],
    ) -> Iterator[tuple[NDArray[np.float64], int]]:
        """Yield the samples between gaps, and the index of the first one."""
        follower = StreamFollower()
        parts: list[NDArray[np.float64]] = []
        first_index = count = 0
        for block in blocks:
            arrival = follower.accept(
                block.stream_id, block.first_index, block.next_index, block.last
            )
            if not arrival.usable:
                continue
            if parts and (
                arrival is Arrival.AFTER_GAP or count + len(block.samples) > LONGEST_RUN
            ):
                yield np.concatenate(parts), first_index
                parts, count = [], 0
            if not parts:
                first_index = block.first_index
            parts.append(block.samples)
            count += len(block.samples)
        if parts:
            yield np.concatenate(parts), first_index


def runs_with_force(
    layout: Layout, sample_rate: float, samples: NDArray[np.float64], first_index: int
) -> list[MeasuredRecord]:
    """
    Find where the force is known for long enough.

    Parameters
    ----------
    layout : Layout
    sample_rate : float
        [Hz].
    samples : ndarray, shape (n_samples, n_channels)
        Without interruption [SI].
    first_index : int
        Index of the first one in its stream.

    Returns
    -------
    list of MeasuredRecord

    """
    lost = _without_force(layout, samples)
    edges = np.flatnonzero(np.diff(np.concatenate(([True], lost, [True])).astype(np.int8)))
    pieces = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    joined: list[tuple[int, int]] = []
    for begin, end in pieces:
        if joined and begin - joined[-1][1] <= LONGEST_GAP:
            joined[-1] = joined[-1][0], end
        else:
            joined.append((begin, end))
    return [
        MeasuredRecord(layout, sample_rate, samples[begin:end], first_index + begin)
        for begin, end in joined
        if end - begin >= SHORTEST_RUN
    ]


def _without_force(layout: Layout, samples: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Find the samples at which no cell measures some excitation."""
    lost = np.zeros(len(samples), dtype=np.bool_)
    for excitation in {sensor.excitation for sensor in layout.sensors} - {''}:
        cells = [i for i, one in enumerate(layout.sensors) if one.excitation == excitation]
        lost |= ~np.isfinite(samples[:, cells]).any(axis=1)
    return lost
