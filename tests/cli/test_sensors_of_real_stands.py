# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Triaxial accelerometers with gravity, probes across joints, a mass in front: file to result."""

import json

import pytest

CORNERS = {
    'column': ((0.25, 0.25, 0.1), (-0.25, -0.25, 0.1), (-0.25, 0.25, 1.4)),
    'knee': ((0.25, 0.22, 0.5), (0.62, -0.22, 0.5), (0.25, -0.22, 0.9)),
}
LAYOUT = """\
stand: knee_and_column
sample_rate: 10 kHz
defaults:
  acceleration: {{unit: V, gain: 10 mV/(m/s^2), reads_gravity: true, noise: 0.01 m/s^2}}
  displacement: {{unit: nm, noise: 10 nm}}
sensors:
  force: {{kind: force, excitation: exciter, front_mass: 350 g, noise: 0.2 N}}
{triads}"""


def triads():
    """Accelerometers turned about z, probes of the knee against the column."""
    lines = []
    for body, corners in CORNERS.items():
        other = ', relative_to: column' if body == 'knee' else ''
        for i, corner in enumerate(corners):
            place = f'body: {body}, point: {list(corner)}'
            lines.append(
                f'  {body}_a{i}: {{kind: acceleration, {place}, axes: [x, y, z], '
                'orientation: {x: [3, 4, 0], z: -z}}\n'
            )
            lines.append(
                f'  {body}_d{i}: {{kind: displacement, {place}{other}, axes: [x, y, z]}}\n'
            )
    return ''.join(lines)


@pytest.fixture
def layout(tmp_path):
    path = tmp_path / 'layout.yaml'
    path.write_text(LAYOUT.format(triads=triads()), 'utf-8')
    return path


def test_clean_bag_gives_every_parameter_back(document, config, tmp_path, layout):
    bag = tmp_path / 'run.mcap'
    made = document(
        'simulate', '--machine', config / 'knee_column.yaml', '--layout', layout,
        '--noise', 'none', '--duration', '0.5', '--seed', '4', '--out', bag,
    )  # fmt: skip
    assert made['channels'][:3] == ['force', 'column_a0_x', 'column_a0_y']
    assert len(made['channels']) == 37
    for parameter in document('identify', bag)['parameters']:
        truth = made['true_parameters'][parameter['name']]
        assert parameter['value'] == pytest.approx(truth, rel=1e-8)


def test_check_tells_gravity_that_points_another_way_than_the_machines(
    identnl, config, tmp_path, layout
):
    machine = tmp_path / 'machine.yaml'
    text = (config / 'knee_column.yaml').read_text('utf-8')
    assert 'rest: locked_in' in text
    machine.write_text(
        text.replace('rest: locked_in', 'rest: computed\ngravity: [0, -9.81, 0]'), 'utf-8'
    )
    result = identnl('check', layout, '--machine', machine, '--json')
    assert result.exit_code != 0
    (found,) = json.loads(result.stdout)['files']
    assert 'gravity is [0, 0, -9.80665] m/s^2, but that of machine' in found['problems'][0]
    fitting = identnl('check', layout, '--machine', config / 'knee_column.yaml', '--json')
    assert fitting.exit_code == 0
