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


TRIAXIAL = """\
gravity: [0, 0, -9.81 m/s^2]
defaults:
  acceleration: {unit: V, gain: 10 mV/(m/s^2), noise: 1 mV, reads_gravity: true}
sensors:
  cell: {kind: force, excitation: shaker, front_mass: 35 g}
  corner:
    kind: acceleration
    body: knee
    point: [0.1, 0, 20 cm]
    offset: 5 mV
    axes:
      x: {column: ai0, gain: 9.8 mV/(m/s^2)}
      y:
      z: {column: ai2, delay: 2 us, offset: 0, reads_gravity: false}
    orientation: {x: [0, 1, 1], y: -x}
  probe: {kind: displacement, body: knee, point: [0, 0, 0], relative_to: column, axes: [z, x]}
"""


def test_triaxial_sensor_is_three_sensors_along_its_own_axes():
    cell, x, y, z, *probes = read_layout(TRIAXIAL, 'text').sensors

    assert [one.name for one in (x, y, z)] == ['corner_x', 'corner_y', 'corner_z']
    assert [one.column for one in (x, y, z)] == ['ai0', 'corner_y', 'ai2']
    assert [one.gain for one in (x, y, z)] == [0.0098, 0.01, 0.01]
    assert [one.offset for one in (x, y, z)] == [0.005, 0.005, 0.0]
    assert [one.delay for one in (x, y, z)] == [0.0, 0.0, 2e-6]
    assert [one.reads_gravity for one in (x, y, z)] == [True, True, False]
    assert y.noise == pytest.approx(0.1)
    half = math.sqrt(0.5)
    # z completes a right-handed frame: x cross y, worked out by hand.
    for one, direction in ((x, [0, half, half]), (y, [-1, 0, 0]), (z, [0, -half, half])):
        assert (one.kind, one.body) == (SensorKind.ACCELERATION, 'knee')
        np.testing.assert_array_equal(one.point, [0.1, 0.0, 0.2])
        np.testing.assert_allclose(one.direction, direction, atol=1e-15)
    assert [(one.name, one.reference_body) for one in probes] == [
        ('probe_z', 'column'),
        ('probe_x', 'column'),
    ]
    np.testing.assert_array_equal(probes[0].direction, [0, 0, 1])
    assert cell.front_mass == pytest.approx(0.035)


def test_gravity_is_read_and_is_the_standard_one_by_default():
    np.testing.assert_array_equal(read_layout(TRIAXIAL, 'text').gravity, [0, 0, -9.81])
    np.testing.assert_array_equal(read_layout(MINIMAL, 'text').gravity, [0, 0, -9.80665])
    assert not any(sensor.reads_gravity for sensor in read_layout(MINIMAL, 'text').sensors)


@pytest.mark.parametrize(
    ('stated', 'recorded'),
    [('10 V', 10.0), ('500 m/s^2', 5.0), ('9', 9.0), ('8000 mV', 8.0)],
)
def test_full_scale_is_in_the_recorded_unit_or_that_of_the_quantity(stated, recorded):
    text = MINIMAL.replace('offset: 20 mV', f'full_scale: {stated}')
    default = MINIMAL.replace('noise: 10 nm', 'full_scale: 0.5 mm')

    assert read_layout(text, 'text').sensors[2].full_scale == pytest.approx(recorded)
    assert read_layout(default, 'text').sensors[1].full_scale == pytest.approx(5e5)  # nm
    assert math.isnan(read_layout(default, 'text').sensors[2].full_scale)


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
    ('10 mV/(m/s^2)', '10 mV/g', 20, 'gain: found "10 mV/g", where "g" is the gram (grav'),
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


