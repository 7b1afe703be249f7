# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Of a damaged bag everything sound is kept, nothing wrong is returned, and damage is told."""

from contextlib import suppress
from dataclasses import replace
import resource
import shutil
import struct

from identnl_ros.core.errors import DataError
from identnl_ros.sources.bag_diagnosis import diagnose_bag
from identnl_ros.sources.offline import identify_bags
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.message_types import encode_block
from identnl_ros.storage.table_export import export_table
import numpy as np
import pytest

from tests.oscillator_bags import write_oscillator
from tests.storage.bag_examples import (
    assert_same_block,
    blocks,
    description,
    write_bag,
    write_small_chunks,
    write_with_rosbags,
)


def read_sound(path, expected):
    """Read what there is; every block must be one of the recorded ones, in their order."""
    try:
        bag = open_bag(path)
    except DataError as error:
        return [], [str(error)]
    by_index = {block.first_index: block for block in expected}
    found = list(bag.blocks())
    for block in found:
        assert_same_block(block, by_index[block.first_index])
    indices = [block.first_index for block in found]
    assert indices == sorted(set(indices))
    return found, bag.problems


def complete_before(data, expected):
    """Position in an uncompressed file at which each block is complete."""
    messages = [encode_block(block) for block in expected]
    return [data.index(message) + len(message) for message in messages]


def test_cut_file_keeps_every_complete_message(tmp_path):
    path = tmp_path / 'a.mcap'
    expected = write_small_chunks(path, 12)
    data = path.read_bytes()
    ends = complete_before(data, expected)
    readable = 0
    for cut in range(100, len(data), 97):
        path.write_bytes(data[:cut])
        complete = sum(end <= cut for end in ends)
        found, problems = read_sound(path, expected)
        assert len(found) == complete
        assert len(problems) == 1
        assert 'was cut off or never closed' in problems[0]
        readable += len(found) > 0
    assert readable > 100


def test_file_without_its_index_has_lost_nothing(tmp_path):
    path = tmp_path / 'a.mcap'
    expected = write_small_chunks(path)
    path.write_bytes(path.read_bytes()[:-30])
    found, problems = read_sound(path, expected)
    assert len(found) == len(expected)
    assert 'only its index is missing, no message is lost' in problems[0]


def test_cut_compressed_file_keeps_its_complete_chunks(tmp_path):
    path = tmp_path / 'a.mcap'
    expected = write_small_chunks(path, 20, compress=True)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 4])
    found, problems = read_sound(path, expected)
    assert 10 <= len(found) < 20
    assert len(problems) == 1


@pytest.mark.parametrize('compress', [False, True])
def test_flipped_bit_costs_one_chunk_at_most_and_is_told(tmp_path, compress):
    path = tmp_path / 'a.mcap'
    expected = write_small_chunks(path, 12, compress=compress)
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(5)
    harmless = lost = 0
    for position in rng.integers(0, len(data), 400):
        bit = 1 << int(rng.integers(8))
        data[position] ^= bit
        path.write_bytes(data)
        data[position] ^= bit
        found, problems = read_sound(path, expected)
        if not found:
            assert 'channels are not known' in problems[0]  # the description was hit
        elif len(found) < len(expected):
            assert len(found) == len(expected) - 2
            assert len(problems) == 1
            lost += 1
        else:
            harmless += 1
    assert lost > 150
    assert harmless > 5


def test_several_damaged_chunks_are_counted_in_one_sentence(tmp_path):
    path = tmp_path / 'a.mcap'
    expected = write_small_chunks(path, 20)
    data = bytearray(path.read_bytes())
    for end in complete_before(data, expected)[4:9:2]:
        data[end - 50] ^= 1
    path.write_bytes(data)
    found, problems = read_sound(path, expected)
    assert len(found) == 14
    (problem,) = problems
    assert '3 times, first: bytes' in problem


def test_damage_is_not_counted_twice_when_a_bag_is_read_twice(tmp_path):
    path = tmp_path / 'a.mcap'
    expected = write_small_chunks(path)
    data = bytearray(path.read_bytes())
    data[complete_before(data, expected)[5] - 50] ^= 1
    path.write_bytes(data)
    bag = open_bag(path)
    assert [block.first_index for block in bag.blocks()] == [
        block.first_index for block in bag.blocks()
    ]
    assert len(bag.problems) == 1
    assert 'times' not in bag.problems[0]


