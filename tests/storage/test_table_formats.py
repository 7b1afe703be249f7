# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Files that the formats' own libraries write become bags with the same samples."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
import subprocess
import sys
import warnings

import h5py
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.formats.matlab_table import matlab_table
from identnl_ros.storage.table_import import import_table
from nptdms import ChannelObject, RootObject, TdmsWriter
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import pyuff
from scipy.io import savemat

RATE = 12_800.0
SENSORS = (
    Sensor('force', SensorKind.FORCE, excitation='shaker'),
    Sensor('probe', SensorKind.DISPLACEMENT, body='knee', recorded_unit='um', gain=1e6),
)
LAYOUT = Layout(SENSORS, 'mill', RATE)
UNTIMED = replace(LAYOUT, sample_rate=None)
UNITS = ('kN', 'nm')  # of the file; the layout has N and um
EXPECTED = np.array([1e3, 1e-9])  # SI per unit of the file
ROWS = 3000
TABLE = np.random.default_rng(1).standard_normal((ROWS, 2))


def write_csv(path: Path, table=TABLE, units=UNITS, rate: float | None = RATE):
    names = [f'{one.name} [{unit}]' if unit else one.name for one, unit in zip(SENSORS, units)]  # noqa: B905
    columns = [] if rate is None else [np.arange(len(table)) / rate]
    head = [] if rate is None else ['time [s]']
    lines = [','.join(map(repr, row)) for row in np.column_stack([*columns, table]).tolist()]
    path.write_text('\n'.join([','.join(head + names), *lines]) + '\n')


def write_uff(path: Path, table=TABLE, units=UNITS, rate: float | None = RATE, **changed):
    x = np.arange(len(table)) / (rate or RATE)
    for i, sensor in enumerate(SENSORS):
        data = {
            'type': 58, 'binary': 1, 'func_type': 1, 'id1': sensor.name, 'rsp_node': i + 1,
            'rsp_dir': 3, 'ref_node': 0, 'ref_dir': 0, 'data': table[:, i], 'x': x,
            'abscissa_spacing': 1, 'abscissa_spec_data_type': 17, 'ordinate_spec_data_type': 8,
            'orddenom_spec_data_type': 0, 'ordinate_axis_units_lab': units[i] or 'NONE',
        }  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', ResourceWarning)  # it leaves files open
            pyuff.UFF(str(path)).write_sets(data | changed, 'add')


def write_uff_text(path: Path, table=TABLE, units=UNITS, rate: float | None = RATE):
    write_uff(path, table, units, rate, binary=0)


def write_mat(path: Path, table=TABLE, units=UNITS, rate: float | None = RATE, **options):
    rates = {} if rate is None else {'Fs': rate}
    savemat(path, {'force': table[:, 0], 'probe': table[:, 1:], **rates}, **options)


def write_tdms(path: Path, table=TABLE, units=UNITS, rate: float | None = RATE):
    increment = {} if rate is None else {'wf_increment': 1 / rate}
    middle = len(table) // 3
    with TdmsWriter(path) as writer:
        for part in (table[:middle], table[middle:]):
            channels = [
                ChannelObject('run', one.name, part[:, i], {'unit_string': units[i], **increment})
                for i, one in enumerate(SENSORS)
            ]
            writer.write_segment([RootObject({'operator': 'somebody'}), *channels])


def write_hdf5(path: Path, table=TABLE, units=UNITS, rate: float | None = RATE, **options):
    with h5py.File(path, 'w') as file:
        group = file.create_group('run')
        if rate is not None:
            group.attrs['sampling_rate'] = rate
        for i, one in enumerate(SENSORS):
            group.create_dataset(one.name, data=table[:, i], **options).attrs['unit'] = units[i]


def write_hdf5_matrix(path: Path, table=TABLE, units=UNITS, rate: float | None = RATE):
    with h5py.File(path, 'w') as file:
        columns = [(one.name, 'f8') for one in SENSORS]
        file['fields'] = np.array([tuple(row) for row in table.tolist()], columns)
        if rate is not None:
            file['dt'] = 1 / rate


def write_parquet(path: Path, table=TABLE, units=UNITS, rate: float | None = RATE):
    schema = pyarrow.schema(
        [
            pyarrow.field(one.name, pyarrow.float64(), metadata={'unit': unit})
            for one, unit in zip(SENSORS, units, strict=True)
        ],
        metadata=None if rate is None else {'sample_rate': str(rate)},
    )
    columns = [pyarrow.array(column) for column in table.T]
    pyarrow.parquet.write_table(pyarrow.table(columns, schema=schema), path, row_group_size=700)


