# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is written to a bag comes back bit for bit, whatever wrote it."""

from contextlib import suppress
from pathlib import Path
import subprocess
import sys

from identnl_ros.core.errors import DataError
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.bag_writer import BagWriter
import numpy as np
import pytest

from tests.storage.bag_examples import (
    assert_same_block,
    blocks,
    description,
    LAYOUT,
    STREAM,
    write_bag,
    write_with_rosbags,
)


def assert_same_stream(path, expected):
    bag = open_bag(path)
    found = list(bag.blocks())
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert_same_block(one, other)
    assert bag.problems == []
    return bag


@pytest.mark.parametrize('compress', [False, True])
@pytest.mark.parametrize('name', ['a.mcap', 'folder'])
def test_blocks_come_back_bit_for_bit(tmp_path, name, compress):
    expected = write_bag(tmp_path / name, compress=compress)
    assert_same_stream(tmp_path / name, expected)


@pytest.mark.parametrize('plugin', ['SQLITE3', 'MCAP'])
def test_bag_of_another_writer_is_read_bit_for_bit(tmp_path, plugin):
    expected = write_with_rosbags(tmp_path / 'bag', plugin)
    assert_same_stream(tmp_path / 'bag', expected)


def test_bag_with_compressed_messages_is_read(tmp_path):
    expected = write_with_rosbags(tmp_path / 'bag', 'SQLITE3', compression='MESSAGE')
    assert_same_stream(tmp_path / 'bag', expected)


def test_bare_sqlite_file_is_read(tmp_path):
    expected = write_with_rosbags(tmp_path / 'bag', 'SQLITE3')
    (path,) = (tmp_path / 'bag').glob('*.db3')
    assert_same_stream(path.rename(tmp_path / 'odd name #%.db3'), expected)


def test_bag_in_several_files_is_read_in_their_order(tmp_path):
    expected = write_bag(tmp_path / 'bag')
    made = blocks(30)[20:]
    with BagWriter(tmp_path / 'more.mcap') as writer:
        for block in made:
            writer.write_block(block)
    (tmp_path / 'more.mcap').rename(tmp_path / 'bag' / 'bag_10.mcap')
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    metadata.write_text(
        metadata.read_text().replace('  - bag_0.mcap\n', '  - bag_0.mcap\n  - bag_10.mcap\n', 1)
    )
    assert_same_stream(tmp_path / 'bag', [*expected, *made])
    metadata.unlink()
    (tmp_path / 'bag' / 'bag_0.mcap').rename(tmp_path / 'bag' / 'bag_9.mcap')
    bag = open_bag(tmp_path / 'bag')
    assert [block.first_index for block in bag.blocks()] == [40 * i for i in range(30)]
    assert 'recording was not finished' in bag.problems[0]


def test_description_and_layout_come_back_from_the_channels(tmp_path):
    write_bag(tmp_path / 'a.mcap')
    found = open_bag(tmp_path / 'a.mcap').description
    expected = description()
    for name in ('stand', 'stream_id', 'sample_rate', 'machine_text', 'layout_text', 'stamp_ns'):
        assert getattr(found, name) == getattr(expected, name)
    assert (found.layout.stand, found.layout.sample_rate) == (LAYOUT.stand, LAYOUT.sample_rate)
    for one, other in zip(found.layout.sensors, LAYOUT.sensors, strict=True):
        for name in vars(other):
            if name not in ('resolution', 'dropout_probability'):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_same_calls_give_the_same_bytes(tmp_path):
    write_bag(tmp_path / 'a.mcap')
    write_bag(tmp_path / 'b.mcap')
    assert (tmp_path / 'a.mcap').read_bytes() == (tmp_path / 'b.mcap').read_bytes()


def test_streams_of_one_bag_keep_their_own_layouts(tmp_path):
    short = type(LAYOUT)(LAYOUT.sensors[:2], 'other')
    first = blocks(3)
    second = [
        type(block)(
            stream_id=7,
            stamp_ns=block.stamp_ns,
            first_index=block.first_index,
            sample_rate=block.sample_rate,
            samples=block.samples[:, :2],
            channel_status=block.channel_status[:2],
        )
        for block in first
    ]
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_description(description())
        writer.write_description(description(7, short))
        for one, other in zip(first, second, strict=True):
            writer.write_block(one)
            writer.write_block(other)
    bag = open_bag(tmp_path / 'a.mcap')
    assert [stream.stream_id for stream in bag.streams] == [STREAM, 7]
    assert len(bag.streams[1].layout.sensors) == 2
    assert [block.stream_id for block in bag.blocks()] == [STREAM, 7] * 3
    assert [block.samples.shape[1] for block in bag.blocks(7)] == [2] * 3
    assert bag.problems == []


def test_description_recorded_after_its_blocks_is_found(tmp_path):
    expected = blocks(4)
    with BagWriter(tmp_path / 'a.mcap') as writer:
        for block in expected:
            writer.write_block(block)
        writer.write_description(description())
    assert_same_stream(tmp_path / 'a.mcap', expected)


def test_topics_are_found_by_type_under_any_name(tmp_path):
    with BagWriter(tmp_path / 'a.mcap', namespace='hall/3/') as writer:
        writer.write_description(description())
        writer.write_block(blocks(1)[0])
    bag = open_bag(tmp_path / 'a.mcap')
    assert set(bag.topics) == {'/hall/3/samples', '/hall/3/stand_description'}
    assert len(list(bag.blocks())) == 1


