# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""However long a table or a bag is, little of it is in memory."""

from pathlib import Path
import subprocess
import sys

import h5py
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.table_import import import_table
from nptdms import ChannelObject, TdmsWriter
import numpy as np
import pyarrow.parquet
import pytest

CHANNELS = 8
LAYOUT = Layout(
    tuple(
        Sensor(f'c{i}', SensorKind.FORCE, excitation='shaker', noise=1.0) for i in range(CHANNELS)
    ),
    'mill',
    100_000.0,
)
SMALL, LONG = 8_000, 400_000  # rows; 26 MB of doubles
MEGABYTE = 2**20

# Runs a job twice in a process of its own and prints by how much the second run raised the most
# that was ever in memory [bytes].
GROWTH = r"""
import re, sys
from pathlib import Path
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.table_export import export_table
from identnl_ros.storage.table_import import import_table
def peak():  # what getrusage tells includes that of the process before
    return int(re.search(r'VmHWM:\s*(\d+)', Path('/proc/self/status').read_text())[1]) * 1024
job, small, long, layout = sys.argv[1:]
for path in (small, long):
    before = peak()
    if job == 'import':
        import_table(path, load_layout(layout).layout, f'{path}.mcap')
    else:
        export_table(open_bag(Path(path)), f'{path}.{job}')
print(peak() - before)
"""


def table(rows: int) -> np.ndarray:
    return np.tile(np.random.default_rng(1).standard_normal((1000, CHANNELS)), (rows // 1000, 1))


def write_csv(path: Path, rows: int):
    lines = [','.join(f'{one:.11g}' for one in row) for row in table(1000).tolist()]
    names = ','.join(sensor.name for sensor in LAYOUT.sensors)
    path.write_text('\n'.join([names, *(lines * (rows // 1000))]) + '\n')


def write_hdf5(path: Path, rows: int):
    with h5py.File(path, 'w') as file:
        for sensor, values in zip(LAYOUT.sensors, table(rows).T, strict=True):
            file.create_dataset(sensor.name, data=values, chunks=(4096,), compression='lzf')


def write_tdms(path: Path, rows: int):
    with TdmsWriter(path) as writer:
        for _ in range(rows // 2000):
            writer.write_segment(
                [
                    ChannelObject('run', sensor.name, values)
                    for sensor, values in zip(LAYOUT.sensors, table(2000).T, strict=True)
                ]
            )


def write_parquet(path: Path, rows: int):
    columns = {one.name: values for one, values in zip(LAYOUT.sensors, table(rows).T, strict=True)}
    pyarrow.parquet.write_table(pyarrow.table(columns), path, row_group_size=2**15)


def growth(job: str, small: Path, long: Path, layout: Path | str = '') -> int:
    shown = subprocess.run(
        [sys.executable, '-c', GROWTH, job, small, long, layout],
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    return int(shown.stdout)


@pytest.mark.parametrize(
    ('name', 'write', 'rows'),
    [
        ('a.csv', write_csv, LONG * 4 // 3 // 1000 * 1000),
        ('a.h5', write_hdf5, LONG),
        ('a.tdms', write_tdms, LONG),
        ('a.parquet', write_parquet, LONG),
    ],
)
def test_long_table_is_imported_in_bounded_memory(tmp_path, name, write, rows):
    layout = tmp_path / 'layout.yaml'
    layout.write_text(
        'sample_rate: 100 kHz\nsensors:\n'
        + ''.join(f'  c{i}: {{kind: force, excitation: shaker}}\n' for i in range(CHANNELS))
    )
    small, long = tmp_path / f'small_{name}', tmp_path / name
    write(small, SMALL)
    write(long, rows)
    assert growth('import', small, long, layout) < 24 * MEGABYTE
    assert (
        sum(len(block.samples) for block in open_bag(tmp_path / f'{name}.mcap').blocks()) == rows
    )


@pytest.mark.parametrize('job', ['uff', 'parquet'])
def test_long_bag_is_exported_in_bounded_memory(tmp_path, job):
    for name, rows in (('small', SMALL), ('long', LONG)):
        with h5py.File(tmp_path / f'{name}.h5', 'w') as file:
            for sensor, values in zip(LAYOUT.sensors, table(rows).T, strict=True):
                file[sensor.name] = values
        import_table(tmp_path / f'{name}.h5', LAYOUT, tmp_path / f'{name}.mcap')
    small, long = tmp_path / 'small.mcap', tmp_path / 'long.mcap'
    assert growth(job, small, long) < 24 * MEGABYTE
