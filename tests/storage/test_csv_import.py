# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""CSV files of other programs become bags, or an error names the line and the remedy."""

from dataclasses import replace

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.blocks import ChannelStatus
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.formats.csv_table import CsvTable
from identnl_ros.storage.table_import import import_table, read_table
import numpy as np
import pytest

SENSORS = (
    Sensor('force', SensorKind.FORCE, excitation='table', column='F', gain=0.01, offset=0.5),
    Sensor('probe', SensorKind.DISPLACEMENT, body='knee', column='x 1', gain=8000.0),
)
LAYOUT = Layout(SENSORS, 'mill', 1000.0)
TIMED = replace(LAYOUT, sample_rate=None)
ROWS = [[1.5, 2.0], [-3.25, 4e-3], [0.1, -1e3]]


def read(tmp_path, text, layout=LAYOUT, **options):
    path = tmp_path / 'a.csv'
    path.write_bytes(text if isinstance(text, bytes) else text.encode(**options))
    reading = read_table(CsvTable(path), layout)
    return reading.sample_rate, np.vstack([samples for _, samples in reading.pieces])


def si(rows):
    rows = np.array(rows)
    time = np.arange(len(rows)) / 1000
    return np.column_stack([one.to_si(rows[:, i], time) for i, one in enumerate(SENSORS)])


def error_of(tmp_path, text, layout=LAYOUT):
    with pytest.raises(DataError) as caught:
        read(tmp_path, text, layout)
    assert '\n' not in str(caught.value)
    return str(caught.value).removeprefix(str(tmp_path / 'a.csv'))


@pytest.mark.parametrize(
    'text',
    [
        'F,x 1\n1.5,2.0\n-3.25,4e-3\n0.1,-1000\n',
        'x 1,note,F\n2,a,1.5\n.004,b,-3.25\n-1E3,,0.1',
        ' F , x 1 ,\n 1.5 , 2.0 ,\n-3.25,4e-3,\n0.1,-1000,\n',
        'F,x 1\n1.5,2.0,\n-3.25,4e-3\n0.1,-1000,\n',
        'F;x 1\r\n1.5;2.0\r\n-3.25;4e-3\r\n0.1;-1000\r\n',
        'F\tx 1\n1.5\t2.0\n-3.25\t4e-3\n0.1\t-1000\n',
        '# made by a logger\n\n"F","x 1"\n# units: V\n1.5,2.0\n\n"-3.25",4e-3 # odd\n0.1,-1000\n',
        '\ufeffF,x 1\n1.5,2.0\n-3.25,4e-3\n0.1,-1000\n',
        '# F,x 1\n1.5,2.0\n-3.25,4e-3\n0.1,-1000\n',
        b'F,x 1,\xb5\n1.5,2.0,0\n-3.25,4e-3,0\n0.1,-1000,0\n',
    ],
    ids=[
        'plain', 'order', 'blanks', 'trailing', 'semicolon', 'tab', 'comments', 'mark', 'savetxt',
        'latin1',
    ],
)  # fmt: skip
def test_forms_of_the_same_table_give_the_same_samples(tmp_path, text):
    rate, samples = read(tmp_path, text)
    assert rate == 1000
    assert samples.tobytes() == si(ROWS).tobytes()


GERMAN = 'F;x 1\n1,5;2,0\n-3,25;4e-3\n0,1;-1000\n'