def test_metadata_records_come_back(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_description(description())
        writer.write_metadata('identnl.truth', {'json': '{"a": 1.5}', 'empty': ''})
        writer.write_block(blocks(1)[0])
    bag = open_bag(tmp_path / 'a.mcap')
    assert bag.metadata('identnl.truth') == {'json': '{"a": 1.5}', 'empty': ''}
    assert bag.metadata('other') is None


def test_blocks_own_their_memory_and_files_are_read_in_pieces(tmp_path):
    write_bag(tmp_path / 'a.mcap')
    block = next(open_bag(tmp_path / 'a.mcap').blocks())
    assert block.samples.flags.writeable
    assert block.samples.flags.aligned
    assert block.samples.base is None or block.samples.base.nbytes == block.samples.nbytes


def test_existing_path_is_never_overwritten(tmp_path):
    for name in ('a.mcap', 'folder'):
        write_bag(tmp_path / name)
        for options in ({}, {'keep_partial': True}):
            with pytest.raises(DataError, match=r'exists and is never overwritten; choose'):
                BagWriter(tmp_path / name, **options)
        assert_same_stream(tmp_path / name, blocks(20))


def test_error_leaves_nothing_of_an_offline_bag(tmp_path):
    for name in ('a.mcap', 'folder'):
        with suppress(RuntimeError), BagWriter(tmp_path / name) as writer:
            writer.write_description(description())
            writer.write_block(blocks(1)[0])
            raise RuntimeError
        assert list(tmp_path.iterdir()) == []


def test_error_leaves_a_live_recording_complete(tmp_path):
    for name in ('a.mcap', 'folder'):
        with (
            suppress(RuntimeError),
            BagWriter(tmp_path / name, keep_partial=True) as writer,
        ):
            writer.write_description(description())
            writer.write_block(blocks(2)[0])
            raise RuntimeError
        assert_same_stream(tmp_path / name, blocks(2)[:1])


@pytest.mark.parametrize('name', ['a.mcap', 'folder'])
def test_live_recording_without_a_message_leaves_nothing_that_blocks_the_next(tmp_path, name):
    for _ in range(2):
        with BagWriter(tmp_path / name, keep_partial=True) as writer:
            assert writer.is_empty
        assert list(tmp_path.iterdir()) == []
    with BagWriter(tmp_path / name, keep_partial=True) as writer:
        writer.write_description(description())
        assert not writer.is_empty
    assert (tmp_path / name).exists()


def test_killed_recorder_loses_only_what_it_had_not_flushed(tmp_path):
    code = (
        'import os, sys\n'
        f'sys.path.insert(0, {str(Path(__file__).parents[2])!r})\n'
        'from tests.storage.bag_examples import blocks, BagWriter, description\n'
        f'writer = BagWriter({str(tmp_path / "live")!r}, keep_partial=True)\n'
        'writer.write_description(description())\n'
        'for block in blocks(9)[:8]:\n'
        '    writer.write_block(block)\n'
        '    if block.first_index == 5 * 40: writer.flush()\n'
        'os._exit(1)\n'
    )
    subprocess.run([sys.executable, '-c', code], check=False, timeout=60)
    bag = open_bag(tmp_path / 'live')
    found = list(bag.blocks())
    assert len(found) == 6
    for one, other in zip(found, blocks(9), strict=False):
        assert_same_block(one, other)
    assert len(bag.problems) == 2


@pytest.mark.parametrize('keep_partial', [False, True])
def test_full_disk_is_told_and_leaves_no_half_bag(tmp_path, keep_partial):
    path = tmp_path / 'a.mcap'
    code = (
        'import resource, signal, sys\n'
        f'sys.path.insert(0, {str(Path(__file__).parents[2])!r})\n'
        'from tests.storage.bag_examples import *\n'
        'description(), encode_block(blocks(1)[0])\n'
        'resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n'
        'signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n'
        'from identnl_ros.core.errors import DataError\n'
        'try:\n'
        f'    with BagWriter({str(path)!r}, keep_partial={keep_partial}) as writer:\n'
        '        writer.write_description(description())\n'
        '        for block in blocks(300):\n'
        '            writer.write_block(block)\n'
        '            writer.flush()\n'
        'except DataError as error:\n'
        '    print(error)\n'
    )
    result = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, timeout=60, check=False
    )
    assert 'a.mcap cannot be written: File too large' in result.stdout, result.stderr
    if keep_partial:
        found = list(open_bag(tmp_path / 'a.mcap').blocks())
        assert 50 < len(found) < 100
        for one, other in zip(found, blocks(300), strict=False):
            assert_same_block(one, other)
    else:
        assert list(tmp_path.iterdir()) == []


def test_close_is_idempotent_and_ends_writing(tmp_path):
    writer = BagWriter(tmp_path / 'a.mcap')
    writer.write_description(description())
    writer.write_block(blocks(1)[0])
    writer.close()
    writer.close()
    with pytest.raises(DataError, match='is closed'):
        writer.write_block(blocks(1)[0])
    assert_same_stream(tmp_path / 'a.mcap', blocks(1))


def test_messages_that_a_bag_cannot_hold_are_refused(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as writer:
        with pytest.raises(DataError, match=r'message type foo/msg/Bar is not known'):
            writer.write_raw('/x', 'foo/msg/Bar', b'', 0)
        with pytest.raises(DataError, match=r'has the time -1 ns'):
            writer.write_raw('/x', 'std_msgs/msg/String', b'', -1)
        writer.write_raw('/x', 'std_msgs/msg/String', b'\0\1\0\0\2\0\0\0a\0', 5)
        with pytest.raises(DataError, match=r'topic /x carries std_msgs/msg/String'):
            writer.write_raw('/x', 'std_msgs/msg/Bool', b'\0\1\0\0\1', 5)
