# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Files of one run, recorded with clocks of their own, become one bag on one time."""

from dataclasses import replace

from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.bag_writer import BagWriter
from nptdms import ChannelObject, TdmsWriter
import numpy as np
import pytest

RATE, DURATION = 2000.0, 8.0
SKEW, LATE = 40e-6, 3e-3  # of the second device's clock, of its stated begin
FREQUENCIES = np.arange(5.0, 200.0, 5.0) + 0.1
PHASES = np.random.default_rng(0).uniform(0, 2 * np.pi, len(FREQUENCIES))
LAYOUT = """
sensors:
  force: {kind: force, excitation: input, noise: 0.1 N}
  probe: {kind: displacement, body: mass, point: [0, 0, 0], direction: +x, noise: 1 nm}
  acceleration: {kind: acceleration, body: mass, point: [0, 0, 0], direction: +x, noise: 1 mm/s^2}
"""


def acceleration(time):
    return 0.1 * np.sin(2 * np.pi * np.multiply.outer(time, FREQUENCIES) + PHASES).sum(axis=1)


def displacement(time):
    angles = 2 * np.pi * np.multiply.outer(time, FREQUENCIES) + PHASES
    return -(0.1 * np.sin(angles) / (2 * np.pi * FREQUENCIES) ** 2).sum(axis=1)


def write(path, names, *columns):
    np.savetxt(path, np.column_stack(columns), '%.12g', ',', header=','.join(names), comments='')
    return path


@pytest.fixture
def run(tmp_path):
    """Write what two devices recorded; the second one's counts its own seconds, from its own 0."""
    generator = np.random.default_rng(1)
    index = np.arange(round(DURATION * RATE))
    first = index / RATE
    probes = write(
        tmp_path / 'probes.csv', ('time', 'force', 'probe'), first, np.sin(20 * first),
        displacement(first) + 1e-9 * generator.standard_normal(len(index)),
    )  # fmt: skip
    second = 0.5 + LATE + index / RATE * (1 + SKEW)
    others = write(
        tmp_path / 'others.csv', ('time', 'acceleration'), index / RATE,
        acceleration(second) + 1e-3 * generator.standard_normal(len(index)),
    )  # fmt: skip
    layout = tmp_path / 'layout.yaml'
    layout.write_text(LAYOUT)
    return probes, others, layout


STARTS = (
    '--start', 'probes=2026-03-01T12:00:00', '--start', 'others.csv=2026-03-01T13:00:00.5+01:00',
)  # fmt: skip


def test_motion_aligns_files_whose_begins_are_stated_to_milliseconds(
    document, run, config, tmp_path
):
    probes, others, layout = run
    bag = tmp_path / 'run.mcap'
    machine = config / 'oscillator.yaml'
    found = document(
        'import', probes, others, '--layout', layout, '--machine', machine, *STARTS, '--out', bag
    )
    first, second = found['sources']
    assert (first['name'], first['offset'], first['skew']) == ('probes', 0.0, 0.0)
    # The begin is stated too early.
    assert second['offset'] == pytest.approx(-LATE, abs=20e-6)
    assert second['skew'] == pytest.approx(SKEW, abs=1e-6)
    assert 0 < second['remaining'] < 2e-6
    assert found['sample_rate'] == RATE
    assert found['lost_samples'] == 0
    blocks = list(open_bag(bag).blocks())
    assert blocks[-1].last
    samples = np.concatenate([block.samples for block in blocks])
    assert found['samples'] == len(samples)
    # From where both have samples to where neither has.
    assert len(samples) / RATE == pytest.approx(DURATION, abs=0.1)
    # The first file's samples are those of the file; they say when they were taken.
    table = np.loadtxt(probes, delimiter=',', skiprows=1)
    begin = int(np.flatnonzero(table[:, 2] == samples[0, 1])[0])
    valid = np.isfinite(samples).all(axis=1)
    assert valid.mean() > 0.9
    time = (begin + np.arange(len(samples))) / RATE
    slope = np.gradient(acceleration(time), time)
    error = acceleration(time) - samples[:, 2]
    late = (slope[valid] @ error[valid]) / (slope[valid] @ slope[valid])
    assert abs(late) < 1e-6


