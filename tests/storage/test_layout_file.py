# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Layout files: gains and noises against values worked out by hand, clear errors."""

import math
from pathlib import Path

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.storage.layout_file import default_layout_path, load_layout, read_layout
from identnl_ros.storage.machine_file import load_machine
import numpy as np
import pytest

CONFIG = Path(__file__).parents[2] / 'config'
LAYOUTS = sorted(CONFIG.glob('*_layout.yaml'))

MINIMAL = """\
stand: minimal
sample_rate: 10 kHz
defaults:
  displacement:
    unit: nm
    noise: 10 nm
sensors:
  cell: {kind: force, excitation: shaker}
  probe:
    kind: displacement
    body: block
    point: [0.1, 20 cm, 300 mm]
    direction: -y
  accelerometer:
    kind: acceleration
    body: block
    point: [0, 0, 0]
    direction: [0, 3, 4]
    unit: V
    gain: 10 mV/(m/s^2)
    offset: 20 mV
    delay: 25 us
    noise: 1 mV
    resolution: 0.002 m/s^2
    dropout_probability: 0.1 %
    column: ai3
"""


@pytest.mark.parametrize('path', LAYOUTS, ids=lambda path: path.stem)
def test_shipped_layouts_fit_their_machines(path):
    file = load_layout(path)
    machine = load_machine(path.with_name(path.name.replace('_layout', ''))).machine

    assert file.text == path.read_text()
    bodies = {body.name for body in machine.bodies}
    assert {sensor.body for sensor in file.layout.sensors if sensor.body} <= bodies
    measured = {sensor.excitation for sensor in file.layout.sensors if sensor.excitation}
    assert measured == {point.name for point in machine.excitations}


@pytest.mark.parametrize('name', ['knee_column', 'three_body'])
@pytest.mark.parametrize('kind', [SensorKind.DISPLACEMENT, SensorKind.ACCELERATION])
def test_shipped_layouts_see_every_motion_of_every_body_well(name, kind):
    machine = load_machine(CONFIG / f'{name}.yaml').machine
    layout = load_layout(CONFIG / f'{name}_layout.yaml').layout
    for body in machine.bodies:
        sensors = [
            sensor
            for sensor in layout.sensors
            if sensor.kind is kind and sensor.body == body.name and not sensor.reference_body
        ]
        # Reading of a rigid body: direction . (u + theta x lever), written out by hand.
        rows = np.array(
            [
                [
                    *sensor.direction,
                    *np.cross(sensor.point - body.centre_of_mass, sensor.direction),
                ]
                for sensor in sensors
            ]
        )
        assert len(sensors) >= 6
        assert np.linalg.cond(rows / np.linalg.norm(rows, axis=0)) < 5
        translations = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))[:3]
        assert translations.max() < 1.0  # times the noise of one sensor


def test_silverbox_channels_are_volts_at_the_rate_of_the_benchmark():
    layout = load_layout(CONFIG / 'oscillator_layout.yaml').layout
    force, displacement = layout.sensors

    assert layout.sample_rate == 1e7 / 2**14
    assert (force.column, force.recorded_unit, force.gain) == ('V1', 'V', 1.0)
    assert (displacement.column, displacement.recorded_unit, displacement.gain) == ('V2', 'V', 1.0)


def test_recorded_unit_of_the_same_dimension_gives_the_gain():
    cell, probe, _ = read_layout(MINIMAL, 'text').sensors

    assert (cell.recorded_unit, cell.gain) == ('N', 1.0)
    assert probe.recorded_unit == 'nm'
    assert probe.gain == 1e9  # nanometres per metre
    assert probe.noise == 1e-8
    assert probe.to_recorded(np.array([3e-9]), np.zeros(1)) == pytest.approx(3.0)


def test_gain_with_unit_converts_volts_and_noise_in_either_unit():
    *_, sensor = read_layout(MINIMAL, 'text').sensors

    assert sensor.gain == 0.01  # volts per m/s^2
    assert sensor.offset == 0.02  # volts
    assert sensor.delay == 2.5e-5
    assert sensor.noise == pytest.approx(0.1)  # 1 mV / (10 mV/(m/s^2))
    assert sensor.resolution == 0.002
    assert sensor.dropout_probability == 0.001
    assert sensor.column == 'ai3'
    np.testing.assert_allclose(sensor.direction, [0, 0.6, 0.8])


