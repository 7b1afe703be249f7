# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl check` tells sound files from unsound ones."""

import json

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
