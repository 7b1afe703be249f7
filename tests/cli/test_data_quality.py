# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Faults of channels are told by `check`, and `identify` does not trust or use them."""

from dataclasses import replace
import json

from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.observation import observe_motion
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.sources.offline import identify_bags
from identnl_ros.storage.machine_file import read_machine
import numpy as np
import pytest

from tests.faulty_bags import inverted, RATE, recorded, stuck, write_faulty


@pytest.fixture(scope='module')
def inverted_bag(tmp_path_factory):
    return write_faulty(tmp_path_factory.mktemp('inverted') / 'inverted.mcap', inverted)


def test_late_accelerometer_is_told_with_what_it_costs(identnl, tmp_path):
    def late(samples, columns):
        column = columns['knee_a1x']
        samples[1:, column] = samples[:-1, column].copy()  # 200 us

    bag = write_faulty(tmp_path / 'late.mcap', late)
    found = json.loads(identnl('check', bag, '--delays', '--json').stdout)['files'][0]
    (sentence,) = [one for one in found['problems'] if one.startswith('knee_a1x: is late')]
    assert 'damping of the mode' in sentence
    others = [one for name, one in found['streams'][0]['delays'].items() if name != 'knee_a1x']
    assert len(others) > 40
    assert not [one for one in found['problems'] if 'is early' in one and 'column' in one]


def test_inverted_probe_is_named_by_check(identnl, inverted_bag):
    result = identnl('check', inverted_bag, '--json')
    assert result.exit_code == 1
    (found,) = json.loads(result.stdout)['files']
    (sentence,) = found['problems']
    assert sentence.startswith('knee_s1x: reads -1.00')
    (fault,) = found['streams'][0]['faults']
    assert (fault['channel'], fault['condition']) == ('knee_s1x', 'inverted')
    assert fault['amount'] == pytest.approx(-1.0, abs=0.05)


def test_check_tells_how_wrong_a_gain_would_have_to_be_to_be_found(identnl, inverted_bag):
    (found,) = json.loads(identnl('check', inverted_bag, '--json').stdout)['files']
    (stream,) = found['streams']
    limits = stream['gain_limits']
    description, *_ = recorded()
    # All but the force cell are checked.
    kinds = {one.name: one.kind for one in description.layout.sensors}
    assert set(limits) == {name for name, kind in kinds.items() if kind is not SensorKind.FORCE}
    # The tolerance is 3 %: nothing below it is a fault.
    sizes = [one['found'] for one in limits.values() if one['found'] is not None]
    assert len(sizes) > 0.9 * len(limits)
    assert 0.03 < min(sizes) < 0.05
    assert all(one['named'] is None or one['named'] >= one['found'] for one in limits.values())
    worst = max((one['found'] or 0, name) for name, one in limits.items())[1]
    assert worst in stream['wrong_gains']


def test_inverted_probe_is_left_out_where_the_others_see_everything(document, inverted_bag):
    found = document('identify', inverted_bag)
    (sentence,) = [one for one in found['problems'] if 'knee_s1x: reads -1.00' in one]
    assert sentence.endswith('(left out)')
    assert within_intervals(found) >= 13  # of 16, at 95 %: less has a probability of 1 in 130


def test_estimates_are_in_doubt_where_a_wrong_sensor_is_needed(identnl, tmp_path):
    needed = without_redundant_probes()
    bag = write_faulty(tmp_path / 'inverted.mcap', inverted, needed.__contains__)
    result = identnl('identify', bag, '--estimator', 'pointwise', '--json')
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert not found['trusted']
    assert any(note.startswith('knee_s1x: reads -1.') for note in found['notes'])
    assert not any(one['status'] == 'ok' for one in found['parameters'])
    assert result.stderr.count('knee_s1x: reads -1.') == 1
    assert 'the search may take long' in result.stderr


@pytest.mark.parametrize('estimator', ['pointwise', 'likelihood'])
def test_wrong_sensor_is_told_before_the_search(inverted_bag, estimator):
    class StopError(Exception):
        pass

    events = []

    def doing(what):
        events.append(what.partition(' ')[0])
        if events[-1] == 'fitting':
            raise StopError

    with pytest.raises(StopError):
        identify_bags([inverted_bag], estimator=estimator, tell=events.append, doing=doing)
    reading, sentence, fitting = events
    assert (reading, fitting) == ('reading', 'fitting')
    assert sentence.startswith('knee_s1x: reads -1.00')
    assert sentence.endswith('(left out)')


def without_redundant_probes() -> set[str]:
    """Name sensors among which no probe may fail; the others tell which one is wrong."""
    description, _, text = recorded()
    model = assemble(read_machine(text, 'test'))
    layout = description.layout
    for sensor in layout.sensors:
        if sensor.kind is SensorKind.DISPLACEMENT and sensor.name != 'knee_s1x':
            less = replace(
                layout, sensors=tuple(one for one in layout.sensors if one is not sensor)
            )
            if not observe_motion(model, less, SensorKind.DISPLACEMENT).unseen:
                layout = less
    return {sensor.name for sensor in layout.sensors}


def test_stuck_accelerometer_is_left_out_with_its_cause(document, tmp_path):
    bag = write_faulty(tmp_path / 'stuck.mcap', stuck)
    found = document('identify', bag)
    assert list(found['left_out']) == ['column_a2y']
    assert found['left_out']['column_a2y']['stuck'] == pytest.approx(3000, abs=3)
    assert any('column_a2y' in one and 'times as large' in one for one in found['problems'])
    assert within_intervals(found) >= 13
    assert found['rejected_samples'] < 0.02 * found['samples']


def test_same_loss_of_several_channels_is_counted_once_and_told_in_one_sentence(
    document, tmp_path
):
    names = ['knee_a2y', 'knee_a4x', 'knee_a4y']

    def silent(samples, columns):
        samples[2000:3000, [columns[name] for name in names]] = np.nan

    found = document('identify', write_faulty(tmp_path / 'silent.mcap', silent))
    (sentence,) = [one for one in found['problems'] if 'samples left out' in one]
    ready = round(0.1 * RATE) - 1  # valid again, but not trusted yet
    assert sentence == (
        f'{", ".join(names)}: {1000 + ready} samples left out (1000 missing, {ready} lost)'
    )
    assert found['left_out'] == {name: {'missing': 1000, 'lost': ready} for name in names}


def within_intervals(found) -> int:
    """Count the 95 % intervals that hold the truth."""
    model = assemble(read_machine(recorded()[2], 'test'))
    truth = {model.parameters[i].name: model.parameters[i].value for i in model.estimated}
    return sum(
        one['interval'][0] <= truth[one['name']] <= one['interval'][1]
        for one in found['parameters']
        if one['value'] is not None
    )