def test_geometry_is_converted_and_the_ground_is_the_default_reference():
    _, probe, _ = read_layout(MINIMAL, 'text').sensors

    np.testing.assert_array_equal(probe.point, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(probe.direction, [0, -1, 0])
    assert probe.reference_body == ''


def test_relative_probe_names_the_body_it_measures_against():
    text = MINIMAL.replace('direction: -y', 'direction: -y\n    relative_to: column')
    _, probe, _ = read_layout(text, 'text').sensors

    assert probe.reference_body == 'column'
    grounded = MINIMAL.replace('direction: -y', 'direction: -y\n    relative_to: ground')
    assert read_layout(grounded, 'text').sensors[1].reference_body == ''


def test_factor_corrects_a_gain_that_the_unit_tells():
    text = MINIMAL.replace('direction: -y', 'direction: -y\n    gain: 0.98')

    assert read_layout(text, 'text').sensors[1].gain == pytest.approx(0.98e9)


def test_sensor_overrides_the_default_of_its_kind():
    text = MINIMAL.replace('direction: -y', 'direction: -y\n    noise: 2 nm')

    assert read_layout(text, 'text').sensors[1].noise == 2e-9


def test_noise_not_stated_is_unknown_and_differs_from_none():
    cell, *_ = read_layout(MINIMAL, 'text').sensors
    silent = MINIMAL.replace('excitation: shaker', 'excitation: shaker, noise: 0')

    assert math.isnan(cell.noise)
    assert read_layout(silent, 'text').sensors[0].noise == 0.0


def test_steps_of_a_converter_are_a_recorded_unit():
    text = MINIMAL.replace(
        'excitation: shaker', 'excitation: shaker, unit: count, gain: 8 count/N'
    )

    assert read_layout(text, 'text').sensors[0].gain == 8.0


def test_default_layout_stands_beside_the_machine():
    assert default_layout_path('stands/mill.yaml') == Path('stands/mill_layout.yaml')


BAD = [
    # what to replace, by what, line, words of the error
    ('noise: 10 nm', 'noise: 10 kg', 6, 'noise: found "10 kg", expected a length such as "10 nm"'),
    ('noise: 10 nm', 'nois: 10 nm', 6, 'defaults.displacement.nois: unknown key; did you mean'),
    ('noise: 10 nm', 'noise: -1', 9, 'sensor probe: noise is -1.0'),
    ('noise: 10 nm', 'noise: nan', 6, 'found "nan"'),
    ('unit: nm', 'unit: nmm', 5, 'unit: found "nmm", which is no known unit'),
    ('unit: nm', 'unit: V', 9, 'sensors.probe.gain: found nothing, expected a gain from a length'),
    ('unit: nm', 'unit: V\n    gain: 5', 6, 'gain: found "5", expected a gain'),
    ('unit: nm', 'unit: nm\n    gain: 1 nm', 6, 'expected a plain factor'),
    ('unit: nm', 'unit: nm\n    gain: 0', 10, 'sensor probe: gain is 0.0'),
    ('10 mV/(m/s^2)', '10 mV/g', 20, 'gain: found "10 mV/g", expected a gain from an accel'),
    ('  displacement:', '  displacements:', 4, 'did you mean "displacement"?'),
    ('kind: displacement', 'kind: strain', 10, 'sensors.probe.kind: found "strain", expected'),
    ('    kind: displacement\n', '', 9, 'sensors.probe.kind: found nothing, expected'),
    (', excitation: shaker', '', 8, 'sensors.cell.excitation: found nothing, expected a name'),
    ('excitation: shaker', 'excitation: shaker, body: b', 8, 'sensors.cell.body: unknown key'),
    (
        'kind: acceleration',
        'kind: acceleration\n    relative_to: b',
        16,
        'relative_to: unknown key',
    ),
    ('    direction: -y\n', '', 9, 'sensors.probe.direction: found nothing, expected a direction'),
    ('direction: -y', 'direction: [0, 0, 0]', 9, 'sensor probe: direction is zero'),
    ('direction: -y', 'direction: -y\n    relative_to: block', 9, 'measures block against itself'),
    ('offset: 20 mV', 'drift: 20 mV', 21, 'drift: found "20 mV", expected a rate of the recorded'),
    ('offset: 20 mV', 'offset: 20 N', 21, 'offset: found "20 N", expected a recorded value'),
    ('delay: 25 us', 'delay: 25 um', 22, 'delay: found "25 um", expected a time'),
    ('0.1 %', '200 %', 14, 'dropout_probability is 2.0'),
    ('sample_rate: 10 kHz', 'sample_rate: 10 kg', 2, 'sample_rate: found "10 kg"'),
    ('sample_rate: 10 kHz', 'sample_rate: 0', None, 'sample_rate is 0.0'),
    ('  probe:', '  cell:', 9, 'the key "cell" is here twice'),
]


@pytest.mark.parametrize(('old', 'new', 'line', 'words'), BAD, ids=[f'{b[1]!r}' for b in BAD])
def test_bad_file_gives_one_line_with_place_and_cause(old, new, line, words):
    assert old in MINIMAL

    with pytest.raises(LayoutError) as caught:
        read_layout(MINIMAL.replace(old, new, 1), 'bad.yaml')

    message = str(caught.value)
    assert message.startswith('bad.yaml: ' if line is None else f'bad.yaml:{line}: ')
    assert words in message
    assert '\n' not in message


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'found nothing'),
        ('sensors: {}', 'no sensors'),
        ('stand: a', 'sensors: found nothing'),
        ('sensors: [1]', 'sensors: found a list of 1'),
        ('sensors: {a: 3}', 'sensors.a: found "3"'),
        ('sensors: {a: {kind: [force]}}', 'sensors.a.kind'),
        ('sensors: {a: {kind: force, unit: [V]}}', 'sensors.a.unit: found a list of 1'),
        ('defaults: 3\nsensors: {a: {kind: force, excitation: e}}', 'defaults: found "3"'),
    ],
)
def test_text_that_is_no_layout_file_gives_one_line(text, words):
    with pytest.raises(LayoutError) as caught:
        read_layout(text, 'bad.yaml')

    assert str(caught.value).startswith('bad.yaml')
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)


def test_missing_layout_is_a_layout_error():
    with pytest.raises(LayoutError, match='no such file'):
        load_layout(CONFIG / 'nothing_layout.yaml')
