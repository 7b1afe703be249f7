# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is not a usable bag is refused with one sentence that says what to do."""

import os

from identnl_ros.core.errors import DataError
from identnl_ros.storage.bag_reader import open_bag, read_estimates
from identnl_ros.storage.bag_writer import BagWriter
import pytest

from tests.storage.bag_examples import blocks, description, write_bag, write_with_rosbags


def message_of(path):
    with pytest.raises(DataError) as caught:
        open_bag(path)
    assert '\n' not in str(caught.value)
    return str(caught.value)


def test_missing_path(tmp_path):
    assert 'a.mcap does not exist; give the path of a bag' in message_of(tmp_path / 'a.mcap')


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3', 'a'])
def test_empty_file(tmp_path, name):
    (tmp_path / name).touch()
    assert 'is empty' in message_of(tmp_path / name)


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3', 'a.bag', 'a.csv', 'a.tdms'])
def test_file_that_is_no_bag(tmp_path, name):
    (tmp_path / name).write_text('time,x\n0,1\n' * 50)
    message = message_of(tmp_path / name)
    assert 'is not a' in message
    assert ('identnl import' in message) == (name in ('a.csv', 'a.tdms'))


def test_folder_without_a_bag(tmp_path):
    assert 'has neither metadata.yaml nor .mcap or .db3 files' in message_of(tmp_path)


def test_folder_whose_metadata_names_missing_files(tmp_path):
    write_bag(tmp_path / 'bag')
    (tmp_path / 'bag' / 'bag_0.mcap').unlink()
    assert 'names files that do not exist: bag_0.mcap' in message_of(tmp_path / 'bag')


@pytest.mark.parametrize('text', ['', ': [', 'a: 1', '- 1', 'rosbag2_bagfile_information: {}'])
def test_folder_with_unusable_metadata(tmp_path, text):
    write_bag(tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').write_text(text)
    assert 'metadata.yaml' in message_of(tmp_path / 'bag')


def test_folder_with_files_compressed_as_a_whole(tmp_path):
    write_with_rosbags(tmp_path / 'bag', 'MCAP', compression='FILE')
    assert '`zstd -d`' in message_of(tmp_path / 'bag')


def test_permission_error_is_told_in_a_sentence(tmp_path, monkeypatch):
    write_bag(tmp_path / 'a.mcap')

    def refuse(*_arguments):
        raise PermissionError(13, 'Permission denied', 'a.mcap')

    monkeypatch.setattr('pathlib.Path.open', refuse)
    assert 'cannot be read: Permission denied' in message_of(tmp_path / 'a.mcap')


def test_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / 'pipe.mcap')
    assert 'is not a file' in message_of(tmp_path / 'pipe.mcap')


def test_link_to_itself(tmp_path):
    (tmp_path / 'a.mcap').symlink_to('a.mcap')
    assert 'cannot be read' in message_of(tmp_path / 'a.mcap')


def test_foreign_bag_names_what_was_found_and_expected(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_raw('/chatter', 'std_msgs/msg/String', b'\0\1\0\0\2\0\0\0a\0', 1)
    message = message_of(tmp_path / 'a.mcap')
    assert 'found /chatter (std_msgs/msg/String), expected also' in message
    assert 'identnl_msgs/msg/StandDescription and identnl_msgs/msg/SampleBlock' in message


def test_bag_without_messages(tmp_path):
    BagWriter(tmp_path / 'a.mcap').close()
    assert 'found no topics' in message_of(tmp_path / 'a.mcap')


def test_bag_without_description(tmp_path):
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_block(blocks(1)[0])
    message = message_of(tmp_path / 'a.mcap')
    assert message.endswith('expected also identnl_msgs/msg/StandDescription')


def test_channel_of_an_unknown_quantity(tmp_path):
    from identnl_ros.storage.message_types import encode_description

    data = bytearray(encode_description(description()))
    data[data.index(b'shaker\0') + 7] = 200
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_raw('/d', 'identnl_msgs/msg/StandDescription', data, 0)
        writer.write_block(blocks(1)[0])
    assert 'channel shaker measures the unknown quantity 200' in message_of(tmp_path / 'a.mcap')


def test_estimates_of_what_is_no_bag(tmp_path):
    with pytest.raises(DataError, match='does not exist'):
        next(read_estimates(tmp_path / 'a'))


def test_unwritable_place(tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(DataError, match='there is no folder'):
        BagWriter(tmp_path / 'file' / 'a.mcap')