WRITERS: dict[str, Callable[..., None]] = {
    'a.csv': write_csv,
    'a.uff': write_uff,
    'text.unv': write_uff_text,
    'a.mat': write_mat,
    'a.tdms': write_tdms,
    'a.h5': write_hdf5,
    'fields.hdf5': write_hdf5_matrix,
    'a.parquet': write_parquet,
}
WITHOUT_UNITS = {'a.mat', 'fields.hdf5'}
# Digits of the numbers in text.
PRECISION = {'text.unv': 1e-11}
each_format = pytest.mark.parametrize('name', WRITERS)


def samples(bag: Path) -> np.ndarray:
    return np.vstack([block.samples for block in open_bag(bag).blocks()])


def imported(tmp_path: Path, name: str, layout: Layout = UNTIMED, **options) -> np.ndarray:
    import_table(tmp_path / name, layout, tmp_path / 'bag.mcap', **options)
    return samples(tmp_path / 'bag.mcap')


def error_of(tmp_path: Path, name: str, layout: Layout = LAYOUT, **options) -> str:
    with pytest.raises(DataError) as caught:
        import_table(tmp_path / name, layout, tmp_path / 'bag.mcap', **options)
    assert not [path for path in tmp_path.iterdir() if 'bag' in path.name]
    assert '\n' not in str(caught.value)
    return str(caught.value)


@each_format
def test_samples_units_and_rate_are_those_of_the_file(tmp_path, name):
    WRITERS[name](tmp_path / name)
    layout = UNTIMED
    expected = TABLE * EXPECTED
    if name in WITHOUT_UNITS:
        expected = TABLE * [1, 1e-6]
    found = imported(tmp_path, name, layout)
    assert open_bag(tmp_path / 'bag.mcap').description.sample_rate == pytest.approx(RATE, abs=1e-9)
    np.testing.assert_allclose(found, expected, rtol=max(PRECISION.get(name, 0), 5e-16))


@each_format
def test_numbers_in_the_units_of_the_layout_come_bit_for_bit(tmp_path, name):
    WRITERS[name](tmp_path / name, units=('N', 'um'))
    found = imported(tmp_path, name)
    if name in PRECISION:
        np.testing.assert_allclose(found, TABLE / [1, 1e6], rtol=PRECISION[name])
    else:
        assert found.tobytes() == (TABLE / [1, 1e6]).tobytes()


@pytest.mark.parametrize('name', [name for name in WRITERS if name not in WITHOUT_UNITS])
def test_unit_of_another_quantity_is_refused_unless_units_are_ignored(tmp_path, name):
    WRITERS[name](tmp_path / name, units=('N', 'V'))
    message = error_of(tmp_path, name)
    assert 'probe' in message
    assert 'is in V, but the layout expects um from a sensor of displacement' in message
    assert '--ignore-units' in message
    found = imported(tmp_path, name, ignore_units=True)
    np.testing.assert_allclose(found, TABLE / [1, 1e6], rtol=1e-11)


@each_format
def test_sample_rate_that_contradicts_the_layout_is_refused(tmp_path, name):
    WRITERS[name](tmp_path / name, rate=10_000.0)
    message = error_of(tmp_path, name)
    assert '10000 Hz' in message
    assert '12800 Hz' in message
    assert 'correct sample_rate in the layout' in message


@pytest.mark.parametrize('name', [name for name in WRITERS if not name.endswith(('uff', 'unv'))])
def test_sample_rate_that_nobody_tells_is_asked_for(tmp_path, name):
    WRITERS[name](tmp_path / name, rate=None)
    assert 'give sample_rate [Hz] in the layout' in error_of(tmp_path, name, UNTIMED)
    imported(tmp_path, name, LAYOUT)


@each_format
def test_missing_column_names_those_there_are(tmp_path, name):
    WRITERS[name](tmp_path / name)
    layout = replace(LAYOUT, sensors=(SENSORS[0], replace(SENSORS[1], column='prope')))
    message = error_of(tmp_path, name, layout)
    assert "no column 'prope' (sensor probe)" in message
    assert 'probe' in message.split('the file has')[1]


