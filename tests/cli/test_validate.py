# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl validate` on bags of the simulated stand."""

import csv
import json

from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.machine_file import load_machine
import numpy as np
import pytest


@pytest.fixture(scope='module')
def results(tmp_path_factory, config):
    """Make a bag to identify from, the result, and a bag that the fit has not seen."""
    from click.testing import CliRunner
    from identnl_ros.cli.commands import cli

    folder = tmp_path_factory.mktemp('validate')
    for name, noise, seed in (('fit', 'none', 1), ('held_out', 'nominal', 2)):
        made = CliRunner().invoke(cli, [
            'simulate', '--machine', str(config / 'knee_column.yaml'), '--excitation', 'multisine',
            '--noise', noise, '--duration', '0.15', '--seed', str(seed),
            '--out', str(folder / f'{name}.mcap'),
        ])  # fmt: skip
        assert made.exit_code == 0, made.output
    found = CliRunner().invoke(
        cli, ['identify', str(folder / 'fit.mcap'), '--estimator', 'pointwise', '--json']
    )
    (folder / 'result.json').write_text(found.stdout, 'utf-8')
    return folder


def changed(results, tmp_path, change):
    """Write the result with something changed."""
    document = json.loads((results / 'result.json').read_text('utf-8'))
    change(document)
    path = tmp_path / 'changed.json'
    path.write_text(json.dumps(document), 'utf-8')
    return path


def test_identified_machine_agrees_on_a_bag_it_has_not_seen(document, results, tmp_path):
    out = tmp_path / 'new' / 'folder'
    found = document(
        'validate', results / 'held_out.mcap', '--parameters', results / 'result.json',
        '--out', out, '--samples', '100',
    )  # fmt: skip
    assert found['agrees']
    assert found['verdict'] == 'agrees to the noise'
    (stream,) = found['streams']
    assert stream['samples'] == 1500 - 32
    assert len(stream['channels']) == 57
    for channel in stream['channels']:
        assert channel['verdict'] == 'agrees to the noise'
        assert channel['ratio'] == pytest.approx(1, abs=0.15)
        assert channel['nrmse'] == pytest.approx(channel['ratio'] * channel['floor'])
        assert channel['band'] < channel['noise']
        assert channel['noise_stated']
    assert sorted(path.name for path in out.iterdir()) == ['traces.csv', 'validation.json']
    assert json.loads((out / 'validation.json').read_text('utf-8')) == found
    with (out / 'traces.csv').open(encoding='utf-8') as file:
        head, *rows = csv.reader(file)
    assert head[:3] == ['time [s]', 'column_s1x measured [m]', 'column_s1x simulated [m]']
    assert (len(rows), {len(row) for row in rows}) == (100, {1 + 3 * 57})


def test_wrong_value_differs_with_exit_code_1_and_words(identnl, results, tmp_path):
    def change(document):
        document['parameters'][0]['value'] *= 1.05

    path = changed(results, tmp_path, change)
    result = identnl('validate', results / 'held_out.mcap', '--parameters', path)
    assert result.exit_code == 1
    assert 'The model differs from the measurement' in result.stdout
    assert 'sensors differ, most clearly' in ' '.join(result.stdout.split())
    assert 'Displacement [µm]' in result.stdout
    assert 'Acceleration [m/s²]' in result.stdout


