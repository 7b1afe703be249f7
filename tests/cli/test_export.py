# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Bags go out as tables and come back through the layout that is written along."""

from identnl_ros.storage.bag_reader import open_bag
import numpy as np
import pytest


def samples(bag):
    return np.vstack([block.samples for block in open_bag(bag).blocks()])


@pytest.mark.parametrize('name', ['a.csv', 'a.uff', 'a.parquet'])
def test_exported_bag_is_imported_bit_for_bit(document, bags, tmp_path, name):
    original = bags / 'oscillator_multisine.mcap'
    layout, out = tmp_path / 'layout.yaml', tmp_path / 'out.mcap'
    made = document('export', original, '--out', tmp_path / name, '--layout-out', layout)
    expected = samples(original)
    assert (made['samples'], made['lost_samples']) == (len(expected), 0)
    assert made['channels'] == [one.name for one in open_bag(original).description.layout.sensors]
    found = document('import', tmp_path / name, '--layout', layout, '--out', out)
    assert found['notes'] == []
    assert open_bag(out).description.sample_rate == made['sample_rate']
    assert samples(out).tobytes() == expected.tobytes()


def test_format_of_the_option_counts_more_than_the_ending(document, bags, tmp_path):
    original, table = bags / 'oscillator_multisine.mcap', tmp_path / 'record.txt'
    layout, out = tmp_path / 'layout.yaml', tmp_path / 'out.mcap'
    document(
        'export', original, '--out', table, '--format', 'parquet', '--layout-out', layout
    )  # fmt: skip
    assert table.read_bytes().startswith(b'PAR1')
    document('import', table, '--format', 'parquet', '--layout', layout, '--out', out)
    assert samples(out).tobytes() == samples(original).tobytes()


@pytest.mark.parametrize('existing', ['a.csv', 'layout.yaml'])
def test_existing_files_are_kept(identnl, bags, tmp_path, existing):
    (tmp_path / existing).write_text('mine')
    result = identnl(
        'export', bags / 'oscillator_multisine.mcap', '--out', tmp_path / 'a.csv',
        '--layout-out', tmp_path / 'layout.yaml',
    )  # fmt: skip
    assert result.exit_code == 2
    assert f'{existing} exists and is never overwritten' in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == [existing]


@pytest.mark.parametrize('mistyped', ['--out', '--layout-out'])
def test_folder_that_is_missing_is_not_made(identnl, bags, tmp_path, mistyped):
    paths = {'--out': tmp_path / 'a.csv', '--layout-out': tmp_path / 'layout.yaml'}
    paths[mistyped] = tmp_path / 'tabels' / paths[mistyped].name
    options = [word for option in paths.items() for word in option]
    result = identnl('export', bags / 'oscillator_multisine.mcap', *options)
    assert result.exit_code == 2
    assert f'there is no folder {tmp_path}/tabels; make it, or correct the path' in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_unsound_table_is_told_in_one_sentence(identnl, config, tmp_path):
    (tmp_path / 'a.h5').write_bytes(b'\x89HDF\r\n\x1a\nnothing more')
    layout = config / 'oscillator_layout.yaml'
    result = identnl('import', tmp_path / 'a.h5', '--layout', layout, '--out', tmp_path / 'b.mcap')
    assert result.exit_code == 2
    assert result.stderr.startswith(f'identnl import: {tmp_path}/a.h5 cannot be read as HDF5: ')
    assert result.stderr.count('\n') == 1
    assert [path.name for path in tmp_path.iterdir()] == ['a.h5']


def test_choices_of_the_options_are_the_formats_there_are():
    from identnl_ros.cli.formats import READABLE, WRITABLE
    from identnl_ros.storage.formats.formats import READERS
    from identnl_ros.storage.table_export import WRITERS

    assert tuple(READERS) == READABLE
    assert tuple(WRITERS) == WRITABLE