def test_without_a_machine_the_stated_begin_decides_and_that_is_told(identnl, run, tmp_path):
    probes, others, layout = run
    result = identnl(
        'import', probes, others, '--layout', layout, *STARTS, '--out', tmp_path / 'a'
    )
    assert result.exit_code == 0
    assert 'others: aligned by its stamps alone' in result.stderr
    assert 'others: late by 0 ms' in result.stdout


def refused(identnl, tmp_path, *arguments):
    """Check that nothing is left and give the sentence."""
    bag = tmp_path / 'refused.mcap'
    result = identnl('import', *arguments, '--out', bag)
    assert result.exit_code == 2
    assert not bag.exists()
    return result.stderr


def test_relative_times_need_a_start(identnl, run, tmp_path):
    probes, others, layout = run
    text = refused(identnl, tmp_path, probes, others, '--layout', layout)
    assert '--start FILE=TIME' in text
    assert '--same-start' in text
    result = identnl(
        'import', probes, others, '--layout', layout, '--same-start', '--out', tmp_path / 'b'
    )
    assert result.exit_code == 0


def test_files_that_do_not_overlap_are_refused(identnl, run, tmp_path):
    probes, others, layout = run
    later = ('--start', 'probes=2026-03-01T12:00:00', '--start', 'others=2026-03-01T12:30:00')
    text = refused(identnl, tmp_path, probes, others, '--layout', layout, *later)
    assert 'probes: ends before others begins' in text


@pytest.mark.parametrize('begin', ['12:00:00.363', '12:00:00.83'])
def test_a_begin_that_is_wrong_by_more_than_is_stated_is_refused(
    identnl, run, config, tmp_path, begin
):
    probes, others, layout = run
    machine = ('--machine', config / 'oscillator.yaml')
    starts = ('--start', 'probes=2026-03-01T12:00:00', '--start', f'others=2026-03-01T{begin}')
    said = refused(identnl, tmp_path, probes, others, '--layout', layout, *machine, *starts)
    assert 'others: its motion does not fit that of probes within +-28.3 ms' in said
    assert '--start FILE=TIME' in said


def test_a_maximum_far_from_what_is_known_is_refused(identnl, run, config, tmp_path):
    probes, others, layout = run
    known = (*STARTS, '--start-deviation', '0.0001')  # 3 ms off are 21 standard deviations
    machine = ('--machine', config / 'oscillator.yaml')
    said = refused(identnl, tmp_path, probes, others, '--layout', layout, *machine, *known)
    assert 'others: its motion does not fit' in said


MACHINE = """
machine: table
bodies:
  table: {mass: 50 kg, centre_of_mass: [0, 0, 0], degrees_of_freedom: [translation_1]}
joints:
  spring:
    kind: six_spring
    body: table
    to: ground
    point: [0, 0, 0]
    stiffness: [{estimate: 1e7 N/m}]
    damping: [{estimate: 1e3 N*s/m}]
excitations:
  shaker: {body: table, point: [0, 0, 0], direction: +x, amplitude: 50 N,
           frequency: 60 Hz, band: [10 Hz, 300 Hz]}
"""
SENSORS = """
sample_rate: 5 kHz
sensors:
  force: {kind: force, excitation: shaker, noise: 0.02 N}
  probe: {kind: displacement, body: table, point: [0, 0, 0], direction: +x, noise: 10 nm}
  one: {kind: acceleration, body: table, point: [0, 0, 0], direction: +x, noise: 0.01}
  two: {kind: acceleration, body: table, point: [0, 0, 0], direction: +x, noise: 0.01}
"""


