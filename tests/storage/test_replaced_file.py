# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A file is complete or it is as it was before."""

from identnl_ros.storage.replaced_file import write_bytes, write_text
import pytest


def test_text_and_bytes_are_written(tmp_path):
    write_text(tmp_path / 'new/a.txt', ['µ', 'm\n'])
    write_bytes(tmp_path / 'new/b.png', [b'\x89', b'PNG'])
    assert (tmp_path / 'new/a.txt').read_text('utf-8') == 'µm\n'
    assert (tmp_path / 'new/b.png').read_bytes() == b'\x89PNG'


@pytest.mark.parametrize('before', [None, b'old'])
def test_failure_leaves_what_was_there(tmp_path, before):
    def parts():
        yield b'half'
        raise ZeroDivisionError

    path = tmp_path / 'picture.png'
    if before is not None:
        path.write_bytes(before)
    with pytest.raises(ZeroDivisionError):
        write_bytes(path, parts())
    assert [one.read_bytes() for one in tmp_path.iterdir()] == ([before] if before else [])
