# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl design`: verdicts, plans, sensors and advice, for people and programs."""

import json

import pytest

TWIN = """
  twin:
    kind: six_spring
    body: mass
    to: ground
    point: [0, 0, 0]
    stiffness: [{estimate: 0.1 N/m}]

forces:"""


@pytest.fixture
def oscillator(config, tmp_path):
    """Write the shipped oscillator, changed, with a layout that states its noise."""

    def write(*changes):
        machine = (config / 'oscillator.yaml').read_text('utf-8')
        for old, new in (('{estimate: 5.2e-6 kg}', '5.2e-6 kg'), *changes):
            assert old in machine
            machine = machine.replace(old, new)
        layout = (config / 'oscillator_layout.yaml').read_text('utf-8')
        layout = layout.replace('gain: 1 V/m', 'gain: 1 V/m\n    noise: 0.3 mm')
        paths = tmp_path / 'machine.yaml', tmp_path / 'layout.yaml'
        for path, text in zip(paths, (machine, layout), strict=True):
            path.write_text(text, 'utf-8')
        return paths

    return write


@pytest.fixture
def knee_column(config):
    return config / 'knee_column.yaml', config / 'knee_column_layout.yaml'


def test_errors_of_a_planned_run(document, knee_column):
    found = document('design', *knee_column, '--period', '0.2', '--duration', '0.2')
    assert found['plan']['excitation'] == 'multisine'
    assert found['plan']['amplitudes'] == {'exciter': 1000.0}
    assert found['plan']['peak_forces']['exciter'] > 1000
    assert len(found['parameters']) == 16
    for one in found['parameters']:
        assert one['identifiable']
        assert one['relative'] == pytest.approx(one['expected_standard_deviation'] / one['value'])
        assert 1e-6 < one['relative'] < 0.1
    assert found['combinations'] == []
    assert found['condition_number'] < 1e3
    assert found['plans'] == []
    assert 'bottleneck slideway_8 h_t' in found['advice']
    assert len(found['sensors']) == 57
    growths = [one['growth_without'] for one in found['sensors']]
    assert growths == sorted(growths, reverse=True)
    assert sum(one['may_be_left_out'] for one in found['sensors']) > 20


def test_plan_for_a_wanted_error(identnl, oscillator):
    result = identnl('design', *oscillator(), '--error', '2 %', '--json')
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert {one['excitation'] for one in found['plans']} == {'multisine', 'sweep', 'sine'}
    assert len(found['plans']) == 9
    (advised,) = (one for one in found['plans'] if one['advised'])
    assert advised['duration'] == found['plan']['duration']
    assert advised['advisable']
    judged = [one['relative'] for one in found['parameters'] if one['value']]
    assert max(judged) <= 0.02
    # The offset and the quadratic spring are 0 in the file: no relative error.
    assert sum(one['relative'] is None for one in found['parameters']) == 2
    assert 'every parameter under 2 %' in found['advice']


def test_a_wanted_error_out_of_reach_is_a_negative_verdict(identnl, oscillator):
    files = oscillator()
    alone = ('--excitation', 'multisine', '--amplitude', '0.03 N', '--json')
    result = identnl('design', *files, '--error', '1e-6', '--duration', '10 s', *alone)
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert len(found['plans']) == 1
    assert 'within 10 s' in found['advice']


def test_the_largest_amplitude_limits_the_plans(document, oscillator):
    asked = ('--error', '1 %', '--excitation', 'multisine', '--largest-amplitude', '0.05 N')
    found = document('design', *oscillator(), *asked)
    strongest = [one['amplitudes']['input'] for one in found['plans']]
    assert strongest == pytest.approx([0.01, 0.03, 0.05])
    assert all(one['advisable'] for one in found['plans'])


@pytest.mark.parametrize('wanted', [(), ('--error', '5 %', '--excitation', 'sine')])
def test_what_cannot_be_told_apart_is_named(identnl, oscillator, wanted):
    files = oscillator(('\nforces:', TWIN))
    result = identnl('design', *files, *wanted, '--json')
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert 'spring.stiffness + twin.stiffness' in found['combinations'][0]
    assert 'spring.stiffness + twin.stiffness' in found['advice']
    lost = [one for one in found['parameters'] if not one['identifiable']]
    assert {'spring.stiffness', 'twin.stiffness'} <= {one['name'] for one in lost}
    assert all(one['expected_standard_deviation'] is None for one in lost)
    if wanted:
        assert 'cannot be attained' in found['advice']


def test_people_see_tables_in_their_units(identnl, knee_column):
    short = ('--period', '0.1', '--settling', '0.1', '--excitation', 'multisine')
    result = identnl('design', *knee_column, '--error', '5%', *short)
    assert result.exit_code == 0, result.stderr
    for words in ('multisine 5-300 Hz, 100 daN', 'daN/µm²', 'slideway_8 h_t', 'Cramer-Rao',
                  'left out together', 'needs', 'Forces'):  # fmt: skip
        assert words in result.stdout


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (('--error', 'small'), ('1 %',)),
        (('--error', '0'), ('wanted error',)),
        (('--error', '-1 %'), ('wanted error',)),
        (('--largest-amplitude', '100 daN'), ('--error',)),
        (('--duration', '0'), ('duration',)),
        (('--settling', '-1'), ('settling',)),
        (('--band', '5', '400'), ('half the sample rate',)),
    ],
)
def test_wrong_use_gets_a_sentence(identnl, oscillator, arguments, words):
    result = identnl('design', *oscillator(), *arguments)
    assert result.exit_code == 2
    assert result.stdout == ''
    for word in words:
        assert word in result.stderr


def test_a_value_that_is_missing_is_asked_for(identnl, oscillator):
    files = oscillator(('{estimate: 0.966 N/m}', 'estimate'))
    for more in ((), ('--error', '1 %')):
        result = identnl('design', *files, *more)
        assert result.exit_code == 2
        assert 'spring.stiffness: no value to simulate with; give the machine' in result.stderr


def test_noise_that_is_not_stated_is_asked_for(identnl, config):
    files = (config / 'oscillator.yaml', config / 'oscillator_layout.yaml')
    result = identnl('design', *files)
    assert result.exit_code == 2
    assert 'sensor output: noise is nan' in result.stderr


def test_the_real_command_runs_as_a_process(process, oscillator):
    result = process('design', *oscillator(), '--json')
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)['parameters']
