# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What `identify` says of how far its result may be trusted, and its exit code."""

from dataclasses import replace
import json

from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.bag_writer import BagWriter
import pytest

from tests.oscillator_bags import FREE, gains, write_oscillator

FIVE = ('d1', 'a1', 'd2', 'a2', 'a3')


def test_sensor_left_out_on_a_vote_is_told_with_those_that_were_believed(document, tmp_path):
    bag = write_oscillator(tmp_path / 'run.mcap', gains(d1=1.15), probes=FIVE)
    found = document('identify', bag, '--estimator', 'pointwise')
    (note,) = [one for one in found['notes'] if 'left out' in one]
    assert note.startswith('d1 was left out because a1, d2, a2, a3 agree against it')
    assert note.endswith('if they are wrong alike, so is this estimate.')
    assert {one['status'] for one in found['parameters']} <= {'ok', 'noise_limited'}


def test_of_two_sensors_that_contradict_each_other_none_is_believed(identnl, tmp_path):
    bag = write_oscillator(tmp_path / 'run.mcap', gains(a1=1.15))
    result = identnl('identify', bag, '--estimator', 'pointwise', '--json')
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert {one['status'] for one in found['parameters']} == {'model_in_doubt'}
    assert {one.split()[0] for one in found['notes'] if 'the gain is wrong' in one} == {'d1', 'a1'}


@pytest.mark.parametrize('estimator', ['weak', 'pointwise', 'likelihood'])
def test_only_the_force_tells_the_scale_where_all_is_unknown(document, tmp_path, estimator):
    bag = write_oscillator(tmp_path / 'free.mcap', machine=FREE, duration=0.5)
    notes = document('identify', bag, '--estimator', estimator)['notes']
    assert sum('scale with the force' in note for note in notes) == 1


def test_estimates_of_a_machine_without_a_known_number_follow_the_force(document, tmp_path):
    values = []
    for gain in (1.0, 1.03):
        bag = write_oscillator(tmp_path / f'{gain}.mcap', gains(force=gain), FREE, duration=0.5)
        found = document('identify', bag, '--estimator', 'pointwise')
        values.append([one['value'] for one in found['parameters']])
    assert [b / a for a, b in zip(*values, strict=True)] == pytest.approx([1.03] * 3, rel=1e-9)


def test_known_mass_tells_the_scale(document, tmp_path):
    bag = write_oscillator(tmp_path / 'run.mcap', duration=0.5)
    notes = document('identify', bag, '--estimator', 'pointwise')['notes']
    assert not any('scale with the force' in note for note in notes)


def test_values_without_standard_deviations_are_a_negative_verdict(identnl, tmp_path):
    def far_away(samples, columns):
        samples[:, columns['d1']] *= 1000

    bag = write_oscillator(tmp_path / 'run.mcap', far_away, duration=0.3)
    result = identnl('identify', bag, '--json')
    found = json.loads(result.stdout)
    assert any(one['value'] is not None for one in found['parameters'])
    assert all(one['standard_deviation'] is None for one in found['parameters'])
    assert {one['status'] for one in found['parameters']} == {'noise_limited'}
    assert result.exit_code == 1


def test_why_nothing_is_known_after_many_samples_is_told(identnl, tmp_path):
    def gaps(samples, columns):
        for first in range(0, len(samples), 100):
            samples[first : first + 3, columns['force']] = float('nan')

    bag = write_oscillator(tmp_path / 'run.mcap', gaps, duration=1.0)
    result = identnl('identify', bag, '--json')
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert {one['status'] for one in found['parameters']} == {'unknown'}
    (note,) = [one for one in found['notes'] if one.startswith('Nothing is known')]
    assert 'the longest piece without a gap has 97 of them (0.0194 s at 5000 Hz)' in note


def test_sample_rate_a_thousand_times_too_low_is_told_where_nothing_is_known(identnl, tmp_path):
    # As by a column of milliseconds that is headed [s].
    bag = write_oscillator(tmp_path / 'run.mcap', duration=1.0, rate=5.0)
    result = identnl('identify', bag, '--json')
    assert result.exit_code == 1
    notes = json.loads(result.stdout)['notes']
    assert any('at 5 Hz' in note and 'whether the sample rate is right' in note for note in notes)


def test_blocks_after_the_last_one_are_told_as_that(identnl, tmp_path):
    whole = open_bag(write_oscillator(tmp_path / 'whole.mcap', duration=0.5))
    blocks = list(whole.blocks())
    middle = len(blocks) // 2
    with BagWriter(tmp_path / 'run.mcap') as bag:
        bag.write_description(whole.description)
        for number, block in enumerate(blocks):
            bag.write_block(replace(block, last=number == middle))
    words = f'{len(blocks) - middle - 1} blocks come after one that says it is the last'
    result = identnl('identify', tmp_path / 'run.mcap', '--estimator', 'pointwise', '--json')
    (problem,) = json.loads(result.stdout)['problems']
    assert problem.startswith(words)
    result = identnl('check', tmp_path / 'run.mcap', '--json')
    assert result.exit_code == 1
    assert words in result.stdout
