# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Of a stream, the newest samples are kept as far back as nothing is missing."""

from identnl_ros.core.measurement.blocks import NANOSECONDS, SampleBlock
from identnl_ros.core.measurement.newest_run import NewestRun
import numpy as np

RATE = 1000.0


def block(first, count, stream=1, channels=2):
    """Make a block whose first channel holds the index of the sample."""
    samples = np.zeros((count, channels))
    samples[:, 0] = np.arange(first, first + count)
    stamp = round(first / RATE * NANOSECONDS)
    return SampleBlock(stream, stamp, first, RATE, samples, np.zeros(channels, np.uint8))


def indices(run):
    return list(run.samples[:, 0])


def test_newest_samples_are_kept_whatever_the_blocks():
    for size in (1, 3, 7, 10, 64):
        run = NewestRun(10)
        for first in range(0, 128, size):
            run.add(block(first, size))
            end = first + size
            assert indices(run) == list(range(max(0, end - 10), end))
            assert len(run) == len(run.samples)
        assert run.next_index == end
        assert run.first_index == indices(run)[0]
        for index in indices(run):
            assert run.stamp_of(index) == round(index / RATE * NANOSECONDS)


def test_gap_stream_channels_and_clearing_begin_a_new_run():
    run = NewestRun(100)
    for one, expected in (
        (block(0, 10), range(10)),
        (block(10, 5), range(15)),
        (block(10, 5), range(15)),  # repeated
        (block(3, 2, stream=2), range(15)),  # from a second source
        (block(20, 5), range(20, 25)),
        (block(25, 5, channels=3), range(25, 30)),
    ):
        run.add(one)
        assert indices(run) == list(expected)
    assert run.stream_id == 1
    run.clear()
    assert (len(run), run.stream_id, run.next_index) == (0, None, 0)
    run.add(block(30, 5, channels=3))
    assert indices(run) == list(range(30, 35))