@pytest.fixture
def divided(identnl, tmp_path):
    """Simulate a run and divide its channels among two files; the second one is late."""
    (tmp_path / 'machine.yaml').write_text(MACHINE)
    (tmp_path / 'layout.yaml').write_text(SENSORS)
    files = ('--machine', tmp_path / 'machine.yaml', '--layout', tmp_path / 'layout.yaml')
    whole = tmp_path / 'whole.mcap'
    result = identnl(
        'simulate', *files, '--rate', 5000, '--duration', 3, '--seed', 1, '--out', whole
    )
    assert result.exit_code == 0, result.stderr
    blocks = open_bag(whole).blocks()
    samples = np.concatenate([block.samples for block in blocks])
    names = ('force', 'probe', 'one', 'two')

    def divide(columns, late):
        rest = [i for i in range(4) if i not in columns]
        time = np.arange(len(samples)) / 5000
        first = write(
            tmp_path / 'first.csv', ('time', *(names[i] for i in rest)), time, samples[:, rest]
        )
        rows = slice(late, None)  # samples that were taken so much later than they say
        second = write(
            tmp_path / 'second.csv', ('time', *(names[i] for i in columns)),
            time[: len(samples) - late], samples[rows][:, columns],
        )  # fmt: skip
        return (first, second, *files, '--same-start', '--out', tmp_path / 'run.mcap')

    return divide


def test_a_force_that_nothing_aligns_puts_the_estimates_in_doubt(
    identnl, document, divided, tmp_path
):
    found = document('import', *divided([0], 1))
    first, second = found['sources']
    assert (first['aligned'], second['aligned']) == (True, False)
    assert second['remaining'] == pytest.approx(np.hypot(5e-3, 5e-3), rel=0.1)
    (warning,) = found['warnings']
    assert 'It has no motion sensor' in warning
    # 0.2 ms of 7: 2 pi f tau / (2 zeta), with f = 71 Hz and zeta = 2.2 %, doubles the damping.
    estimate = document('identify', tmp_path / 'run.mcap')
    assert {one['status'] for one in estimate['parameters']} == {'model_in_doubt'}
    (told,) = [note for note in estimate['notes'] if note.startswith('second: ')]
    assert 'may remain (force); it changes the damping of the mode at 71' in told
    checked = document('check', tmp_path / 'run.mcap')['files'][0]
    assert checked['remaining_delays']['second'] == second['remaining']
    assert any('second: is not aligned' in one for one in checked['remarks'])


def test_what_the_motion_aligned_is_not_in_doubt(document, divided, tmp_path):
    found = document('import', *divided([3], 1))
    assert [one['aligned'] for one in found['sources']] == [True, True]
    assert found['sources'][1]['offset'] == pytest.approx(-1 / 5000, abs=5e-6)
    estimate = document('identify', tmp_path / 'run.mcap')
    assert not any('may remain' in note for note in estimate['notes'])
    assert {one['status'] for one in estimate['parameters']} == {'ok'}


def test_a_sample_rate_that_the_stamps_deny_puts_the_estimates_in_doubt(
    identnl, document, divided, tmp_path
):
    divided([0], 0)
    bag = open_bag(tmp_path / 'whole.mcap')
    with BagWriter(tmp_path / 'stamped.mcap') as writer:
        writer.write_description(bag.description)
        for block in bag.blocks():
            writer.write_block(replace(block, stamp_ns=round(1.001 * block.stamp_ns)))
    estimate = document('identify', tmp_path / 'stamped.mcap')
    assert {one['status'] for one in estimate['parameters']} == {'model_in_doubt'}
    assert any('come at 4995 Hz' in one for one in estimate['problems'])
    assert any('stamps deny the sample rate' in one for one in estimate['notes'])
    assert identnl('check', tmp_path / 'stamped.mcap').exit_code == 1