@pytest.mark.parametrize(
    'text',
    [
        GERMAN,
        GERMAN.replace(';', '\t'),
        GERMAN.replace('4e-3', '0,4E-2').replace('2,0', '2'),
        'F;x 1;note\n1,5;2,0;v1.2\n-3,25;4e-3;a,b\n0,1;-1000;1.5\n',
        '1,5;2,0\n-3,25;4e-3\n0,1;-1000\n',
        'F;x 1\n' + '7;7\n' * 1500 + GERMAN.partition('\n')[2],  # decided late
    ],
    ids=['semicolon', 'tab', 'exponent', 'text', 'no names', 'late'],
)
def test_decimal_commas_between_semicolons_and_tabs_are_understood(tmp_path, text):
    layout = LAYOUT
    if not text.startswith('F'):
        sensors = (replace(SENSORS[0], column='1'), replace(SENSORS[1], column='2'))
        layout = replace(LAYOUT, sensors=sensors)
    _, samples = read(tmp_path, text, layout)
    assert samples[-3:].tobytes() == si([*[[7, 7]] * (len(samples) - 3), *ROWS])[-3:].tobytes()


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('F;x 1\n1,5;2.5\n', ": there are numbers with a decimal comma (column 1 'F') and with"),
        ('F;x 1\n1,5;2\n2.5;1\n', ': there are numbers with a decimal comma'),
        ('F;x 1\n' + '1;2\n' * 2000 + '1,5;2\n2.5;1\n', ":2003: '2.5' has a decimal point, but"),
        ('F;x 1\n1.5;2\n' + '1;2\n' * 2000 + '2,5;1\n', ":2003: '2,5' has a decimal comma, but"),
        ('F;x 1\n1.234,5;2\n', ":2: '1.234,5' is not a number, with one decimal point or comma"),
        ('F,x 1\n"1,5",2\n', ':2: 3 cells, but line 1'),
    ],
)
def test_mixed_decimal_marks_are_refused(tmp_path, text, expected):
    assert error_of(tmp_path, text).startswith(expected)


@pytest.mark.parametrize(
    'head',
    [
        'F;x 1\nkN;mV\n', 'F;x 1\n[kN];[mV]\n', 'F [kN];x 1\n(kN);(mV)\n', 'F (kN);x 1 [mV]\n',
        'Messung: 5\nDatum: 22.11.2026\nRate;5000;Hz\n\nF;x 1\nkN;mV\n',
        'Operator;somebody\n1,5;2\nF [kN];x 1;\n;mV;\n',
    ],
)  # fmt: skip
def test_names_and_units_are_found_where_loggers_put_them(tmp_path, head):
    path = tmp_path / 'a.csv'
    path.write_text(head + '1.5;2\n-3.25;4e-3\n')
    layout = replace(
        LAYOUT,
        sensors=(
            replace(SENSORS[0], recorded_unit='N', gain=1.0, offset=0.0),
            replace(SENSORS[1], recorded_unit='V', gain=8000.0),
        ),
    )
    wanted = [sensor.column for sensor in layout.sensors]
    table = CsvTable(path, wanted)
    (piece,) = read_table(table, layout, pytest.fail).pieces
    np.testing.assert_allclose(piece[1][:, 0], [1500, -3250], rtol=1e-15)
    np.testing.assert_allclose(piece[1][:, 1] * 8000, [2e-3, 4e-6], rtol=1e-15)
    skipped = head.splitlines().index(next(x for x in head.splitlines() if x.startswith('F')))
    filled = sum(bool(line) for line in head.splitlines()[:skipped])
    notes = [f'{path}: the {filled} lines before the names of the columns in line {skipped + 1} '
             'are skipped'] if skipped else []  # fmt: skip
    assert table.notes == notes


def test_lines_before_the_names_are_asked_to_be_comments_where_nothing_tells(tmp_path):
    sensors = (replace(SENSORS[0], column='1'), replace(SENSORS[1], column='2'))
    message = error_of(tmp_path, 'made on Monday\nF;x 1\n1;2\n', replace(LAYOUT, sensors=sensors))
    assert message.startswith(':2: 2 cells, but line 1, where the names of the columns should')
    assert message.endswith('lines before the names must begin with #')


@pytest.mark.parametrize('encoding', ['latin-1', 'cp1252', 'utf-8', 'utf-8-sig'])
def test_micro_is_understood_in_every_usual_encoding(tmp_path, encoding):
    path = tmp_path / 'a.csv'
    path.write_bytes('F;x 1 [µV]\n1;2\n'.encode(encoding))
    layout = replace(
        LAYOUT, sensors=(SENSORS[0], replace(SENSORS[1], recorded_unit='V', gain=1.0))
    )
    table = CsvTable(path)
    (piece,) = read_table(table, layout, pytest.fail).pieces
    assert piece[1][0, 1] == pytest.approx(2e-6, rel=1e-15)
    assert bool(table.notes) == (not encoding.startswith('utf'))
    assert all('is not in UTF-8; it is read as Windows-1252' in note for note in table.notes)