@each_format
def test_column_goes_by_number_too(tmp_path, name):
    WRITERS[name](tmp_path / name, units=('N', 'um'))
    shift = int(name.endswith('csv'))  # the time
    layout = replace(
        UNTIMED,
        sensors=tuple(replace(one, column=str(i + 1 + shift)) for i, one in enumerate(SENSORS)),
    )
    np.testing.assert_allclose(imported(tmp_path, name, layout), TABLE / [1, 1e6], rtol=1e-11)


@each_format
def test_numbers_that_are_none_become_missing_samples(tmp_path, name):
    table = TABLE.copy()
    table[1234, 1] = np.nan
    table[77, 0] = np.inf
    WRITERS[name](tmp_path / name, table)
    found = imported(tmp_path, name)
    lost = [[77, 0], [1234, 1]]
    if name in ('a.uff', 'text.unv'):
        lost.pop()  # pyuff writes 0 for NaN
    assert np.argwhere(np.isnan(found)).tolist() == lost


# What is left of a CSV or TDMS file is sound, or tells where it breaks.
@pytest.mark.parametrize('name', [one for one in WRITERS if one not in ('a.csv', 'a.tdms')])
def test_file_that_is_cut_off_is_refused_in_words(tmp_path, name):
    WRITERS[name](tmp_path / name)
    content = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(content[: len(content) * 2 // 3])
    assert str(tmp_path / name) in error_of(tmp_path, name)


@each_format
def test_file_of_another_format_is_refused_in_words(tmp_path, name):
    (tmp_path / name).write_bytes(b'\x00\x01nothing of the kind\n' * 40)
    assert str(tmp_path / name) in error_of(tmp_path, name)


@each_format
def test_format_may_be_named(tmp_path, name):
    WRITERS[name](tmp_path / name)
    (tmp_path / name).rename(tmp_path / 'record.001')
    formats = {'uff': 'uff58', 'unv': 'uff58', 'h5': 'hdf5'}
    ending = name.partition('.')[2]
    found = imported(tmp_path, 'record.001', format_name=formats.get(ending, ending))
    assert len(found) == ROWS


@pytest.mark.parametrize('name', ['a.tdms', 'a.h5'])
def test_columns_of_different_length_are_refused(tmp_path, name):
    path = tmp_path / name
    if name == 'a.h5':
        with h5py.File(path, 'w') as file:
            file['force'], file['probe'] = TABLE[:, 0], TABLE[:-1, 1]
    else:
        with TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    ChannelObject('run', 'force', TABLE[:, 0]),
                    ChannelObject('run', 'probe', TABLE[:-1, 1]),
                ]
            )
    message = error_of(tmp_path, name)
    assert "probe' has 2999 values" in message
    assert "force' has 3000" in message


@pytest.mark.parametrize('options', [{}, {'compression': 'gzip'}])
@pytest.mark.parametrize('kind', ['f4', 'i2', '>f8', 'u1'])
def test_numbers_of_every_type_become_doubles(tmp_path, kind, options):
    table = (TABLE * 20 + 100).astype(kind)
    write_hdf5(tmp_path / 'a.h5', table, ('', ''), **options)
    found = imported(tmp_path, 'a.h5')
    assert found.tobytes() == (table.astype(float) / [1, 1e6]).tobytes()


@pytest.mark.parametrize('wide', [False, True])
def test_longer_side_of_a_matrix_is_time(tmp_path, wide):
    layout = replace(
        UNTIMED,
        sensors=(replace(SENSORS[0], column='data.1'), replace(SENSORS[1], column='data.2')),
    )
    table = TABLE.T if wide else TABLE
    savemat(tmp_path / 'a.mat', {'run': {'data': table, 'fs': RATE}}, do_compression=True)
    assert imported(tmp_path, 'a.mat', layout).tobytes() == (TABLE / [1, 1e6]).tobytes()
    with h5py.File(tmp_path / 'v73.mat', 'w', userblock_size=512) as file:
        file['run/data'], file['run/fs'] = table, RATE
    with (tmp_path / 'v73.mat').open('r+b') as stream:
        stream.write(b'MATLAB 7.3 MAT-file'.ljust(128))
    layout = replace(
        layout,
        sensors=(replace(SENSORS[0], column='data/1'), replace(SENSORS[1], column='run/data/2')),
    )
    (tmp_path / 'bag.mcap').unlink()
    assert imported(tmp_path, 'v73.mat', layout).tobytes() == (TABLE / [1, 1e6]).tobytes()


