# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Bags become tables that other libraries read, and come back as they were."""

import csv
from dataclasses import replace
from pathlib import Path
import warnings

from identnl_ros.core.errors import DataError
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.table_export import export_table, Exported
from identnl_ros.storage.table_import import import_table
import numpy as np
import pyarrow.parquet
import pytest
import pyuff

from tests.storage.bag_examples import blocks, description, LAYOUT, RATE, ROWS, STREAM, write_bag

NAMES = ['a.csv', 'a.uff', 'a.parquet']
UNITS = ['N', 'm', 'm/s^2', 'm/s']
each_format = pytest.mark.parametrize('name', NAMES)


def exported(tmp_path: Path, name: str, **options) -> tuple[np.ndarray, Exported]:
    expected = write_bag(tmp_path / 'in.mcap')
    made = export_table(open_bag(tmp_path / 'in.mcap'), tmp_path / name, **options)
    return np.vstack([block.samples for block in expected]), made


def write_with_gap(path: Path, lost: int) -> list:
    made = blocks(6)
    with BagWriter(path) as writer:
        writer.write_description(description())
        for i, block in enumerate(made):
            index = 7 * ROWS + block.first_index + (lost if i >= 3 else 0)
            writer.write_block(replace(block, first_index=index))
    return made


def read_set(path: Path, number: int) -> dict:
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ResourceWarning)
        return pyuff.UFF(str(path)).read_sets(number)


def test_csv_has_units_in_its_head_and_every_bit(tmp_path):
    samples, _ = exported(tmp_path, 'a.csv')
    with (tmp_path / 'a.csv').open(newline='', encoding='utf-8') as stream:
        head, *rows = csv.reader(stream)
    names = [one.name for one in LAYOUT.sensors]
    assert head == ['time [s]', *(f'{a} [{b}]' for a, b in zip(names, UNITS, strict=True))]
    table = np.array(rows, float)
    assert table[:, 0].tolist() == (np.arange(len(samples)) / RATE).tolist()
    assert table[:, 1:].tobytes() == samples.tobytes()


def test_parquet_is_read_by_pyarrow(tmp_path):
    samples, _ = exported(tmp_path, 'a.parquet')
    table = pyarrow.parquet.read_table(tmp_path / 'a.parquet')
    assert table.column_names == ['time', *(one.name for one in LAYOUT.sensors)]
    assert [field.metadata[b'unit'].decode() for field in table.schema] == ['s', *UNITS]
    assert table.schema.metadata[b'sample_rate'] == b'12800.0'
    found = np.column_stack([column.to_numpy() for column in table.columns])
    assert found[:, 0].tolist() == (np.arange(len(samples)) / RATE).tolist()
    assert found[:, 1:].tobytes() == samples.tobytes()


def test_universal_file_is_read_by_pyuff(tmp_path):
    samples, _ = exported(tmp_path, 'a.uff')
    for i, sensor in enumerate(LAYOUT.sensors):
        found = read_set(tmp_path / 'a.uff', i)
        assert found['data'].tobytes() == np.ascontiguousarray(samples[:, i]).tobytes()
        assert (found['id1'], found['id2']) == (sensor.name, 'mill_2')
        assert (found['func_type'], found['rsp_node']) == (1, i + 1)
        assert found['ordinate_axis_units_lab'] == UNITS[i]
        assert found['abscissa_inc'] == pytest.approx(1 / RATE, rel=1e-5)
        assert found['abscissa_axis_units_lab'] == 's'


@each_format
@pytest.mark.parametrize('with_rate', [False, True])
def test_export_and_import_give_the_same_bits(tmp_path, name, with_rate):
    samples, made = exported(tmp_path, name)
    assert (made.samples, made.lost_samples, made.sample_rate) == (len(samples), 0, RATE)
    layout = made.layout if with_rate else replace(made.layout, sample_rate=None)
    import_table(tmp_path / name, layout, tmp_path / 'out.mcap')
    bag = open_bag(tmp_path / 'out.mcap')
    assert bag.description.sample_rate == RATE
    found = np.vstack([block.samples for block in bag.blocks()])
    assert found.tobytes() == samples.tobytes()


@each_format
def test_lost_samples_stay_lost(tmp_path, name):
    expected = write_with_gap(tmp_path / 'in.mcap', 25)
    made = export_table(open_bag(tmp_path / 'in.mcap'), tmp_path / name)
    assert (made.samples, made.lost_samples) == (6 * ROWS, 25)
    import_table(tmp_path / name, made.layout, tmp_path / 'out.mcap')
    found = np.full((6 * ROWS + 25, 4), np.nan)
    for block in open_bag(tmp_path / 'out.mcap').blocks():
        found[block.first_index : block.next_index] = block.samples
    assert np.isnan(found[3 * ROWS : 3 * ROWS + 25]).all()
    kept = np.delete(found, range(3 * ROWS, 3 * ROWS + 25), axis=0)
    assert kept.tobytes() == np.vstack([block.samples for block in expected]).tobytes()


@each_format
def test_existing_file_is_kept_and_nothing_half_written_stays(tmp_path, name, monkeypatch):
    write_bag(tmp_path / 'in.mcap')
    (tmp_path / name).write_text('mine')
    with pytest.raises(DataError, match='exists and is never overwritten'):
        export_table(open_bag(tmp_path / 'in.mcap'), tmp_path / name)
    assert (tmp_path / name).read_text() == 'mine'
    (tmp_path / name).unlink()

    def interrupt(done: int, size: int):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_table(open_bag(tmp_path / 'in.mcap'), tmp_path / name, progress=interrupt)
    assert [path.name for path in tmp_path.iterdir()] == ['in.mcap']


def test_one_of_several_streams_is_chosen(tmp_path):
    with BagWriter(tmp_path / 'in.mcap') as writer:
        for stream, seed in ((STREAM, 1), (5, 2)):
            writer.write_description(description(stream))
            for block in blocks(3, stream, seed):
                writer.write_block(block)
    bag = open_bag(tmp_path / 'in.mcap')
    with pytest.raises(DataError, match=r'1 \(mill_2\), 2 \(mill_2\); choose one with --stream'):
        export_table(bag, tmp_path / 'a.csv')
    with pytest.raises(DataError, match='no stream 3, expected 1 to 2'):
        export_table(bag, tmp_path / 'a.csv', stream_number=3)
    made = export_table(bag, tmp_path / 'a.parquet', stream_number=2)
    assert made.samples == 3 * ROWS
    found = pyarrow.parquet.read_table(tmp_path / 'a.parquet')['shaker'].to_numpy()
    expected = np.vstack([block.samples for block in blocks(3, 5, 2)])[:, 0]
    assert found.tobytes() == np.ascontiguousarray(expected).tobytes()


def test_unknown_format_lists_those_that_can_be_written(tmp_path):
    write_bag(tmp_path / 'in.mcap')
    with pytest.raises(DataError, match=r"'tdms' is none of csv, uff58, parquet; .* --format"):
        export_table(open_bag(tmp_path / 'in.mcap'), tmp_path / 'a.tdms')
    with pytest.raises(DataError, match=r"'\.xyz' is none of"):
        export_table(open_bag(tmp_path / 'in.mcap'), tmp_path / 'a.xyz')