def without_value(document):
    document['parameters'][3]['value'] = None
    document['parameters'][3]['status'] = 'not_identifiable'


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (without_value, ('no value for', 'not_identifiable', 'did not determine it')),
        (lambda d: d['parameters'].pop(), ('covariance', 'expected 15 of 15')),
        (lambda d: d['parameters'][0].update(name='x.y'), ('x.y', 'does not estimate')),
        (lambda d: d['parameters'][0].update(unit='N'), ('unit N, expected N/m^2',)),
        (lambda d: d['parameters'][0].update(value='many'), ('0.value', 'found "many"')),
        (lambda d: d.pop('covariance'), ('covariance', 'missing')),
        (lambda d: d['covariance'][0].__setitem__(0, -1.0), ('negative variance',)),
        (lambda d: d.update(parameters=[]), ('found none',)),
        (lambda d: d['parameters'].append(d['parameters'][0]), ('more than once',)),
    ],
)  # fmt: skip
def test_unusable_result_is_told_in_a_sentence(identnl, results, tmp_path, change, words):
    path = changed(results, tmp_path, change)
    result = identnl('validate', results / 'held_out.mcap', '--parameters', path)
    assert result.exit_code == 2
    assert 'changed.json' in result.stderr
    for word in words:
        assert word in result.stderr


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('{"error": "no such bag"}', 'the error of a command: no such bag'),
        ('machine: x', 'is not JSON'),
        ('[1]', 'identify BAG --json'),
        ('{"parameters": 3}', 'found'),
        ('[' * 100_000, 'JSON'),
    ],
)
def test_file_that_is_no_result_is_told_in_a_sentence(identnl, results, tmp_path, text, words):
    path = tmp_path / 'no.json'
    path.write_text(text, 'utf-8')
    result = identnl('validate', results / 'held_out.mcap', '--parameters', path)
    assert result.exit_code == 2
    assert words in result.stderr


def test_result_of_another_machine_is_refused(identnl, results, bags):
    result = identnl(
        'validate', bags / 'three_body_multisine.mcap', '--parameters', results / 'result.json'
    )
    assert result.exit_code == 2
    assert 'does not fit machine three_body' in result.stderr
    assert 'slideway_6.normal_stiffness' in result.stderr


def test_unknown_uncertainty_is_said(document, results, tmp_path):
    def change(found):
        found['parameters'][0]['standard_deviation'] = None
        for i, row in enumerate(found['covariance']):
            row[0] = None
            found['covariance'][0][i] = None

    path = changed(results, tmp_path, change)
    found = document('validate', results / 'held_out.mcap', '--parameters', path)
    assert found['agrees']
    assert 'uncertainty of slideway_6.normal_stiffness is not known' in found['notes'][0]


def test_gap_of_a_bag_makes_two_runs(document, config, tmp_path):
    rate = 610.3515625
    truth = document(
        'simulate', '--machine', config / 'oscillator.yaml', '--excitation', 'multisine',
        '--noise', 'none', '--duration', '4', '--rate', rate, '--out', tmp_path / 'a.mcap',
    )['true_parameters']  # fmt: skip
    samples = np.concatenate([one.samples for one in open_bag(tmp_path / 'a.mcap').blocks()])
    samples[:, 1] += 1e-5 * np.random.default_rng(1).standard_normal(len(samples))
    rows = [
        f'{i / rate:.9f},{u:.17g},{y:.17g}'
        for i, (u, y) in enumerate(samples)
        if not 1000 <= i < 1010
    ]
    (tmp_path / 'a.csv').write_text('t,V1,V2\n' + '\n'.join(rows), 'utf-8')
    document('import', tmp_path / 'a.csv', '--layout', config / 'oscillator_layout.yaml',
             '--out', tmp_path / 'b')  # fmt: skip
    model = assemble(load_machine(config / 'oscillator.yaml').machine)
    unknowns = [model.parameters[i] for i in model.estimated]
    result = {
        'parameters': [
            {'name': one.name, 'unit': one.unit, 'value': truth[one.name]} for one in unknowns
        ],
        'covariance': [[0.0] * len(unknowns)] * len(unknowns),
    }
    (tmp_path / 'r.json').write_text(json.dumps(result), 'utf-8')
    found = document('validate', tmp_path / 'b', '--machine', config / 'oscillator.yaml',
                     '--parameters', tmp_path / 'r.json')  # fmt: skip
    (stream,) = found['streams']
    assert stream['runs'] == 2
    assert any('missing between the blocks' in one for one in found['problems'])
    (channel,) = stream['channels']
    assert not channel['noise_stated']
    assert channel['noise'] == pytest.approx(1e-5, rel=0.3)