def test_axis_that_is_off_its_place_has_a_direction_of_its_own():
    text = TRIAXIAL.replace('z: {column', 'z: {direction: [0.1, -1, 1], column')
    _, x, y, z, *_ = read_layout(text, 'text').sensors
    _, own_x, own_y, *_ = read_layout(TRIAXIAL, 'text').sensors
    np.testing.assert_allclose(z.direction, np.array([0.1, -1, 1]) / np.sqrt(2.01))
    np.testing.assert_array_equal([x.direction, y.direction], [own_x.direction, own_y.direction])


BAD_TRIAXIAL = [
    ('9.8 mV/(m/s^2)', '9.8 mV/m', 12, 'sensors.corner_x.gain: found "9.8 mV/m", expected a gain'),
    ('y:\n', 'w:\n', 13, 'sensors.corner.axes.w: is no axis; expected some of'),
    ('y:\n', 'y: 3\n', 13, 'sensors.corner.axes.y: found "3", expected keys and values'),
    ('delay: 2 us', 'dely: 2', 14, 'sensors.corner.axes.z.dely: is no key of a single axis'),
    ('point: [0.1, 0, 20 cm]', 'point: [0.1, 0]', 9, 'point: found a list of 2'),
    ('point: [0.1, 0, 20 cm]', 'pont: 3', 9, 'sensors.corner_x.pont: unknown key; did you mean'),
    ('body: knee\n', 'direction: +x\n', 8, 'corner.direction: a sensor with axes has several'),
    ('offset: 5 mV', 'column: ai9', 10, 'corner.column: a sensor with axes has several'),
    ('[0, 1, 1], y: -x', '[0, 1, 1], y: +z', 15, 'orientation: x and y are at 45 degrees'),
    ('y: -x}', 'y: -x, z: [0, 1, -1]}', 15, 'orientation: the axes x, y, z are left-handed'),
    ('y: -x}', 'y: [0, 0, 0]}', 15, 'orientation: y: direction is zero'),
    ('[0, 1, 1], y: -x', '[0, 1, 1]', 15, 'orientation: found keys and values, expected where'),
    ('y: -x}', 'w: -x}', 15, 'orientation: found "w", expected where at least two'),
    ('z: {', 'z: {direction: up, ', 14, 'corner_z.direction: found "up", expected a direction'),
    ('y: -x}', 'y: up}', 15, 'orientation: y: found "up", expected a direction'),
    ('[z, x]', '[z, z]', 16, 'sensors.probe.axes.1: axis z is here twice'),
    ('[z, x]', '[]', 16, 'sensors.probe.axes: found a list of 0, expected some of the'),
    ('[z, x]', '3', 16, 'sensors.probe.axes: found "3", expected some of the axes'),
    ('axes: [z, x]', 'direction: +x, orientation: {}', 16, 'orientation: goes with the key axes'),
    ('  cell:', '  corner_y:', 6, 'sensors.corner: two sensors are called corner_y'),
    ('kind: displacement', 'kind: force', 16, 'axes: only sensors of acceleration, velocity'),
    ('35 g', '35 mm', 5, 'sensors.cell.front_mass: found "35 mm", expected a mass'),
    ('35 g', '-35 g', 5, 'sensor cell: front_mass is -0.035 kg'),
    ('reads_gravity: true', 'reads_gravity: yes', 3, 'reads_gravity: found "yes", expected true'),
    ('-9.81 m/s^2]', '-9.81 m/s]', 1, 'gravity: number 3: found "-9.81 m/s", expected an accel'),
    ('cell: {', 'cell: {full_scale: 3 m, ', 5, 'cell.full_scale: found "3 m", expected a'),
    ('cell: {', 'cell: {full_scale: 0 N, ', 5, 'sensor cell: full_scale is 0.0'),
    ('cell: {', 'cell: {reads_gravity: true, ', 5, 'sensors.cell.reads_gravity: unknown key'),
]  # fmt: skip


