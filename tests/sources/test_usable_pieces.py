# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The longest piece without a gap does not depend on how the motion is cut into blocks."""

from itertools import pairwise

from identnl_ros.core.measurement.blocks import MotionBlock
from identnl_ros.sources.usable_pieces import UsablePieces
import numpy as np
import pytest


def pieces_of(known, cuts, lost=()):
    found = UsablePieces()
    for first, end in pairwise([0, *cuts, len(known)]):
        if first in lost:
            continue
        table = np.where(known[first:end], 1.0, np.nan)[:, np.newaxis]
        zero = np.zeros_like(table)
        motion = MotionBlock(
            1, 0, first, 100.0, ('x',), zero, zero, zero, table, *[np.zeros((1, 1))] * 5
        )
        found.add(motion)
    return found.instants, found.usable, found.longest, found.longest_duration


@pytest.mark.parametrize('seed', range(5))
def test_pieces_are_those_of_the_whole_record_however_it_is_cut(seed):
    generator = np.random.default_rng(seed)
    known = generator.random(200) > 0.1
    text = ''.join('x' if one else ' ' for one in known)
    longest = max(map(len, text.split()))
    for count in (0, 1, 7, 60):
        cuts = np.sort(generator.choice(np.arange(1, 200), count, replace=False)).tolist()
        assert pieces_of(known, cuts) == (200, int(known.sum()), longest, longest / 100)


def test_lost_block_ends_a_piece():
    assert pieces_of(np.ones(30, dtype=bool), [10, 15], lost=(10,)) == (25, 25, 15, 0.15)
