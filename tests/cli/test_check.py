# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl check` tells sound files from unsound ones."""

import json

import numpy as np
import pytest


def test_shipped_files_are_sound(document, config, bags):
    for name in ('knee_column', 'three_body', 'oscillator'):
        found = document(
            'check', config / f'{name}.yaml', config / f'{name}_layout.yaml',
            '--machine', config / f'{name}.yaml',
        )  # fmt: skip
        assert found['sound'], found
        assert [one['kind'] for one in found['files']] == ['machine', 'layout']
    assert document('check', *sorted(bags.glob('*.mcap')))['sound']


def test_natural_frequency_of_the_oscillator_is_told(document, config):
    (found,) = document('check', config / 'oscillator.yaml')['files']
    assert found['natural_frequencies'] == [pytest.approx((0.966 / 5.2e-6) ** 0.5 / 6.283185307)]


def test_cut_bag_is_not_sound_but_read_as_far_as_it_goes(identnl, bags, tmp_path):
    cut = tmp_path / 'cut.mcap'
    whole = (bags / 'knee_column_sine.mcap').read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    result = identnl('check', cut, '--json')
    assert result.exit_code == 1
    (found,) = json.loads(result.stdout)['files']
    assert found['problems']
    assert 500 < found['streams'][0]['samples'] < 1500
    identified = json.loads(identnl('identify', cut, '--json').stdout)
    assert identified['problems']
    for parameter in identified['parameters']:
        assert parameter['value'] == pytest.approx(
            {'slideway_6.normal_stiffness': 3.8e15}.get(parameter['name'], parameter['value']),
            rel=1e-6,
        )


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ('', 'found nothing'),
        ('machine: x\nbodies: []\njoints: {}\n', 'bodies'),
        ('machine: x\nbodis: {}\n', 'bodies'),
        ('\t- x', 'tab'),
    ],
)
def test_unsound_machine_is_told_in_words(identnl, tmp_path, content, words):
    path = tmp_path / 'bad.yaml'
    path.write_text(content, 'utf-8')
    result = identnl('check', path)
    assert result.exit_code == 1
    assert 'NOT sound' in result.stdout
    assert words in result.stdout


@pytest.mark.parametrize(('holes', 'sound'), [(1, True), (99, True), (100, False)])
def test_bag_with_few_missing_readings_is_sound_with_a_remark(
    identnl, config, tmp_path, holes, sound
):
    rows = ['1,2'] * (10_000 - holes) + ['1,'] * holes
    (tmp_path / 'a.csv').write_text('V1,V2\n' + '\n'.join(rows), 'utf-8')
    bag, layout = tmp_path / 'a.mcap', config / 'oscillator_layout.yaml'
    identnl('import', tmp_path / 'a.csv', '--layout', layout, '--out', bag)
    result = identnl('check', bag, '--json')
    (found,) = json.loads(result.stdout)['files']
    assert found['sound'] is sound
    assert result.exit_code == (0 if sound else 1)
    sentence, *_ = found['remarks' if sound else 'problems']
    assert sentence.startswith(f'output: {holes} sample')
    assert 'without a valid number' in sentence
    assert found['streams'][0]['left_out']['output']['missing'] == holes
    assert ('remark: ' if sound else 'problem: ') + sentence in identnl('check', bag).stdout


def test_what_all_channels_have_in_common_is_told_once(identnl, config, tmp_path):
    readings = np.random.default_rng(1).standard_normal((4000, 2))
    rows = [f'{one},{other}' for one, other in readings]
    rows[1000:1500] = [','] * 500
    (tmp_path / 'a.csv').write_text('V1,V2\n' + '\n'.join(rows), 'utf-8')
    bag, layout = tmp_path / 'a.mcap', config / 'oscillator_layout.yaml'
    identnl('import', tmp_path / 'a.csv', '--layout', layout, '--out', bag)
    result = identnl('check', bag)
    (told,) = [line for line in result.stdout.splitlines() if 'without a valid' in line]
    assert told.startswith('  problem: all channels: 500 samples without a valid number ')
    assert 'no valid sample for long' not in result.stdout
    (left_out,) = [line for line in result.stdout.splitlines() if 'left out' in line]
    # 0.1 s, but for the last one, until the channels are trusted again.
    assert left_out == '    left out: all channels: missing 500, lost 60'
    assert max(map(len, result.stdout.splitlines())) < 200
    assert '    samples: 4000' in result.stdout.splitlines()


