# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whatever looks like a time in a table is checked against the sample rate, or refused."""

from collections.abc import Callable, Sequence
from pathlib import Path
import warnings

import h5py
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.table_import import import_table, Imported
from nptdms import ChannelObject, TdmsWriter
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import pyuff
from scipy.io import savemat

RATE = 5000.0
LAYOUT = Layout(
    (
        Sensor('force', SensorKind.FORCE, excitation='shaker'),
        Sensor('probe', SensorKind.DISPLACEMENT, body='knee', recorded_unit='um', gain=1e6),
    ),
    'mill',
    RATE,
)
ROWS = 1200
TABLE = np.random.default_rng(1).standard_normal((ROWS, 2))
BEGIN = np.datetime64('2026-11-22T18:40:00', 'ns')
KEPT = np.delete(np.arange(ROWS), range(700, 900))  # of the rows, where some are missing


def seconds(rows: np.ndarray, rate: float) -> np.ndarray:
    return rows / rate


def milliseconds(rows: np.ndarray, rate: float) -> np.ndarray:
    return rows / rate * 1e3


def dates(rows: np.ndarray, rate: float) -> np.ndarray:
    return BEGIN + np.rint(rows / rate * 1e9).astype('m8[ns]')


def iso(rows: np.ndarray, rate: float) -> np.ndarray:
    return np.array([str(one)[:26] for one in dates(rows, rate)])


def german(rows: np.ndarray, rate: float) -> np.ndarray:
    return np.array([f'22.11.2026 18:40:{one:07.4f}' for one in rows / rate])


def write_csv(path: Path, name: str, times: np.ndarray, table: np.ndarray):
    texts = [f'{one:.9g}' for one in times] if times.dtype.kind == 'f' else map(str, times)
    rows = [f'{time};{a!r};{b!r}' for time, (a, b) in zip(texts, table.tolist(), strict=True)]
    path.write_text('\n'.join([f'{name};force;probe', *rows]) + '\n')


def write_hdf5(path: Path, name: str, times: np.ndarray, table: np.ndarray):
    with h5py.File(path, 'w') as file:
        file['force'], file['probe'] = table.T
        file[name] = times if times.dtype.kind == 'f' else [str(one) for one in times]


def write_mat(path: Path, name: str, times: np.ndarray, table: np.ndarray):
    values = times if times.dtype.kind == 'f' else np.array([str(one) for one in times], object)
    savemat(path, {'force': table[:, 0], 'probe': table[:, 1], name: values})


def write_tdms(path: Path, name: str, times: np.ndarray, table: np.ndarray):
    values = times.astype('M8[us]') if times.dtype.kind == 'M' else times
    columns = {'force': table[:, 0], 'probe': table[:, 1], name: values}
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject('run', one, data) for one, data in columns.items()])


def write_parquet(path: Path, name: str, times: np.ndarray, table: np.ndarray):
    columns = {name: times, 'force': table[:, 0], 'probe': table[:, 1]}
    pyarrow.parquet.write_table(pyarrow.table(columns), path)


WRITERS: dict[str, Callable[..., None]] = {
    'a.csv': write_csv,
    'a.h5': write_hdf5,
    'a.mat': write_mat,
    'a.tdms': write_tdms,
    'a.parquet': write_parquet,
}
# How a time column may be called, and what is in it.
FORMS: dict[str, tuple[str, Callable[[np.ndarray, float], np.ndarray]]] = {
    'zeit': ('Zeit', seconds),
    'timestamp': ('Timestamp', seconds),
    't': ('t', seconds),
    'milliseconds': ('time_ms', milliseconds),
    'no unit': ('Zeit', milliseconds),
    'labview': ('X_Value', seconds),
    'even': ('channel0', milliseconds),
    'days': ('datenum', lambda rows, rate: (rows / rate) / 86_400),
    'counter': ('n', lambda rows, rate: rows * (RATE / rate)),
    'iso': ('time', iso),
    'unnamed iso': ('channel0', iso),
    'german': ('Datum', german),
    'dates': ('when', dates),
}
each_format = pytest.mark.parametrize('file', WRITERS)
# All forms in text; of the others, numbers and what they themselves have for dates.
each_case = pytest.mark.parametrize(
    ('file', 'form'),
    [('a.csv', form) for form in FORMS]
    + [(file, form) for file in WRITERS if file != 'a.csv' for form in ('zeit', 'even', 'dates')],
)