@pytest.mark.parametrize(
    ('old', 'new', 'line', 'words'), BAD_TRIAXIAL, ids=[f'{b[1]!r}' for b in BAD_TRIAXIAL]
)
def test_bad_triaxial_sensor_gives_one_line_with_place_and_cause(old, new, line, words):
    assert old in TRIAXIAL

    with pytest.raises(LayoutError) as caught:
        read_layout(TRIAXIAL.replace(old, new, 1), 'bad.yaml')

    message = str(caught.value)
    assert message.startswith(f'bad.yaml:{line}: ')
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
def test_text_that_is_no_layout_file_gives_a_line_for_each_problem(text, words):
    with pytest.raises(LayoutError) as caught:
        read_layout(text, 'bad.yaml')

    assert words in str(caught.value)
    assert all(line.startswith('bad.yaml') for line in str(caught.value).splitlines())


def test_missing_layout_is_a_layout_error():
    with pytest.raises(LayoutError, match='no such file'):
        load_layout(CONFIG / 'nothing_layout.yaml')


@pytest.mark.parametrize(
    ('sound', 'wrong', 'key', 'unit'),
    [
        ('gain: 10 mV/(m/s^2)', 'gain: 98.7 mV/g', 'gain', 'mV/g_0'),
        ('gain: 10 mV/(m/s^2)', 'gain: 98.7 mV/G', 'gain', 'mV/g_0'),
        ('noise: 1 mV', 'noise: 0.5 mg', 'noise', 'mg_0'),
        ('resolution: 0.002 m/s^2', 'resolution: 50 ug', 'resolution', 'ug_0'),
        ('unit: V', 'unit: g', 'unit', 'g_0'),
    ],
)
def test_gram_in_place_of_gravity_is_told_with_the_unit_to_write(sound, wrong, key, unit):
    with pytest.raises(LayoutError) as error:
        read_layout(MINIMAL.replace(sound, wrong), 'text')
    assert f'accelerometer.{key}: ' in str(error.value)
    assert f'"{unit}"' in str(error.value)
    if key != 'unit':
        proposed = f'{wrong.rpartition(" ")[0]} {unit}'
        sensor = read_layout(MINIMAL.replace(sound, proposed), 'text').sensors[-1]
        expected = {
            'gain': 0.0987 / 9.80665,
            'noise': 0.5e-3 * 9.80665,
            'resolution': 50e-6 * 9.80665,
        }
        assert getattr(sensor, key) == pytest.approx(expected[key])


def test_all_problems_of_a_layout_are_told_at_once_a_wrong_default_once():
    wrong = TRIAXIAL.replace('noise: 1 mV', 'noise: 1 mm').replace('35 g', '35 mm')
    wrong = wrong.replace('body: knee, point: [0, 0, 0]', 'body: knee, point: [0, 0]')
    with pytest.raises(LayoutError) as caught:
        read_layout(wrong, 'bad.yaml')
    cell, probe = str(caught.value).splitlines()
    assert cell.startswith('bad.yaml:5: sensors.cell.front_mass: found "35 mm"')
    assert probe.startswith('bad.yaml:16: sensors.probe_z.point: found a list of 2')

    # What needs the unit and the gain is read when the rest is right.
    with pytest.raises(LayoutError) as caught:
        read_layout(TRIAXIAL.replace('noise: 1 mV', 'noise: 1 mm').replace('2 us', '2 um'), 'b')
    noise, delay = str(caught.value).splitlines()
    assert noise.startswith('b:3: sensors.corner_x.noise: found "1 mm"')
    assert delay.startswith('b:14: sensors.corner_z.delay: found "2 um"')


def test_many_problems_are_counted():
    sensors = ''.join(f'  s{i}: {{kind: force, excitation: {i}}}\n' for i in range(13))
    with pytest.raises(LayoutError) as caught:
        read_layout(f'sensors:\n{sensors}', 'bad.yaml')
    *told, rest = str(caught.value).splitlines()
    assert [line.split(':')[1] for line in told] == [str(i) for i in range(2, 12)]
    assert rest == 'and 3 more problems'
