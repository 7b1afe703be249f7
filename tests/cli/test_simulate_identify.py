# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""From a simulated stand to parameters, through bags and the command line."""

import json

import pytest


@pytest.mark.parametrize('machine', ['knee_column', 'three_body'])
@pytest.mark.parametrize('excitation', ['sine', 'multisine'])
def test_clean_bag_gives_every_parameter_back_to_1e_9(
    document, config, tmp_path, machine, excitation
):
    bag = tmp_path / 'run.mcap'
    made = document(
        'simulate', '--machine', config / f'{machine}.yaml', '--excitation', excitation,
        '--noise', 'none', '--duration', '0.5', '--rate', '10000', '--seed', '4', '--out', bag,
    )  # fmt: skip
    found = document('identify', bag)
    assert len(found['parameters']) == 16
    for parameter in found['parameters']:
        truth = made['true_parameters'][parameter['name']]
        assert parameter['true_value'] == truth
        assert parameter['value'] == pytest.approx(truth, rel=1e-9)
        assert parameter['status'] == 'ok'
        assert abs(parameter['value'] - truth) < 20 * parameter['standard_deviation']
    assert found['samples'] == 5000
    assert found['residual'] < 1e-9


def test_document_has_what_programs_rely_on(document, bags):
    found = document('identify', bags / 'knee_column_sine.mcap', '--estimator', 'pointwise')
    assert {'parameters', 'covariance', 'samples', 'residual', 'condition_number'} <= found.keys()
    size = len(found['parameters'])
    assert [len(row) for row in found['covariance']] == [size] * size
    for i, parameter in enumerate(found['parameters']):
        assert {'name', 'unit', 'value', 'standard_deviation', 'status'} <= parameter.keys()
        assert found['covariance'][i][i] == pytest.approx(parameter['standard_deviation'] ** 2)


def test_shipped_bags_give_their_true_parameters(document, bags):
    for name in ('knee_column_sine', 'three_body_multisine'):
        for parameter in document('identify', bags / f'{name}.mcap')['parameters']:
            assert parameter['value'] == pytest.approx(parameter['true_value'], rel=1e-9)


def test_noise_is_never_mistaken_for_knowledge(document, config, tmp_path):
    bag = tmp_path / 'noisy.mcap'
    document(
        'simulate', '--machine', config / 'knee_column.yaml', '--noise', 'nominal',
        '--duration', '1', '--seed', '5', '--out', bag,
    )  # fmt: skip
    wrong_and_sure = [
        parameter['name']
        for parameter in document('identify', bag)['parameters']
        if parameter['status'] == 'ok'
        and abs(parameter['value'] - parameter['true_value']) > 5 * parameter['standard_deviation']
    ]
    assert not wrong_and_sure


def test_same_seed_gives_the_same_bytes_another_seed_others(identnl, config, tmp_path):
    paths = [tmp_path / f'{i}.mcap' for i in range(3)]
    for path, seed in zip(paths, (1, 1, 2), strict=True):
        result = identnl(
            'simulate', '--machine', config / 'knee_column.yaml', '--duration', '0.05',
            '--seed', seed, '--out', path,
        )  # fmt: skip
        assert result.exit_code == 0
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].read_bytes() != paths[2].read_bytes()


def test_machine_without_layout_is_seen_by_sensors_everywhere(identnl, config, tmp_path):
    machine = tmp_path / 'mine.yaml'
    machine.write_text((config / 'three_body.yaml').read_text('utf-8'), 'utf-8')
    bag = tmp_path / 'mine.mcap'
    result = identnl(
        'simulate', '--machine', machine, '--noise', 'none', '--duration', '0.3', '--out', bag
    )
    assert result.exit_code == 0
    assert 'no layout file' in result.stderr
    found = json.loads(identnl('identify', bag, '--json').stdout)
    for parameter in found['parameters']:
        assert parameter['value'] == pytest.approx(parameter['true_value'], rel=1e-9)


def test_recorded_force_drives_the_machine(document, config, tmp_path):
    force = tmp_path / 'force.txt'
    force.write_text('\n'.join(str(100.0 * (i % 50 < 5)) for i in range(2000)), 'utf-8')
    bag = tmp_path / 'run.mcap'
    document(
        'simulate', '--machine', config / 'knee_column.yaml', '--excitation', 'recorded',
        '--force', force, '--noise', 'none', '--duration', '0.2', '--rate', '10000', '--out', bag,
    )  # fmt: skip
    for parameter in document('identify', bag)['parameters']:
        assert parameter['value'] == pytest.approx(parameter['true_value'], rel=1e-6)


def test_machine_file_on_the_command_line_replaces_that_of_the_bag(
    document, bags, config, tmp_path
):
    text = (config / 'knee_column.yaml').read_text('utf-8')
    changed = tmp_path / 'less.yaml'
    changed.write_text(text.replace('{estimate: 380 daN/um^2}', '380 daN/um^2'), 'utf-8')
    found = document('identify', bags / 'knee_column_sine.mcap', '--machine', changed)
    names = [parameter['name'] for parameter in found['parameters']]
    assert len(names) == 15
    assert 'slideway_6.normal_stiffness' not in names


def test_people_see_the_papers_units(process, bags):
    result = process('identify', bags / 'knee_column_sine.mcap')
    assert result.returncode == 0
    assert 'daN/µm²' in result.stdout
    row = next(line for line in result.stdout.splitlines() if 'slideway_8 a_n' in line)
    assert row.split()[3:5] == ['340', '340']
    assert '3.4e+15' in row


def test_stream_id_tells_machines_layouts_and_runs_apart(document, config, tmp_path):
    layout = tmp_path / 'layout.yaml'
    text = (config / 'knee_column_layout.yaml').read_text('utf-8')
    layout.write_text(text + '# moved\n', 'utf-8')
    machine = ('--machine', config / 'knee_column.yaml')
    runs = [
        machine,
        machine,
        ('--machine', config / 'three_body.yaml'),
        (*machine, '--layout', layout),
        (*machine, '--amplitude', '200'),
        (*machine, '--noise', '0.5'),
        (*machine, '--seed', '1'),
    ]
    ids = []
    for i, options in enumerate(runs):
        bag = tmp_path / f'{i}.mcap'
        document('simulate', *options, '--duration', '0.05', '--out', bag)
        (found,) = document('check', bag)['files']
        ids.append(found['streams'][0]['stream_id'])
    assert ids[0] == ids[1]
    assert len(set(ids)) == len(ids) - 1


@pytest.mark.parametrize(
    'options',
    [
        ('--excitation', 'sine', '--frequency', '500'),
        ('--excitation', 'multisine', '--band', '10', '500'),
        ('--excitation', 'sweep', '--band', '10', '600'),
    ],
)
def test_force_beyond_half_the_sample_rate_is_refused(identnl, config, tmp_path, options):
    result = identnl(
        'simulate', '--machine', config / 'knee_column.yaml', *options, '--rate', '1000',
        '--duration', '0.1', '--out', tmp_path / 'x.mcap',
    )  # fmt: skip
    assert result.exit_code == 2
    assert 'expected less than half the sample rate, 500 Hz' in result.stderr
    assert not list(tmp_path.iterdir())