def test_destroyed_record_head_costs_one_chunk(tmp_path):
    path = tmp_path / 'a.mcap'
    expected = write_small_chunks(path, 12)
    data = bytearray(path.read_bytes())
    chunk = data.rindex(b'\x06', 0, data.index(encode_block(expected[6])) - 60)
    data[chunk : chunk + 60] = b'\xff' * 60
    path.write_bytes(data)
    found, problems = read_sound(path, expected)
    assert len(found) == 10
    assert len(problems) == 1


def test_block_that_does_not_fit_the_description_is_left_out(tmp_path):
    good = blocks(3)
    narrow = type(good[0])(9, 5, 0, 1.0, np.zeros((4, 2)), np.zeros(2, np.uint8))
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_description(description())
        writer.write_block(good[0])
        writer.write_block(narrow)
        writer.write_block(replace(narrow, stream_id=good[0].stream_id))
        writer.write_block(good[1])
    found, problems = read_sound(tmp_path / 'a.mcap', good)
    assert len(found) == 2
    assert problems == [
        f'{tmp_path}/a.mcap: blocks of a stream without a description were left out (stream 9)',
        f'{tmp_path}/a.mcap: blocks whose channels do not fit the description were left out '
        '(block 0 has 2 channels, expected 4)',
    ]


def test_message_that_contradicts_itself_is_left_out(tmp_path):
    good = blocks(3)
    raw = bytearray(encode_block(good[1]))
    count = raw.index(struct.pack('<I', good[1].samples.size))
    bad = [bytes(raw[:90]), b'', b'\x07\x07\x07\x07', bytes(raw[: count - 4]) + b'\xff' * 60]
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_description(description())
        writer.write_block(good[0])
        for index, data in enumerate(bad):
            writer.write_raw('/stand/samples', 'identnl_msgs/msg/SampleBlock', data, index)
        writer.write_block(good[2])
    found, problems = read_sound(tmp_path / 'a.mcap', good)
    assert len(found) == 2
    (problem,) = problems
    assert 'a message on /stand/samples was left out (4 times' in problem


def test_cut_sqlite_bag_is_told_in_a_sentence(tmp_path):
    expected = write_with_rosbags(tmp_path / 'bag', 'SQLITE3')
    (path,) = (tmp_path / 'bag').glob('*.db3')
    data = path.read_bytes()
    for cut in (17, 90, 1000, 4096, 9000, len(data) // 2, len(data) - 500):
        path.write_bytes(data[:cut])
        found, problems = read_sound(tmp_path / 'bag', expected)
        assert len(found) == len(expected) or len(problems) == 1
        assert not any('\n' in problem for problem in problems)


def test_random_bytes_never_end_in_a_traceback_or_a_hang(tmp_path):
    write_bag(tmp_path / 'a.mcap', 3)
    write_with_rosbags(tmp_path / 'bag', 'SQLITE3')
    (path,) = (tmp_path / 'bag').glob('*.db3')
    shutil.copy(path, tmp_path / 'b.db3')
    rng = np.random.default_rng(3)
    for name in ('a.mcap', 'b.db3'):
        original = (tmp_path / name).read_bytes()
        for _ in range(150):
            data = bytearray(original)
            start = int(rng.integers(len(data)))
            length = int(rng.choice([1, 8, 100, 5000]))
            data[start : start + length] = rng.bytes(min(length, len(data) - start))
            (tmp_path / name).write_bytes(data)
            with suppress(DataError):
                list(open_bag(tmp_path / name).blocks())


def test_bag_is_read_with_bounded_memory(tmp_path):
    samples = np.zeros((5000, 4))
    block = replace(blocks(1)[0], samples=samples)
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_description(description())
        for _ in range(1000):
            writer.write_block(block)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert sum(1 for _ in open_bag(tmp_path / 'a.mcap').blocks()) == 1000
    growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert growth * 1024 < samples.nbytes * 1000 / 5


def test_damage_is_told_where_it_leaves_nothing_to_identify(tmp_path):
    path = write_oscillator(tmp_path / 'a.mcap', duration=0.2)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2  # of the only chunk with samples
    data[middle : middle + 8] = bytes(255 - one for one in data[middle : middle + 8])
    path.write_bytes(bytes(data))
    for act in (
        lambda: identify_bags([path]),
        lambda: identify_bags([path], estimator='likelihood'),
        lambda: diagnose_bag(path),
        lambda: export_table(open_bag(path), tmp_path / 'a.csv'),
    ):
        with pytest.raises(DataError, match='a damaged part was left out'):
            act()