def test_drift_is_taken_out_at_the_time_of_every_row(tmp_path):
    drifting = replace(TIMED, sensors=(SENSORS[0], replace(SENSORS[1], drift=2e3)))
    rows = '\n'.join(f'{i / 1000},1.5,{2000 * i / 1000}' for i in (0, 1, 2, 3, 7, 8, 9, 10))
    rate, samples = read(tmp_path, f'time,F,x 1\n{rows}\n', drifting)
    assert rate == 1000
    np.testing.assert_allclose(samples[:, 1], 0, atol=1e-15)


@pytest.mark.parametrize('separator', [',', ' ', '\t'])
def test_columns_by_number_where_there_are_no_names(tmp_path, separator):
    layout = Layout(
        (replace(SENSORS[0], column='3'), replace(SENSORS[1], column='1')), 'mill', 1000.0
    )
    text = '\n'.join(separator.join(map(str, [x, 0, force])) for force, x in ROWS)
    _, samples = read(tmp_path, text, layout)
    assert samples.tobytes() == si(ROWS).tobytes()


def test_numbers_are_read_to_the_last_bit(tmp_path):
    values = np.random.default_rng(1).standard_normal((500, 2))
    text = 'F,x 1\n' + '\n'.join(f'{float(a)!r},{float(b)!r}' for a, b in values)
    _, samples = read(tmp_path, text)
    assert samples.tobytes() == si(values).tobytes()


@pytest.mark.parametrize('empty', ['', ' ', 'NaN', 'nan'])
def test_empty_cells_are_missing_samples(tmp_path, empty):
    _, samples = read(tmp_path, f'F,x 1\n1.5,{empty}\n{empty},2\n')
    assert np.isnan(samples).tolist() == [[False, True], [True, False]]


@pytest.mark.parametrize('name', ['time', 'T', 'Time [s]', 't (s)', 'time_s'])
def test_sample_rate_comes_from_the_time_column(tmp_path, name):
    times = 3600 + np.arange(3000) / 12_800
    text = f'{name},F,x 1\n' + ''.join(f'{float(t)!r},1,2\n' for t in times)
    rate, samples = read(tmp_path, text, TIMED)
    assert rate == 12_800
    assert len(samples) == 3000


@pytest.mark.parametrize('at', [1, 2, 30, 500, 999])
def test_jump_of_time_is_refused_wherever_it_is(tmp_path, at):
    times = np.arange(2000) / 1000
    times[at:] += 2e-5
    text = 'time,F,x 1\n' + ''.join(f'{t:.9f},1,2\n' for t in times)
    message = error_of(tmp_path, text, TIMED)
    assert 'time is not uniform: near line' in message
    assert 'give sample_rate [Hz] in the layout' in message


def test_jump_between_two_pieces_is_refused(tmp_path):
    times = np.arange(200_000) / 100_000
    times[100_000:] += 5e-6
    text = 'time,F,x 1\n' + ''.join(f'{t:.9f},1,2\n' for t in times)
    assert 'near line 100002 it steps by 1.5e-05 s' in error_of(tmp_path, text, TIMED)


def test_time_that_stands_still_is_refused(tmp_path):
    text = 'time,F,x 1\n0,1,2\n0,1,2\n'
    assert 'the time does not increase' in error_of(tmp_path, text, TIMED)


