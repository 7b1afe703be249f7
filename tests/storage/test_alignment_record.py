# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How well sources are aligned is kept in the bag, or its damage told."""

from identnl_ros.storage.alignment_record import (
    AlignedSource,
    NAME,
    read_alignment,
    write_alignment,
)
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.bag_writer import BagWriter
import pytest

from tests.storage.bag_examples import blocks, description


def written(path, add):
    with BagWriter(path) as writer:
        writer.write_description(description())
        for block in blocks(3):
            writer.write_block(block)
        add(writer)
    return open_bag(path)


def test_the_record_comes_back_as_it_was(tmp_path):
    sources = (
        AlignedSource('probes', ('a', 'b'), 0.0, False),
        AlignedSource('others', ('c',), 1.25e-7, True),
    )
    bag = written(tmp_path / 'a.mcap', lambda writer: write_alignment(writer, sources))
    assert read_alignment(bag) == (sources, '')


def test_a_bag_of_one_source_says_nothing(tmp_path):
    assert read_alignment(written(tmp_path / 'a.mcap', lambda writer: None)) == ((), '')


@pytest.mark.parametrize(
    'values', [{}, {'sources': '['}, {'sources': '[]'}, {'sources': '[1]'},
               {'sources': '[{"name": "a", "channels": [], "deviation": NaN, "by_motion": 1}]'}]
)  # fmt: skip
def test_damage_is_told(tmp_path, values):
    bag = written(tmp_path / 'a.mcap', lambda writer: writer.write_metadata(NAME, values))
    sources, problem = read_alignment(bag)
    assert sources == ()
    assert 'damaged' in problem