def test_time_column_of_a_binary_file_counts(tmp_path):
    times = np.delete(np.arange(ROWS + 5), range(100, 105)) / RATE
    with h5py.File(tmp_path / 'a.h5', 'w') as file:
        file['force'], file['probe'], file['time'] = TABLE[:, 0], TABLE[:, 1], times * 1e3
        file['time'].attrs['units'] = 'ms'
    result = import_table(tmp_path / 'a.h5', UNTIMED, tmp_path / 'bag.mcap')
    assert (result.samples, result.lost_samples) == (ROWS, 5)
    with h5py.File(tmp_path / 'a.h5', 'r+') as file:
        file['time'][2000:] += 0.01
    (tmp_path / 'bag.mcap').unlink()
    message = error_of(tmp_path, 'a.h5', UNTIMED)
    assert 'time is not uniform: near row 2001' in message


def test_uneven_instants_of_a_universal_file_are_refused(tmp_path):
    write_uff(tmp_path / 'a.uff', abscissa_spacing=0, binary=0)
    assert 'uneven instants' in error_of(tmp_path, 'a.uff')


def test_channels_of_different_rates_are_refused(tmp_path):
    with TdmsWriter(tmp_path / 'a.tdms') as writer:
        writer.write_segment(
            [
                ChannelObject('run', one.name, TABLE[:, i], {'wf_increment': (i + 1) * 1e-4})
                for i, one in enumerate(SENSORS)
            ]
        )
    message = error_of(tmp_path, 'a.tdms', UNTIMED)
    assert 'has a sample rate of 5000 Hz' in message
    assert '10000 Hz' in message


def test_unit_that_nobody_knows_is_told_and_taken_from_the_layout(tmp_path):
    write_tdms(tmp_path / 'a.tdms', units=('EU', 'um'))
    result = import_table(tmp_path / 'a.tdms', LAYOUT, tmp_path / 'bag.mcap')
    (note,) = result.notes
    assert "'EU', which is not known" in note
    assert 'taken to be in N' in note


@pytest.mark.parametrize(
    ('unit', 'factor'),
    [('g', 9.80665), ('m/s2', 1), ('m/s²', 1), ('m/s**2', 1), ('mm/s^2', 1e-3), ('Gal', 0.01)],
)
def test_unit_of_an_acceleration_is_understood_as_loggers_write_it(tmp_path, unit, factor):
    layout = replace(
        LAYOUT, sensors=(SENSORS[0], Sensor('probe', SensorKind.ACCELERATION, body='knee'))
    )
    write_tdms(tmp_path / 'a.tdms', units=('N', unit))
    found = imported(tmp_path, 'a.tdms', layout)
    np.testing.assert_allclose(found[:, 1], TABLE[:, 1] * factor, rtol=1e-15)


def test_library_that_is_missing_is_named(tmp_path, monkeypatch):
    write_tdms(tmp_path / 'a.tdms')
    monkeypatch.setitem(sys.modules, 'nptdms', None)
    message = error_of(tmp_path, 'a.tdms')
    assert 'TDMS files need the Python package npTDMS' in message
    assert 'pip install npTDMS' in message


def test_libraries_are_imported_only_for_their_formats(tmp_path):
    write_csv(tmp_path / 'a.csv')
    code = (
        'import sys; from identnl_ros.storage.formats.formats import open_table; '
        'from pathlib import Path; open_table(Path(sys.argv[1])); '
        'print([one for one in ("h5py", "nptdms", "pyarrow") if one in sys.modules])'
    )
    shown = subprocess.run(
        [sys.executable, '-c', code, tmp_path / 'a.csv'],
        capture_output=True,
        text=True,
        check=True,
    )
    assert shown.stdout == '[]\n'


def test_damaged_matlab_file_does_not_end_the_process(tmp_path):
    generator = np.random.default_rng(1)
    path = tmp_path / 'sound.mat'
    columns = {
        't': np.arange(50.0) / 100,
        'a': generator.standard_normal(50),
        'b': generator.standard_normal((50, 2)),
        'fs': 100.0,
    }
    savemat(path, columns)
    sound = path.read_bytes()
    # The last of these ends scipy's reader by a signal.
    for _ in range(15):
        damaged = bytearray(sound)
        for _ in range(3):
            damaged[128 + int(generator.integers(len(sound) - 128))] = int(generator.integers(256))
    path.write_bytes(damaged)
    with pytest.raises(DataError, match=r'sound\.mat'):
        matlab_table(path)