def write(tmp_path: Path, file: str, form: str, rows: np.ndarray, rate: float = RATE) -> Path:
    name, times = FORMS[form]
    WRITERS[file](tmp_path / file, name, times(rows, rate), TABLE[: len(rows)])
    return tmp_path / file


def imported(tmp_path: Path, path: Path, layout: Layout = LAYOUT, **options) -> Imported:
    (tmp_path / 'bag.mcap').unlink(missing_ok=True)
    return import_table(path, layout, tmp_path / 'bag.mcap', **options)


def error_of(tmp_path: Path, path: Path, layout: Layout = LAYOUT, **options) -> str:
    with pytest.raises(DataError) as caught:
        imported(tmp_path, path, layout, **options)
    assert '\n' not in str(caught.value)
    return str(caught.value)


def csv(tmp_path: Path, head: str, columns: Sequence[Sequence[str]]) -> Path:
    rows = zip(*columns, TABLE[:, 0].tolist(), TABLE[:, 1].tolist(), strict=False)
    lines = ['\t'.join(map(str, row)) for row in rows]
    (tmp_path / 'a.csv').write_text('\n'.join([f'{head}\tforce\tprobe', *lines]) + '\n')
    return tmp_path / 'a.csv'


@each_case
def test_time_that_agrees_with_the_layout_is_told(tmp_path, file, form):
    result = imported(tmp_path, write(tmp_path, file, form, np.arange(ROWS)))
    assert (result.samples, result.lost_samples) == (ROWS, 0)
    (name,) = result.time_columns
    assert name.rpartition('/')[2] == FORMS[form][0]
    assert result.unused_columns == ()


@each_case
def test_time_of_another_rate_is_refused(tmp_path, file, form):
    path = write(tmp_path, file, form, np.arange(ROWS), 2 * RATE)
    message = error_of(tmp_path, path)
    assert FORMS[form][0] in message
    assert '5000 Hz' in message
    assert '--ignore-column' in message
    result = imported(tmp_path, path, ignored=[FORMS[form][0]])
    assert result.time_columns == ()
    assert [one.rpartition('/')[2] for one in result.unused_columns] == [FORMS[form][0]]


@each_case
def test_missing_rows_are_a_gap_and_not_glued_together(tmp_path, file, form):
    result = imported(tmp_path, write(tmp_path, file, form, KEPT))
    assert (result.samples, result.lost_samples) == (len(KEPT), 200)
    blocks = list(open_bag(tmp_path / 'bag.mcap').blocks())
    indices = np.concatenate([np.arange(b.first_index, b.next_index) for b in blocks])
    assert indices.tolist() == KEPT.tolist()


@pytest.mark.parametrize(
    ('file', 'form'), [('a.csv', 'german'), ('a.mat', 'iso'), ('a.tdms', 'dates'), ('a.h5', 'iso')]
)
def test_dates_are_the_stamps_of_the_bag(tmp_path, file, form):
    imported(tmp_path, write(tmp_path, file, form, 7 + np.arange(ROWS)))
    (first, *_, last) = open_bag(tmp_path / 'bag.mcap').blocks()
    begin = int(BEGIN.astype(np.int64))
    assert first.stamp_ns == begin + 1_400_000
    assert last.stamp_ns == begin + (7 + last.first_index) * 200_000


@each_format
def test_dates_tell_the_sample_rate(tmp_path, file):
    layout = Layout(LAYOUT.sensors, 'mill')
    imported(tmp_path, write(tmp_path, file, 'iso', np.arange(ROWS)), layout)
    assert open_bag(tmp_path / 'bag.mcap').description.sample_rate == RATE


def test_seconds_of_days_do_not_cost_the_nanoseconds(tmp_path):
    times = dates(np.arange(ROWS), 4e6)  # steps of 250 ns, which no double since 1970 resolves
    layout = Layout(LAYOUT.sensors, 'mill', 4e6)
    result = imported(tmp_path, csv(tmp_path, 'time', [[str(one) for one in times]]), layout)
    assert (result.lost_samples, result.time_columns) == (0, ('time',))
    times = times[np.arange(ROWS) != 500]
    result = imported(tmp_path, csv(tmp_path, 'time', [[str(one) for one in times]]), layout)
    assert result.lost_samples == 1