def test_unknown_sample_rate_is_refused(tmp_path):
    message = error_of(tmp_path, 'F,x 1\n1,2\n', TIMED)
    assert 'no column "time" in seconds; give sample_rate' in message


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (
            'F,x1\n1,2\n',
            ": no column 'x 1' (sensor probe), did you mean 'x1'?; the file has F, x1",
        ),
        ('1,2\n', ": no column 'F' (sensor force); the file has no names but the columns 1 to 2"),
        ('F,x 1,F\n1,2,3\n', ": 2 columns are called 'F' (sensor force); give the number"),
        ('F [N],x 1,F\n1,2,3\n', ": 2 columns are called 'F' (sensor force); give the number"),
        ('F,x 1\n1,2\n1,1_0\n', ":3: '1_0' is not a number; correct it"),
        ('F,x 1\n1,2\n1,off\n', ":3: 'off' is not a number; correct it"),
        ('F,x 1\nN,off\n1,2\n', ":2: 'N' is not a number; correct it, or start the line with #"),
        ('F;x 1\n1.2,5;2\n', ":2: '1.2,5' is not a number, with one decimal point or comma"),
        ('# one\n\nF,x 1\n1,2\n\n1\n', ':6: 1 cells, expected 2 as in line 4'),
        ('F,x 1\n1,2\n1,2,3\n', ':3: 3 cells, expected 2'),
        ('', ' has no rows of numbers'),
        ('F,x 1\n', ' has no rows of numbers'),
        ('# F\n\n', ' has no rows of numbers'),
        (b'\xff\xfeF\0,\0x\0\n\0', ' is not a text file'),
        (b'\x89MCAP0\r\n\0\0', ' is not a text file'),
    ],
)
def test_unsound_file_is_refused_with_the_place(tmp_path, text, expected):
    assert error_of(tmp_path, text).startswith(expected)


def test_error_far_into_a_file_names_its_line_and_leaves_no_bag(tmp_path):
    text = 'F,x 1\n' + '1,2\n' * 5000 + '1,oops\n' + '1,2\n' * 100
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(DataError, match=r"a\.csv:5002: 'oops' is not a number"):
        import_table(tmp_path / 'a.csv', LAYOUT, tmp_path / 'a.mcap')
    assert not (tmp_path / 'a.mcap').exists()
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize('name', ['missing.csv', '.'])
def test_path_that_is_no_file(tmp_path, name):
    with pytest.raises(DataError, match=r'does not exist|is not a file'):
        CsvTable(tmp_path / name)


def test_bag_holds_the_samples_their_state_and_the_texts(tmp_path):
    values = np.random.default_rng(1).standard_normal((130, 2))
    lines = [f'{float(a)!r},{float(b)!r}' for a, b in values]
    lines[60] = '1,'
    lines[110] = 'inf,1'
    (tmp_path / 'a.csv').write_text('F,x 1\n' + '\n'.join(lines))
    seen = []
    imported = import_table(
        tmp_path / 'a.csv',
        LAYOUT,
        tmp_path / 'bag',
        layout_text='layout',
        machine_text='machine',
        stream_id=5,
        start_ns=10**9,
        progress=lambda done, size: seen.append((done, size)),
    )
    assert (imported.samples, imported.lost_samples) == (130, 0)
    bag = open_bag(tmp_path / 'bag')
    stream = bag.description
    assert (stream.stand, stream.stream_id, stream.sample_rate) == ('mill', 5, 1000)
    assert (stream.layout_text, stream.machine_text) == ('layout', 'machine')
    found = list(bag.blocks())
    assert [len(block.samples) for block in found] == [50, 50, 30]
    assert [block.last for block in found] == [False, False, True]
    assert [block.first_index for block in found] == [0, 50, 100]
    assert found[1].stamp_ns == 10**9 + 50_000_000
    assert [block.channel_status.tolist() for block in found] == [
        [0, 0],
        [0, ChannelStatus.MISSING_SAMPLES],
        [ChannelStatus.SATURATED, 0],
    ]
    assert np.isnan(found[1].samples[10, 1])
    assert np.isnan(found[2].samples[10, 0])
    assert found[0].samples.tobytes() == si(values[:50]).tobytes()
    size = (tmp_path / 'a.csv').stat().st_size
    assert seen[-1] == (size, size)


def timed_text(times, form='.6f'):
    return 'time,F,x 1\n' + ''.join(f'{t:{form}},1,{i}\n' for i, t in enumerate(times))