def test_columns_are_found_across_files_or_that_is_told(identnl, run, tmp_path):
    probes, others, layout = run
    text = LAYOUT.replace('force: {', 'force: {column: probes/force, ')
    layout.write_text(text.replace('acceleration: {', 'acceleration: {column: time, ', 1))
    said = refused(identnl, tmp_path, probes, others, '--layout', layout, *STARTS)
    assert "both have a column 'time'; write" in said
    layout.write_text(LAYOUT.replace('probe: {', 'probe: {column: laser, '))
    said = refused(identnl, tmp_path, probes, others, '--layout', layout, *STARTS)
    assert "has a column 'laser'" in said
    layout.write_text('\n'.join(LAYOUT.splitlines()[:-1]))
    said = refused(identnl, tmp_path, probes, others, '--layout', layout, *STARTS)
    assert 'others.csv: no sensor of the layout has a column in it' in said


@pytest.mark.parametrize(
    ('start', 'text'),
    [('probes', 'expected FILE=TIME'), ('probes=noon', 'expected FILE=TIME'),
     ('probe=2026-03-01T12:00:00', 'none of the files')],
)  # fmt: skip
def test_wrong_starts_are_told(identnl, run, tmp_path, start, text):
    probes, others, layout = run
    assert text in refused(identnl, tmp_path, probes, others, '--layout', layout, '--start', start)


def test_times_since_1970_and_a_slower_file(document, run, tmp_path):
    _, _, layout = run
    epoch = 1_772_000_000.0
    time = np.arange(6000) / 2000.0
    slow = np.arange(3000) / 1000.0 + 0.25
    fast = np.column_stack((epoch + time, np.sin(20 * time), displacement(time)))
    np.savetxt(
        tmp_path / 'fast.csv', fast, '%.6f,%.9g,%.9g', header='time,force,probe', comments=''
    )
    other = np.column_stack((epoch + slow, np.sin(40 * slow)))
    np.savetxt(tmp_path / 'slow.csv', other, '%.6f,%.9g', header='time,acceleration', comments='')
    bag = tmp_path / 'run.mcap'
    files = (tmp_path / 'fast.csv', tmp_path / 'slow.csv')
    found = document('import', *files, '--layout', layout, '--out', bag)
    rates = [one['sample_rate'] for one in found['sources']]
    assert rates == pytest.approx([2000.0, 1000.0], rel=1e-6)  # as far as the digits go
    assert any('nothing above 500 Hz' in text for text in found['warnings'])
    samples = np.concatenate([block.samples for block in open_bag(bag).blocks()])
    begin = int(np.flatnonzero(np.abs(samples[0, 0] - np.sin(20 * time)) < 1e-8)[0])
    expected = np.sin(40 * (begin + np.arange(len(samples))) / 2000.0)
    valid = np.isfinite(samples[:, 2])
    assert valid.mean() > 0.9
    np.testing.assert_allclose(samples[valid, 2], expected[valid], atol=2e-5)


def test_tdms_tells_when_its_waveforms_began(document, run, tmp_path):
    probes, _, layout = run
    path = tmp_path / 'others.tdms'
    time = np.arange(6000) / 2000.0
    begin = np.datetime64('2026-03-01T12:00:00.500', 'us')
    waveform = {'wf_start_time': begin, 'wf_increment': 1 / 2000.0}
    with TdmsWriter(path) as writer:
        values = np.sin(40 * (time + 0.5))
        writer.write_segment([ChannelObject('run', 'acceleration', values, waveform)])
    bag = tmp_path / 'run.mcap'
    start = ('--start', 'probes=2026-03-01T12:00:00')
    found = document('import', probes, path, '--layout', layout, *start, '--out', bag)
    assert found['sources'][1]['offset'] == 0.0
    samples = np.concatenate([block.samples for block in open_bag(bag).blocks()])
    table = np.loadtxt(probes, delimiter=',', skiprows=1)
    first = int(np.flatnonzero(table[:, 2] == samples[0, 1])[0])
    valid = np.flatnonzero(np.isfinite(samples[:, 2]))
    assert len(valid) > 5500
    expected = np.sin(40 * (first + valid) / 2000.0)
    np.testing.assert_allclose(samples[valid, 2], expected, atol=1e-5)
