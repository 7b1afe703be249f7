# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What users get wrong: a sentence, exit code 2, and nothing half-written."""

import json
from pathlib import Path
import subprocess
import sys

import pytest

from tests.oscillator_bags import write_oscillator

SINE = ('simulate', '--machine', 'config/knee_column.yaml', '--duration', '0.05')


@pytest.fixture(autouse=True)
def in_checkout(monkeypatch, config):
    monkeypatch.chdir(config.parent)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (('identify', 'nowhere.mcap'), ('nowhere.mcap', 'does not exist')),
        (('identify', 'README.md'), ('README.md', 'bag')),
        (('identify', 'config'), ('config', 'metadata.yaml')),
        (
            ('identify', 'bags/knee_column_sine.mcap', '--machine', 'config/three_body.yaml'),
            ('does not fit machine three_body', 'knee_s1x', 'bed, column, table'),
        ),
        (
            ('identify', 'bags/knee_column_sine.mcap', '--machine', 'config/oscillator.yaml'),
            ('does not fit machine oscillator',),
        ),
        (
            ('identify', 'bags/knee_column_sine.mcap', '--machine', 'no.yaml'),
            ('no.yaml',),
        ),
        (
            ('identify', 'bags/knee_column_sine.mcap', '--estimator', 'magic'),
            ('magic', 'pointwise'),
        ),
        ((*SINE, '--out', 'OUT', '--noise', 'loud'), ('loud', 'nominal')),
        ((*SINE, '--out', 'OUT', '--noise', '-1'), ('noise is -1',)),
        ((*SINE, '--out', 'OUT', '--rate', '0'), ('sample_rate is 0',)),
        ((*SINE, '--out', 'OUT', '--rate', '5 kg'), ('5 kg', '40 Hz')),
        ((*SINE, '--out', 'OUT', '--band', '400', '300'), ('band is 400',)),
        ((*SINE, '--out', 'OUT', '--band', '5.1', '5.2'), ('no multiple of 1 Hz',)),
        ((*SINE, '--out', 'OUT', '--excitation', 'recorded'), ('--force',)),
        (
            (*SINE, '--out', 'OUT', '--layout', 'config/oscillator_layout.yaml'),
            ('mass', 'no body'),
        ),
        ((*SINE, '--out', 'README.md'), ('README.md', 'exists')),
        ((*SINE, '--out', 'no/such/folder/x.mcap'), ('no/such/folder',)),
        (('simulate', '--machine', 'config/nodes', '--out', 'OUT'), ('config/nodes',)),
        (('import', 'README.md', '--layout', 'config/knee_column_layout.yaml', '--out', 'OUT'),
         ('README.md',)),
        (('import', 'no.csv', '--layout', 'config/oscillator_layout.yaml', '--out', 'OUT'),
         ('no.csv',)),
        (('replay', 'nowhere.mcap'), ('nowhere.mcap',)),
        (('replay', 'bags/knee_column_sine.mcap', '--speed', '0'), ('positive factor or max',)),
        (('check',), ('PATHS',)),
        (('frobnicate',), ('frobnicate',)),
    ],
)  # fmt: skip
def test_wrong_use_gets_a_sentence_and_exit_code_2(identnl, tmp_path, arguments, words):
    arguments = [str(tmp_path / 'out.mcap') if one == 'OUT' else one for one in arguments]
    result = identnl(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ''
    for word in words:
        assert word in result.stderr
    assert 'Traceback' not in result.stderr
    assert not list(tmp_path.iterdir()), 'nothing half-written'


def test_errors_are_one_json_document_too(identnl):
    result = identnl('identify', 'nowhere.mcap', '--json')
    assert result.exit_code == 2
    assert 'nowhere.mcap' in json.loads(result.stdout)['error']
    assert 'nowhere.mcap' in result.stderr


def test_missing_number_names_the_parameter(identnl, tmp_path, config):
    machine = tmp_path / 'machine.yaml'
    text = (config / 'knee_column.yaml').read_text('utf-8')
    machine.write_text(text.replace('{estimate: 380 daN/um^2}', 'estimate'), 'utf-8')
    result = identnl('simulate', '--machine', machine, '--out', tmp_path / 'x.mcap')
    assert result.exit_code == 2
    assert 'slideway_6.normal_stiffness' in result.stderr
    assert 'no value to simulate with' in result.stderr


def test_layout_that_cannot_see_a_motion_names_it(identnl, tmp_path, config):
    layout = tmp_path / 'layout.yaml'
    lines = (config / 'knee_column_layout.yaml').read_text('utf-8').splitlines()
    # Probes on the knee along x and z only, and none across the joint: nothing sees it move in y.
    kept = [
        line
        for line in lines
        if not (
            'kind: displacement' in line
            and ('relative_to' in line or ('body: knee' in line and '+y' in line))
        )
    ]
    layout.write_text('\n'.join(kept), 'utf-8')
    bag = tmp_path / 'x.mcap'
    made = identnl(
        'simulate', '--machine', config / 'knee_column.yaml', '--layout', layout,
        '--duration', '0.05', '--out', bag,
    )  # fmt: skip
    assert made.exit_code == 0
    result = identnl('identify', bag)
    assert result.exit_code == 2
    assert 'cannot see translation 2 of knee' in result.stderr


def test_what_the_data_do_not_determine_has_no_number(document, bags, tmp_path, config):
    # A joint twice: only the sum of the two is in the data.
    text = (config / 'knee_column.yaml').read_text('utf-8')
    start = text.index('  slideway_6:')
    twin = text[start : text.index('  slideway_7:')].replace('slideway_6', 'twin')
    machine = tmp_path / 'machine.yaml'
    machine.write_text(text.replace('  slideway_6:', twin + '  slideway_6:'), 'utf-8')
    found = document('identify', bags / 'knee_column_sine.mcap', '--machine', machine)
    states = {parameter['name']: parameter for parameter in found['parameters']}
    for name in ('normal_stiffness', 'tangential_hysteretic_damping'):
        for joint in ('twin', 'slideway_6'):
            assert states[f'{joint}.{name}']['status'] == 'not_identifiable'
            assert states[f'{joint}.{name}']['value'] is None
        words = [one['combination'] for one in found['combinations']]
        assert f'twin.{name} + slideway_6.{name}' in words
    assert states['slideway_7.normal_stiffness']['value'] == pytest.approx(3.7e15, rel=1e-8)


def test_record_of_nothing_determines_nothing(identnl, tmp_path, config):
    bag = tmp_path / 'short.mcap'
    assert (
        identnl(
            'simulate', '--machine', config / 'knee_column.yaml', '--duration', '0.0001',
            '--rate', '10000', '--out', bag,
        ).exit_code
        == 0
    )  # fmt: skip
    result = identnl('identify', bag, '--json')
    assert result.exit_code == 1
    statuses = {one['status'] for one in json.loads(result.stdout)['parameters']}
    assert statuses == {'unknown'}


@pytest.mark.parametrize(
    'command',
    [
        ('identify',),
        ('identify', '--estimator', 'pointwise'),
        ('identify', '--estimator', 'likelihood'),
        ('diagnose',),
        ('check', '--delays'),
    ],
    ids=' '.join,
)
def test_readings_that_no_sensor_gives_are_none(identnl, tmp_path, command):
    def overflowing(samples, columns):
        samples[:] *= 1e300

    bag = write_oscillator(tmp_path / 'huge.mcap', overflowing, duration=0.3)
    result = identnl(*command, bag, '--json')
    assert result.exit_code in (1, 2)
    assert json.loads(result.stdout)


@pytest.mark.parametrize(
    'arguments',
    [('check', '{bag}', '--json'), ('check', '{bag}'), ('nonsense', '--json'), ('-h',)],
)
def test_full_standard_output_gets_a_sentence_and_exit_code_2(bags, arguments):
    bag = str(bags / 'knee_column_sine.mcap')
    with Path('/dev/full').open('w', encoding='utf-8') as full:
        result = subprocess.run(
            [
                sys.executable, '-m', 'identnl_ros.cli.main',
                *(one.format(bag=bag) for one in arguments),
            ],
            stdout=full, stderr=subprocess.PIPE, text=True, timeout=120,
        )  # fmt: skip
    assert result.returncode == 2
    assert 'Traceback' not in result.stderr
    assert 'No space left on device; make room' in result.stderr or 'nonsense' in result.stderr