def test_seconds_since_1970_tell_a_round_rate_as_far_as_they_are_resolved(tmp_path):
    times = 1.7953728e9 + np.arange(4 * ROWS) / 8000  # to 0.2 us, as doubles are there
    table = np.tile(TABLE, (4, 1))
    write_csv(tmp_path / 'a.csv', 'time', np.array([f'{one:.6f}' for one in times]), table)
    imported(tmp_path, tmp_path / 'a.csv', Layout(LAYOUT.sensors, 'mill'))
    stream = open_bag(tmp_path / 'bag.mcap').description
    assert stream.sample_rate == 8000
    assert stream.stamp_ns == 1_795_372_800 * 10**9


@pytest.mark.parametrize('text', ['', 'nan', 'inf', '1e400'])
@pytest.mark.parametrize('at', [0, 5, 1150])
def test_row_without_a_time_is_refused(tmp_path, text, at):
    texts = [f'{row / RATE:.6f}' for row in range(ROWS)]
    texts[at] = text
    message = error_of(tmp_path, csv(tmp_path, 'time', [texts]))
    assert f"near line {at + 2} there is no time (column 'time')" in message


def test_time_that_leaps_beyond_all_measure_is_refused(tmp_path):
    texts = [*(f'{row / RATE:.6f}' for row in range(50)), '9e29']
    assert 'near line 52 it steps by 9e+29 s' in error_of(tmp_path, csv(tmp_path, 'time', [texts]))


@pytest.mark.parametrize('missing', [1, 2, 7])
@pytest.mark.parametrize('at', [50, 1100])
def test_single_row_is_missed_where_the_last_digit_counts_rows(tmp_path, missing, at):
    layout = Layout(LAYOUT.sensors, 'mill', 1000.0)
    rows = np.delete(np.arange(ROWS), range(at, at + missing))
    path = csv(tmp_path, 'time', [[f'{row / 1000:.3f}' for row in rows]])
    result = imported(tmp_path, path, layout)
    assert (result.samples, result.lost_samples) == (len(rows), missing)


@pytest.mark.parametrize('rate', [1.001, 0.5])
def test_coarse_time_that_runs_away_is_refused_in_the_end(tmp_path, rate):
    table = np.tile(TABLE, (10, 1))
    rows = len(table)
    texts = [str(BEGIN.astype('M8[s]') + int(row / RATE / rate)) for row in range(rows)]
    write_csv(tmp_path / 'a.csv', 'Uhrzeit', np.array(texts), table)
    if rate == 0.5:
        assert "by column 'Uhrzeit', " in error_of(tmp_path, tmp_path / 'a.csv')
    else:  # as far as its digits go
        assert imported(tmp_path, tmp_path / 'a.csv').time_columns == ('Uhrzeit',)


def test_two_clocks_must_agree_and_the_finer_one_counts(tmp_path):
    rows = np.delete(np.arange(ROWS), 333)
    coarse = [f'{row / RATE:.2f}' for row in rows]
    result = imported(tmp_path, csv(tmp_path, 'time\tn', [coarse, rows.tolist()]))
    assert result.time_columns == ('n', 'time')
    assert result.lost_samples == 1
    shifted = [f'{(row + (50 if row > 1100 else 0)) / RATE:.3f}' for row in rows]
    message = error_of(tmp_path, csv(tmp_path, 'time\tn', [shifted, rows.tolist()]))
    assert "column 'time'" in message


@pytest.mark.parametrize(
    ('name', 'text'),
    [
        ('time', '11/22/2026 18:40:00'),
        ('Zeitstempel', 'eben'),
        ('Time', '6:40:00 PM'),
    ],
)
def test_time_that_is_not_understood_is_refused(tmp_path, name, text):
    message = error_of(tmp_path, csv(tmp_path, name, [[text] * ROWS]))
    assert f"column '{name}' begins with '{text}', which is no time that is understood" in message
    result = imported(tmp_path, tmp_path / 'a.csv', ignored=[name])
    assert result.unused_columns == (name,)


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('temperature', 20 + np.arange(ROWS) // 100 / 10),
        ('delay [ms]', np.full(ROWS, 3.5)),
        ('cycle time', np.full(ROWS, 12.0)),
        ('noise', np.random.default_rng(2).standard_normal(ROWS)),
        ('feed [mm]', np.arange(ROWS) * 0.01),
        ('T [degC]', np.arange(ROWS) * 0.01),
        ('remark', np.full(ROWS, 'ok')),
    ],
)
def test_what_is_no_time_is_named_and_left_alone(tmp_path, name, values):
    result = imported(tmp_path, csv(tmp_path, name, [values.tolist()]))
    assert result.unused_columns == (name,)
    assert result.time_columns == ()


