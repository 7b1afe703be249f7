# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A queue of samples holds what came and was not let go of."""

from identnl_ros.core.synchronisation.sample_buffer import SampleBuffer
import numpy as np
import pytest


@pytest.mark.parametrize('seed', range(5))
def test_what_is_kept_is_the_end_of_what_came(seed):
    generator = np.random.default_rng(seed)
    samples = generator.standard_normal((4000, 3))
    samples[generator.integers(0, 4000, 50)] = np.nan
    buffer, begin, end = SampleBuffer(3), 0, 0
    while end < len(samples):
        count = int(generator.integers(0, 200))
        part = samples[end : end + count].copy()
        buffer.add(part)
        part[:] = 7.0  # taken, not held on to
        end += len(part)
        drop = int(generator.integers(0, end - begin + 1))
        buffer.drop(drop)
        begin += drop
        np.testing.assert_array_equal(buffer.samples, samples[begin:end])


def test_memory_does_not_grow_with_what_has_passed():
    buffer = SampleBuffer(2)
    for _ in range(500):
        buffer.add(np.ones((100, 2)))
        buffer.drop(len(buffer.samples) - min(len(buffer.samples), 1000))
    assert len(buffer.samples) == 1000
    assert len(buffer._table) <= 4 * 1100