@pytest.mark.parametrize('form', ['.3f', '.4f', '.9f', '.6g', '.18e', '.2f'])
def test_time_column_that_agrees_with_the_layout_is_accepted(tmp_path, form):
    rate, samples = read(tmp_path, timed_text(np.arange(3000) / 1000, form))
    assert rate == 1000
    assert len(samples) == 3000


@pytest.mark.parametrize('form', ['.3f', '.9f', '.6g', '.2f'])
@pytest.mark.parametrize('true_rate', [500.0, 990.0, 2000.0])
def test_time_column_that_contradicts_the_layout_is_refused(tmp_path, form, true_rate):
    message = error_of(tmp_path, timed_text(np.arange(3000) / true_rate, form))
    assert 'the layout states a sample_rate of 1000 Hz' in message
    found = float(message.split("column 'time' it is ")[1].split(' Hz')[0])
    assert found == pytest.approx(true_rate, rel=2e-2)


@pytest.mark.parametrize('layout', [LAYOUT, TIMED])
def test_rows_missing_by_the_time_column_are_a_gap(tmp_path, layout):
    kept = np.delete(np.arange(300), [*range(1, 6), 49, *range(120, 131)])
    (tmp_path / 'a.csv').write_text(timed_text(kept / 1000))
    imported = import_table(tmp_path / 'a.csv', layout, tmp_path / 'a.mcap')
    assert (imported.samples, imported.lost_samples) == (283, 17)
    blocks = list(open_bag(tmp_path / 'a.mcap').blocks())
    indices = np.concatenate([np.arange(b.first_index, b.next_index) for b in blocks])
    assert indices.tolist() == kept.tolist()
    assert [block.last for block in blocks] == [False] * (len(blocks) - 1) + [True]
    assert blocks[1].stamp_ns == 6_000_000


@pytest.mark.parametrize('layout', [LAYOUT, TIMED])
def test_time_that_is_not_uniform_names_the_worst_line(tmp_path, layout):
    times = np.arange(2000) / 1000
    times[300:] += 2e-5
    times[700:] += 4.2e-4
    message = error_of(tmp_path, timed_text(times), layout)
    assert 'near line 702 it steps by 0.00142 s, expected 0.001 s' in message


def test_times_of_day_do_not_matter_where_the_layout_states_the_rate(tmp_path):
    rate, _ = read(tmp_path, 'time,F,x 1\n12:00:01,1,2\n12:00:01,1,2\n')
    assert rate == 1000


def test_two_sensors_of_one_column_are_refused(tmp_path):
    layout = replace(LAYOUT, sensors=(SENSORS[0], replace(SENSORS[1], column='1')))
    (tmp_path / 'a.csv').write_text('F,x 1\n1,2\n')
    with pytest.raises(LayoutError, match='sensors force and probe read the same column'):
        read_table(CsvTable(tmp_path / 'a.csv'), layout)


@pytest.mark.parametrize('reading', ['1e120', '-1e300', 'inf', '-inf'])
def test_reading_beyond_all_measure_is_saturated(tmp_path, reading):
    (tmp_path / 'a.csv').write_text(f'F,x 1\n1,2\n1,{reading}\n')
    import_table(tmp_path / 'a.csv', LAYOUT, tmp_path / 'a.mcap')
    (block,) = open_bag(tmp_path / 'a.mcap').blocks()
    assert block.channel_status.tolist() == [0, ChannelStatus.SATURATED]
    assert np.isnan(block.samples[1, 1])


def test_same_stream_id_gives_the_same_bag_and_none_a_new_one(tmp_path):
    (tmp_path / 'a.csv').write_text('F,x 1\n1,2\n')
    for name, stream_id in (('a', 5), ('b', 5), ('c', None), ('d', None)):
        import_table(tmp_path / 'a.csv', LAYOUT, tmp_path / f'{name}.mcap', stream_id=stream_id)
    a, b, c, d = ((tmp_path / f'{name}.mcap').read_bytes() for name in 'abcd')
    assert a == b
    assert c != d