def test_gap_of_a_bag_is_told_with_its_share(identnl, config, tmp_path):
    kept = [*range(2000), *range(2010, 4000)]
    layout = tmp_path / 'layout.yaml'
    text = (config / 'oscillator_layout.yaml').read_text('utf-8')
    layout.write_text(text.replace('sample_rate: 610.3515625 Hz', 'sample_rate: 1 kHz'), 'utf-8')
    rows = [f'{i / 1000},1,2' for i in kept]
    (tmp_path / 'a.csv').write_text('t,V1,V2\n' + '\n'.join(rows), 'utf-8')
    made = identnl('import', tmp_path / 'a.csv', '--layout', layout, '--out', tmp_path / 'b')
    assert '10 samples are missing' in made.stderr
    (found,) = json.loads(identnl('check', tmp_path / 'b', '--json').stdout)['files']
    assert found['sound']
    assert found['remarks'] == ['10 of 4000 samples are missing between the blocks']


def test_sensors_that_share_a_column_are_told(identnl, config, tmp_path):
    layout = tmp_path / 'layout.yaml'
    text = (config / 'oscillator_layout.yaml').read_text('utf-8')
    layout.write_text(text.replace('column: V2', 'column: V1'), 'utf-8')
    result = identnl('check', layout)
    assert result.exit_code == 1
    assert "read the same column 'V1'" in result.stdout


def test_numbers_for_people_have_units(identnl, config):
    result = identnl(
        'check', config / 'oscillator.yaml', config / 'oscillator_layout.yaml',
        '--machine', config / 'oscillator.yaml',
    )  # fmt: skip
    for words in (
        'rest [m, rad]: ', 'natural frequencies [Hz]: ',
        'displacement standard deviation [m, rad]: ',
    ):  # fmt: skip
        assert words in result.stdout


def test_layout_is_checked_against_the_machine_on_the_same_command_line(identnl, config, tmp_path):
    machine, layout = config / 'knee_column.yaml', tmp_path / 'a.yaml'
    text = (config / 'knee_column_layout.yaml').read_text('utf-8')
    layout.write_text(text.replace('body: knee', 'body: kne', 1), 'utf-8')
    for paths in ((machine, layout), (layout, machine)):
        result = identnl('check', *paths)
        assert result.exit_code == 1
        assert '"kne" is no body of machine knee_and_column' in result.stdout
    alone = identnl('check', layout)
    assert alone.exit_code == 0
    assert 'not compared with a machine' in alone.stdout


def test_of_several_machines_a_layout_is_checked_against_that_of_its_name(document, config):
    found = document(
        'check', config / 'knee_column.yaml', config / 'oscillator.yaml',
        config / 'oscillator_layout.yaml',
    )  # fmt: skip
    assert found['sound']
    assert found['files'][-1]['machine'] == 'oscillator'


@pytest.mark.parametrize(('mass', 'told'), [('27', True), ('25', False), ('85 g', False)])
def test_front_mass_that_is_much_of_its_body_is_remarked(document, config, tmp_path, mass, told):
    layout = tmp_path / 'a.yaml'
    text = (config / 'knee_column_layout.yaml').read_text('utf-8')
    layout.write_text(text.replace('kind: force', f'kind: force, front_mass: {mass}'), 'utf-8')
    found = document('check', config / 'knee_column.yaml', layout)
    assert found['sound']
    remarks = found['files'][-1]['remarks']
    assert [('front_mass of 27 kg' in one and '"85 g"' in one) for one in remarks] == [True] * told


def test_every_problem_of_a_layout_is_one_of_its_own(document, config, tmp_path):
    layout = tmp_path / 'a.yaml'
    text = (config / 'knee_column_layout.yaml').read_text('utf-8')
    assert text.count('direction: +z') > 3
    layout.write_text(text.replace('direction: +z', 'direction: up', 3), 'utf-8')
    (found,) = document('check', layout)['files']
    assert len(found['problems']) == 3
    assert all('found "up", expected a direction' in one for one in found['problems'])