def test_column_without_a_name_goes_by_its_number(tmp_path):
    times = np.arange(ROWS) / (2 * RATE)
    lines = [f'{a!r} {time:.6f} {b!r}' for (a, b), time in zip(TABLE, times, strict=True)]
    (tmp_path / 'a.csv').write_text('\n'.join(lines).replace('np.float64(', '').replace(')', ''))
    layout = Layout(
        tuple(
            Sensor(one.name, one.kind, column=column, excitation=one.excitation, body=one.body)
            for one, column in zip(LAYOUT.sensors, ('1', '3'), strict=True)
        ),
        'mill',
        RATE,
    )
    message = error_of(tmp_path, tmp_path / 'a.csv', layout)
    assert 'column 2 rises evenly by 0.0001' in message
    result = imported(tmp_path, tmp_path / 'a.csv', layout, ignored=['2'])
    assert result.unused_columns == ('2',)


def test_time_column_of_a_sensor_is_a_sensor(tmp_path):
    layout = Layout(
        (Sensor('force', SensorKind.FORCE, excitation='shaker', column='time'), LAYOUT.sensors[1]),
        'mill',
        RATE,
    )
    result = imported(tmp_path, write(tmp_path, 'a.csv', 'iso', np.arange(4)), LAYOUT)
    assert result.time_columns == ('time',)
    path = csv(tmp_path, 'time', [np.arange(ROWS).tolist()])
    result = imported(tmp_path, path, layout)
    assert (result.time_columns, result.unused_columns) == ((), ('force',))


def test_times_of_other_channels_do_not_count(tmp_path):
    with h5py.File(tmp_path / 'a.h5', 'w') as file:
        file['fast/force'], file['fast/probe'] = TABLE.T
        file['fast/time'] = np.arange(ROWS) / RATE
        file['slow/temperature'], file['slow/time'] = np.full(15, 20.0), np.arange(15) / 50
    result = imported(tmp_path, tmp_path / 'a.h5')
    assert result.time_columns == ('fast/time',)
    assert set(result.unused_columns) == {'slow/temperature', 'slow/time'}
    with h5py.File(tmp_path / 'a.h5', 'r+') as file:
        del file['fast/time']
    message = error_of(tmp_path, tmp_path / 'a.h5')
    assert "column 'slow/time' has another number of values than 'fast/force'" in message


@pytest.mark.parametrize('binary', [0, 1])
def test_abscissas_of_a_universal_file_must_agree(tmp_path, binary):
    def record(name: str, begin: float, rate: float):
        data = {
            'type': 58, 'binary': binary, 'func_type': 1, 'id1': name, 'rsp_node': 1, 'rsp_dir': 3,
            'ref_node': 0, 'ref_dir': 0, 'data': TABLE[:, 0], 'x': begin + np.arange(ROWS) / rate,
            'abscissa_spacing': 1, 'abscissa_spec_data_type': 17, 'ordinate_spec_data_type': 8,
            'orddenom_spec_data_type': 0, 'abscissa_min': begin,
        }  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', ResourceWarning)  # it leaves files open
            pyuff.UFF(str(tmp_path / 'a.uff')).write_sets(data, 'add')

    record('force', 3.0, RATE)
    record('probe', 3.0, RATE)
    record('other', 0.0, 3 * RATE)
    result = imported(tmp_path, tmp_path / 'a.uff')
    assert (result.samples, result.unused_columns) == (ROWS, ('other',))
    (tmp_path / 'a.uff').unlink()
    record('force', 3.0, RATE)
    record('probe', 3.5, RATE)
    assert "'probe' begins at 3.5 s, but 'force' at 3 s" in error_of(tmp_path, tmp_path / 'a.uff')
