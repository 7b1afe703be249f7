# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The stream follower as a table: what arrives, how it is judged, what is counted."""

from identnl_ros.core.measurement.continuity import Arrival, StreamFollower, TAKEOVER_BLOCKS
import pytest

FIRST, IN_ORDER, AFTER_GAP = Arrival.FIRST, Arrival.IN_ORDER, Arrival.AFTER_GAP
REPEATED, FOREIGN = Arrival.REPEATED, Arrival.FOREIGN


def follow(blocks):
    """Feed (stream, first, next[, last]) tuples."""
    follower = StreamFollower()
    return [follower.accept(*block[:3], *(block[3:] or (False,))) for block in blocks], follower


@pytest.mark.parametrize(
    ('blocks', 'expected', 'lost', 'repeated', 'foreign'),
    [
        ([(1, 0, 10)], [FIRST], 0, 0, 0),
        ([(1, 0, 10), (1, 10, 13), (1, 13, 99)], [FIRST, IN_ORDER, IN_ORDER], 0, 0, 0),
        ([(1, 70, 80), (1, 80, 90)], [FIRST, IN_ORDER], 0, 0, 0),
        ([(1, 0, 10), (1, 15, 20), (1, 20, 21)], [FIRST, AFTER_GAP, IN_ORDER], 5, 0, 0),
        ([(1, 0, 10), (1, 0, 10), (1, 10, 20)], [FIRST, REPEATED, IN_ORDER], 0, 1, 0),
        ([(1, 0, 10), (1, 20, 30), (1, 10, 20), (1, 30, 40)],
         [FIRST, AFTER_GAP, REPEATED, IN_ORDER], 10, 1, 0),
        ([(1, 0, 10), (1, 5, 15), (1, 10, 20)], [FIRST, REPEATED, IN_ORDER], 0, 1, 0),
        ([(1, 0, 10), (2, 0, 10), (1, 10, 20)], [FIRST, FOREIGN, IN_ORDER], 0, 0, 1),
        ([(1, 0, 10, True), (2, 0, 10), (2, 10, 20)], [FIRST, FIRST, IN_ORDER], 0, 0, 0),
        ([(1, 0, 10, True), (1, 10, 20)], [FIRST, REPEATED], 0, 1, 0),
        ([(1, 0, 10), (1, 10, 10, True), (7, 3, 4)], [FIRST, IN_ORDER, FIRST], 0, 0, 0),
    ],
)  # fmt: skip
def test_table_of_arrivals(blocks, expected, lost, repeated, foreign):
    arrivals, follower = follow(blocks)
    assert arrivals == expected
    assert follower.lost_samples == lost
    assert follower.repeated_blocks == repeated
    assert follower.foreign_blocks == foreign


def test_restarted_source_takes_over_once_the_old_one_has_been_silent():
    restarted = [(2, 10 * i, 10 * i + 10) for i in range(TAKEOVER_BLOCKS + 2)]
    arrivals, follower = follow([(1, 0, 10), *restarted])
    assert arrivals == [FIRST, *[FOREIGN] * (TAKEOVER_BLOCKS - 1), FIRST, IN_ORDER, IN_ORDER]
    assert follower.stream_id == 2
    assert follower.foreign_blocks == TAKEOVER_BLOCKS - 1
    assert follower.lost_samples == 0


def test_second_source_never_takes_over_while_the_first_one_talks():
    blocks = [(1, 0, 10)]
    for i in range(1, 5 * TAKEOVER_BLOCKS):
        blocks += [(2, 10 * i, 10 * i + 10), (1, 10 * i, 10 * i + 10)]
    arrivals, follower = follow(blocks)
    assert FIRST not in arrivals[1:]
    assert follower.stream_id == 1
    assert follower.foreign_blocks == 5 * TAKEOVER_BLOCKS - 1


def test_two_foreign_sources_in_turn_do_not_add_up():
    blocks = [(1, 0, 10), *[(2 + i % 2, i, i + 1) for i in range(4 * TAKEOVER_BLOCKS)]]
    arrivals, _ = follow(blocks)
    assert arrivals[1:] == [FOREIGN] * (4 * TAKEOVER_BLOCKS)


def test_old_source_is_foreign_after_the_takeover():
    blocks = [(1, 0, 10), *[(2, i, i + 1) for i in range(TAKEOVER_BLOCKS)], (1, 10, 20)]
    arrivals, _ = follow(blocks)
    assert arrivals[-2:] == [FIRST, FOREIGN]


@pytest.mark.parametrize(
    ('blocks', 'expected', 'lost'),
    [
        ([(1, 100, 110), (1, 110, 120)], [IN_ORDER, IN_ORDER], 0),
        ([(1, 105, 110)], [AFTER_GAP], 5),
        ([(1, 90, 100), (1, 100, 101)], [REPEATED, IN_ORDER], 0),
        ([(1, 95, 105)], [REPEATED], 0),
        ([(2, 0, 10), (2, 10, 20)], [FIRST, IN_ORDER], 0),
        ([(2, 0, 10), (1, 100, 110)], [FIRST, FOREIGN], 0),
        ([(1, 100, 110), (2, 0, 10)], [IN_ORDER, FOREIGN], 0),
        ([(1, 90, 100), (2, 0, 10)], [REPEATED, FOREIGN], 0),
        ([(2, 0, 10), (3, 0, 10)], [FIRST, FOREIGN], 0),
        ([(1, 100, 110, True), (2, 0, 10)], [IN_ORDER, FIRST], 0),
    ],
)
def test_resumed_follower_goes_on_or_lets_any_other_source_take_over(blocks, expected, lost):
    follower = StreamFollower()
    follower.resume(1, 100)
    found = [follower.accept(*block[:3], *(block[3:] or (False,))) for block in blocks]
    assert found == expected
    assert follower.lost_samples == lost


def test_takeover_after_a_resumption_is_no_easier_than_before():
    follower = StreamFollower()
    follower.resume(1, 100)
    follower.accept(1, 100, 110, False)
    blocks = [(2, i, i + 1, False) for i in range(TAKEOVER_BLOCKS)]
    arrivals = [follower.accept(*block) for block in blocks]
    assert arrivals == [*[FOREIGN] * (TAKEOVER_BLOCKS - 1), FIRST]


def test_only_new_data_of_the_stream_followed_are_usable():
    assert {arrival for arrival in Arrival if arrival.usable} == {FIRST, IN_ORDER, AFTER_GAP}
