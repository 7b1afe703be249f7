# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Blocks: how many samples travel together, and what is refused."""

from dataclasses import replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import (
    MotionBlock,
    SampleBlock,
    samples_per_block,
    stamp_after,
)
import numpy as np
import pytest


@pytest.mark.parametrize(
    ('rate', 'samples'),
    [(1.0, 50), (999.0, 50), (5000.0, 50), (5100.0, 51), (10000.0, 100), (51200.0, 512)],
)
def test_blocks_last_ten_milliseconds_but_hold_fifty_samples_at_least(rate, samples):
    assert samples_per_block(rate) == samples


def test_stamps_do_not_drift_over_a_day():
    rate = 51200.0
    day = int(86400 * rate)
    assert stamp_after(7, day, rate) == 7 + 86400 * 10**9


NAMES = ('displacement', 'velocity', 'acceleration', 'force')
COVARIANCES = tuple(f'{name}_covariance' for name in (*NAMES, 'displacement_acceleration'))


def motion_block():
    return MotionBlock(1, 0, 0, 1e3, ('a', 'b'), *[np.zeros((5, 2))] * 4, *[np.zeros((2, 2))] * 5)


@pytest.mark.parametrize('name', COVARIANCES)
def test_covariance_of_another_size_is_refused_by_name(name):
    with pytest.raises(DataError, match=name.removesuffix('_covariance')):
        replace(motion_block(), **{name: np.zeros((3, 2))})


@pytest.mark.parametrize('name', NAMES)
def test_motion_of_another_size_is_refused_by_name(name):
    with pytest.raises(DataError, match=f'motion block 0: (displacement|{name}|velocity)'):
        replace(motion_block(), **{name: np.zeros((5, 3))})


def test_index_at_which_times_lose_their_digits_is_refused():
    block = SampleBlock(1, 0, 2**48, 1e3, np.zeros((5, 2)), np.zeros(2, np.uint8))
    instants = (block.first_index + np.arange(5)) / block.sample_rate
    np.testing.assert_allclose(np.diff(instants) * block.sample_rate, 1, atol=1 / 16)
    with pytest.raises(DataError, match='sample index is 9223372036854771808, expected no more'):
        replace(block, first_index=2**63 - 4000)
