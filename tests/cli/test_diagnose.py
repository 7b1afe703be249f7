# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`simulate --hide` hides, `diagnose` finds, and what it writes is a machine like any other."""

import json
from pathlib import Path

from identnl_ros.storage.bag_reader import open_bag
import pytest


@pytest.fixture(scope='module')
def bag(tmp_path_factory, config):
    from click.testing import CliRunner
    from identnl_ros.cli.commands import cli

    path = tmp_path_factory.mktemp('diagnose') / 'run.mcap'
    layout = path.with_name('layout.yaml')
    text = (config / 'oscillator_layout.yaml').read_text('utf-8').rstrip()
    layout.write_text(f'{text}\n    noise: 0.1 mV\n', 'utf-8')
    made = CliRunner().invoke(cli, [
        'simulate', '--machine', str(config / 'oscillator.yaml'), '--layout', str(layout),
        '--duration', '4',
        '--hide', 'coulomb_friction:spring.axis_1:5%', '--out', str(path),
    ])  # fmt: skip
    assert made.exit_code == 0, made.output
    return path


def test_hidden_effect_is_found_and_added(bag, document, tmp_path):
    truth = json.loads(bag.with_name('run.mcap.truth.json').read_text('utf-8'))['hidden'][0]
    found = document('diagnose', bag, '--out', tmp_path / 'report')
    assert found['verdict'] == 'explained'
    (finding,) = found['findings']
    assert (finding['effect'], finding['location']) == (truth['effect'], truth['location'])
    force = finding['parameters'][0]
    assert force['unit'] == truth['unit'] == 'N'
    assert force['value'] == pytest.approx(truth['size'], rel=0.02)
    transition = finding['parameters'][1]
    assert (transition['name'], transition['unit']) == ('transition_velocity', 'm/s')
    error = transition['value'] - truth['inner']['transition_velocity']
    assert (
        abs(error) < 4 * transition['standard_deviation'] < truth['inner']['transition_velocity']
    )
    held_out = found['held_out']
    assert held_out['after']['response_nrmse'] < 0.1 * held_out['before']['response_nrmse']
    before, after, floor = (
        held_out[which]['relative_force_error'] for which in ('before', 'after', 'noise_floor')
    )
    assert before > 1.1 * after
    assert after == pytest.approx(floor, rel=0.3)
    report = (tmp_path / 'report/report.md').read_text('utf-8')
    assert 'Coulomb friction' in report
    assert len(found['plots']) == 4
    for path in map(Path, found['plots']):
        assert path.parent == tmp_path / 'report'
        assert path.read_bytes().startswith(b'\x89PNG')
        assert f'({path.name})' in report
    assert json.loads((tmp_path / 'report/diagnosis.json').read_text('utf-8')) == found
    again = document('diagnose', bag, '--machine', tmp_path / 'report/machine.yaml')
    assert again['verdict'] == 'complete'
    assert again['findings'] == again['plots'] == []


def test_people_get_a_paragraph_and_tables(bag, identnl):
    result = identnl('diagnose', bag)
    assert result.exit_code == 0
    assert 'Coulomb friction of' in result.stdout
    for title in ('What is missing', 'Error on held-out data', 'Smallest sizes that this record'):
        assert title in result.stdout


def test_bag_does_not_tell_what_is_hidden(bag):
    stream = open_bag(bag).streams[0]
    assert 'friction' not in stream.machine_text + stream.layout_text
    assert b'friction' not in bag.read_bytes()


def test_effect_that_does_not_exist_is_said(identnl, config, tmp_path):
    common = ('simulate', '--machine', config / 'oscillator.yaml', '--out', tmp_path / 'x.mcap')
    for text, said in (
        ('magic', 'no effect is called "magic"; expected one of'),
        ('coulomb_friction:nowhere', 'cannot be at "nowhere"; expected one of spring.axis_1'),
        ('coulomb_friction:spring.axis_1:many', 'many'),
    ):
        result = identnl(*common, '--hide', text)
        assert result.exit_code == 2
        assert said in result.stderr
        assert not (tmp_path / 'x.mcap').exists()


def test_record_that_is_too_short_is_said(identnl, config, tmp_path):
    path = tmp_path / 'short.mcap'
    identnl(
        'simulate', '--machine', config / 'oscillator.yaml', '--duration', '0.5', '--out', path
    )
    result = identnl('diagnose', path)
    assert result.exit_code == 2
    assert 'too few for a diagnosis' in result.stderr


@pytest.mark.parametrize('name', ['random_force', 'impacts', 'rising_tone'])
def test_force_outside_the_library_is_hidden_and_left_unexplained(name, config, tmp_path):
    from click.testing import CliRunner
    from identnl_ros.cli.commands import cli

    path = tmp_path / 'run.mcap'
    layout = path.with_name('layout.yaml')
    text = (config / 'oscillator_layout.yaml').read_text('utf-8').rstrip()
    layout.write_text(f'{text}\n    noise: 0.1 mV\n', 'utf-8')
    made = CliRunner().invoke(cli, [
        'simulate', '--machine', str(config / 'oscillator.yaml'), '--layout', str(layout),
        '--duration', '4', '--hide', f'{name}::20%', '--out', str(path),
    ])  # fmt: skip
    assert made.exit_code == 0, made.output
    told = json.loads(path.with_name('run.mcap.truth.json').read_text('utf-8'))['hidden'][0]
    assert told['effect'] == name
    assert not told['in_library']
    found = CliRunner().invoke(cli, ['diagnose', str(path), '--json'])
    assert found.exit_code == 1, found.output
    said = json.loads(found.stdout)
    assert said['verdict'] == 'unexplained'
    assert said['findings'] == []
