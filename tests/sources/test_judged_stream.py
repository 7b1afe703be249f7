# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A stream that is too long to be kept is judged again, to the same bits."""

from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.sources import judged_stream
from identnl_ros.sources.judged_stream import JudgedStream
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.machine_file import load_machine
import numpy as np

from tests.faulty_bags import CONFIG, stuck, write_faulty


def test_long_streams_give_the_bits_of_short_ones(tmp_path, monkeypatch):
    bag = open_bag(write_faulty(tmp_path / 'stuck.mcap', stuck))
    model = assemble(load_machine(CONFIG / 'knee_column.yaml').machine)
    short = JudgedStream(bag, bag.description, model)
    monkeypatch.setattr(judged_stream, 'MOST_READINGS', 1000)
    long = JudgedStream(bag, bag.description, model)
    assert short.summary == long.summary
    for _ in range(2):
        one, other = (
            np.concatenate([block.samples for block in stream.blocks()])
            for stream in (short, long)
        )
        assert one.tobytes() == other.tobytes()
        assert np.isnan(one).any()
