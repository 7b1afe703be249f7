# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""`identnl calibrate`: from bags to a layout file whose comments are still there."""

from dataclasses import replace

from identnl_ros.core.calibration.findings import Calibrated, Property
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.layout_editing import edited_layout
from identnl_ros.storage.layout_file import load_layout, read_layout
from identnl_ros.storage.machine_file import load_machine
import numpy as np
import pytest

MACHINE = """\
machine: sled
bodies:
  sled: {mass: 10 kg, centre_of_mass: [0, 0, 0], degrees_of_freedom: [translation_1]}
joints:
  spring: {kind: six_spring, body: sled, to: ground, point: [0, 0, 0],
           stiffness: [{estimate: 4e5 N/m}], damping: [200 N*s/m]}
excitations:
  exciter: {body: sled, point: [0, 0, 0], direction: +x, amplitude: 20 N, frequency: 40 Hz,
            band: [10 Hz, 200 Hz]}
"""
LAYOUT = """\
# Sensors of the sled.
stand: sled
sample_rate: 5 kHz
defaults:
  acceleration: {unit: V, gain: 10 mV/(m/s^2), noise: 0.1 mV}
sensors:
  cell: {kind: force, excitation: exciter, noise: 0.05 N}   # new in spring
  probe: {kind: displacement, body: sled, point: [0, 0, 0], direction: +x, unit: um, noise: 2 nm}
  speed: {kind: velocity, body: sled, point: [0, 0, 0], direction: +x, noise: 2e-6}
  flow: {kind: acceleration, body: sled, point: [0, 0, 0], direction: +x, gain: 10.2 mV/(m/s^2)}
  block:           # borrowed
    kind: acceleration
    body: sled     # on the left
    point: [0, 0, 0]
    direction: +x
    offset: 2 mV   # of the amplifier
"""


@pytest.fixture(scope='module')
def stand(tmp_path_factory):
    """Write files and bags of a stand whose accelerometers are not what the layout says."""
    folder = tmp_path_factory.mktemp('calibrate')
    (folder / 'sled.yaml').write_text(MACHINE, 'utf-8')
    (folder / 'layout.yaml').write_text(LAYOUT, 'utf-8')
    machine, layout = load_machine(folder / 'sled.yaml'), load_layout(folder / 'layout.yaml')
    sensors = tuple(
        replace(
            one, gain=1.05 * one.gain, offset=0.005, delay=30e-6, noise=1.5 * one.noise
        )
        if one.kind is SensorKind.ACCELERATION
        else one
        for one in layout.layout.sensors
    )  # fmt: skip
    actual = replace(layout.layout, sensors=sensors)
    for name, amplitude in (('quiet', 1e-9), ('motion', None)):
        source = SimulatedSource(
            machine.machine, layout.layout,
            TestRun(Excitation.MULTISINE, 4.0, 5000.0, seed=len(name), amplitude=amplitude),
            machine.text, layout.text, actual=Description(machine.machine, actual),
        )  # fmt: skip
        with BagWriter(folder / f'{name}.mcap') as bag:
            bag.write_description(source.description)
            for block in source.blocks():
                bag.write_block(block)
    return folder, actual


TRUSTED = ('--reference', 'probe', '--reference', 'velocity')


def test_what_is_found_is_written_and_comments_stay(stand, document, tmp_path):
    folder, actual = stand
    out = tmp_path / 'calibrated.yaml'
    found = document(
        'calibrate', folder / 'layout.yaml', '--quiet', folder / 'quiet.mcap',
        '--motion', folder / 'motion.mcap', *TRUSTED, '--out', out,
    )  # fmt: skip
    assert found['agrees']
    assert found['comments_kept']
    assert found['written'] == str(out)
    assert found['references'] == ['probe', 'speed']
    errors = {(one['sensor'], one['property']): one for one in found['calibrated']}
    new = {one.name: one for one in load_layout(out).layout.sensors}
    for name in ('flow', 'block'):
        truth = next(one for one in actual.sensors if one.name == name)
        for key in ('gain', 'delay', 'offset', 'noise'):
            error = errors[name, key]['standard_error']
            assert errors[name, key]['conspicuous'], (name, key)
            assert abs(getattr(new[name], key) - getattr(truth, key)) < 4 * error, (name, key)
    # What was trusted keeps its gain.
    assert [new[name].gain for name in ('probe', 'speed')] == [1e6, 1.0]
    text = out.read_text('utf-8')
    for line in LAYOUT.splitlines():
        if '#' in line:
            assert line[line.index('#') :] in text
    # The user's units, and a key of its own where there was a default.
    assert 'gain: 10.7' in text
    assert text.count('mV/(m/s^2)') >= 3
    assert [line for line in text.splitlines() if line.startswith('  flow: {')]
    # A sled that moves along x tells no direction.
    directions = {one['property'] for one in found['undetermined'] if one['sensor'] == 'flow'}
    assert directions == {'direction'}


def test_a_file_that_exists_is_not_written_over(stand, identnl, tmp_path):
    folder, _ = stand
    out = tmp_path / 'layout.yaml'
    out.write_text(LAYOUT, 'utf-8')
    # Without the quiet record the noise that the layout states is told to be too small.
    arguments = (
        'calibrate', out, '--quiet', folder / 'quiet.mcap', '--motion', folder / 'motion.mcap',
        *TRUSTED, '--out', out,
    )  # fmt: skip
    refused = identnl(*arguments)
    assert refused.exit_code == 2
    assert 'add --overwrite' in refused.stderr
    assert out.read_text('utf-8') == LAYOUT
    assert identnl(*arguments, '--overwrite').exit_code == 0
    assert '# calibrated: gain' in out.read_text('utf-8')


def test_sensors_that_do_not_agree_are_not_written(stand, document, tmp_path):
    folder, _ = stand
    out = tmp_path / 'out.yaml'
    arguments = (
        'calibrate', folder / 'layout.yaml', '--motion', folder / 'motion.mcap', *TRUSTED,
        '--reference', 'flow', '--out', out,
    )  # fmt: skip
    found = document(*arguments)
    assert not found['agrees']
    assert 'something else is wrong' in found['doubts'][0]
    assert found['written'] is None
    assert not out.exists()
    assert document(*arguments, '--force')['written'] == str(out)


def test_a_layout_that_the_bag_was_not_recorded_with_is_refused(stand, identnl, tmp_path):
    folder, _ = stand
    other = tmp_path / 'other.yaml'
    other.write_text(LAYOUT.replace('10.2 mV', '10.3 mV').replace('on the left', ''), 'utf-8')
    refused = identnl('calibrate', other, '--quiet', folder / 'quiet.mcap')
    assert refused.exit_code == 2
    assert 'flow (gain)' in refused.stderr


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ((), 'nothing to calibrate from'),
        (('--reference', 'probe'), 'nothing to calibrate from'),
        (('--motion', 'motion.mcap', '--reference', 'nobody'), 'no sensor nobody'),
        (('--known', 'motion.mcap', 'flow'), 'expected SENSOR=AMPLITUDE'),
        (('--known', 'motion.mcap', 'flow=3 kg'), 'an amplitude (rms)'),
        (('--known', 'motion.mcap', 'flow=-1'), 'more than 0'),
        (('--known-mass', 'motion.mcap', 'cell=5 kg'), 'expected CELL=MASS'),
        (('--known-mass', 'motion.mcap', 'probe=5 kg: flow'), 'expected a sensor of force'),
        (('--quiet', 'missing.mcap'), 'missing.mcap'),
        (
            ('--motion', 'motion.mcap', '--reference-uncertainty', 'flow=1 %'),
            'flow: an uncertainty is given, but the sensor is no reference',
        ),
        (
            ('--motion', 'motion.mcap', '--reference-uncertainty', 'flow'),
            'expected SENSOR=UNCERTAINTY',
        ),
        (('--known-mass', 'motion.mcap', 'cell=-1 kg: flow'), 'at least 0'),
    ],
)
def test_wrong_use_is_told_in_a_sentence(stand, identnl, arguments, message):
    folder, _ = stand
    named = [folder / one if str(one).endswith('.mcap') else one for one in arguments]
    found = identnl('calibrate', folder / 'layout.yaml', *named)
    assert found.exit_code == 2
    assert message in found.stderr
    assert 'Traceback' not in found.stderr


def test_a_quiet_record_alone_is_shown_in_tables(stand, identnl):
    folder, _ = stand
    found = identnl('calibrate', folder / 'layout.yaml', '--quiet', folder / 'quiet.mcap')
    assert found.exit_code == 0, found.stderr
    assert 'Quiet record: displacement [m]' in found.stdout
    assert 'not quiet' not in found.stdout


def gains(found):
    return {one['sensor']: one for one in found['calibrated'] if one['property'] == 'gain'}


def test_the_uncertainty_of_references_is_contained_and_told(stand, document):
    folder, _ = stand
    arguments = (
        'calibrate', folder / 'layout.yaml', '--quiet', folder / 'quiet.mcap',
        '--motion', folder / 'motion.mcap', '--reference', 'speed',
    )  # fmt: skip
    exact = document(*arguments)
    known = document(*arguments, '--reference-uncertainty', 'velocity=0.5 % of laser')
    assert any('gain of speed is not given' in one for one in exact['remarks'])
    assert any('contain the uncertainty of the gain of speed' in one for one in known['remarks'])
    for name, gain in gains(known).items():
        # The only reference: its error is that of every gain, the probe's too.
        assert gain['shares'] == {'laser': pytest.approx(0.005 * gain['value'], rel=1e-3)}
        own = gains(exact)[name]['standard_error']
        together = np.hypot(own, gain['shares']['laser'])
        assert gain['standard_error'] == pytest.approx(together, rel=1e-2)
        assert gain['interval'] == pytest.approx(
            [gain['value'] - 1.96 * together, gain['value'] + 1.96 * together], rel=1e-3
        )
    assert gains(known).keys() == {'probe', 'flow', 'block'}


HUNG = """\
machine: hung
bodies:
  block: {{mass: {mass} kg, centre_of_mass: [0, 0, 0], degrees_of_freedom: [translation_1]}}
joints: {{}}
excitations:
  exciter: {{body: block, point: [0, 0, 0], direction: +x, amplitude: {amplitude} N,
            frequency: 40 Hz, band: [10 Hz, 200 Hz]}}
"""
HUNG_LAYOUT = """\
sample_rate: 5 kHz
sensors:
  cell:
    kind: force
    excitation: exciter
    unit: V
    gain: 2 mV/N
    noise: 0.05 N
    front_mass: 150 g   # by the drawing
  ring: {kind: acceleration, body: block, point: [0, 0, 0], direction: +x, noise: 0.02}
"""


@pytest.fixture(scope='module')
def hung(tmp_path_factory):
    """Write bags of two masses on a cell with another gain and front mass than is stated."""
    folder = tmp_path_factory.mktemp('hung')
    (folder / 'layout.yaml').write_text(HUNG_LAYOUT, 'utf-8')
    file = load_layout(folder / 'layout.yaml')
    cell, ring = file.layout.sensors
    actual = replace(file.layout, sensors=(replace(cell, gain=2.1e-3, front_mass=0.2), ring))
    runs = ((5, Excitation.MULTISINE), (1, Excitation.MULTISINE), (2, Excitation.SINE))
    for mass, excitation in runs:
        path = folder / f'hung_{mass}.yaml'
        path.write_text(HUNG.format(mass=mass, amplitude=10 * mass), 'utf-8')
        machine = load_machine(path)
        source = SimulatedSource(
            machine.machine, file.layout, TestRun(excitation, 1.0, 5000.0, seed=mass),
            machine.text, file.text, actual=Description(machine.machine, actual),
        )  # fmt: skip
        with BagWriter(folder / f'{mass}.mcap') as bag:
            bag.write_description(source.description)
            for block in source.blocks():
                bag.write_block(block)
    return folder


def test_masses_on_a_cell_write_its_front_mass(hung, document, tmp_path):
    out = tmp_path / 'out.yaml'
    found = document(
        'calibrate', hung / 'layout.yaml', '--out', out,
        '--known-mass', hung / '5.mcap', 'cell=5 kg +- 0.1 % of scale: ring',
        '--known-mass', hung / '1.mcap', 'cell=1000 g +- 0.1 % of scale: ring',
        '--reference-uncertainty', 'ring=1 %',
    )  # fmt: skip
    assert found['agrees'], found['doubts']
    errors = {one['property']: one for one in found['calibrated']}
    cell = load_layout(out).layout.sensors[0]
    for key, right in (('gain', 2.1e-3), ('front_mass', 0.2)):
        assert abs(getattr(cell, key) - right) < 4 * errors[key]['standard_error'], key
        assert errors[key]['shares'].keys() >= {'scale', 'gain of ring'}
    assert errors['gain']['standard_error'] == pytest.approx(2.1e-3 * 0.01, rel=0.05)
    assert errors['front_mass']['unit'] == 'kg'
    assert errors['front_mass']['standard_error'] < 2e-3
    line = next(one for one in out.read_text('utf-8').splitlines() if 'front_mass:' in one)
    assert line.endswith(' g   # by the drawing')


def test_a_gain_by_a_calibrator_and_its_uncertainty_count_for_the_cell(hung, document):
    # The sine of 10 m/s^2 is 7.07 rms; by a calibrator that is said to make 7.5 the ring is low.
    found = document(
        'calibrate', hung / 'layout.yaml',
        '--known', hung / '2.mcap', 'ring=7.5 m/s^2 +- 2 % of table @ 40 Hz',
        '--known-mass', hung / '5.mcap', 'cell=5 kg +- 0.1 %: ring',
        '--known-mass', hung / '1.mcap', 'cell=1 kg +- 0.1 %: ring',
    )  # fmt: skip
    ring, cell = (gains(found)[name] for name in ('ring', 'cell'))
    assert ring['value'] == pytest.approx(np.sqrt(50) / 7.5, rel=1e-3)
    # Less motion than the ring read before: more force per acceleration.
    assert cell['value'] == pytest.approx(2.1e-3 * ring['value'], rel=3e-3)
    # If the table makes more than it says, both gains are too high.
    for gain in (ring, cell):
        assert gain['shares']['table'] == pytest.approx(0.02 * gain['value'], rel=0.01)
    front = next(one for one in found['calibrated'] if one['property'] == 'front_mass')
    assert abs(front['value'] - 0.2) < 4 * front['standard_error']
    assert abs(front['shares']['table']) < 1e-4


def test_one_mass_leaves_the_front_mass_as_stated(hung, document):
    found = document(
        'calibrate', hung / 'layout.yaml', '--known-mass', hung / '5.mcap', 'cell=5 kg: ring'
    )
    assert {one['property'] for one in found['calibrated']} == {'gain', 'delay'}
    # 50 g that the layout does not know of count as gain.
    gain = gains(found)['cell']
    assert abs(gain['value'] - 2.1e-3 * 5.2 / 5.15) < 4 * gain['standard_error']


def values():
    """Numbers for both accelerometers, as a calibration finds them."""
    axis = np.array([0.0, 1.0, 0.0])
    for name, gain in (('flow', 10.2e-3), ('block', 10e-3)):
        yield Calibrated(name, Property.GAIN, gain, 1.05 * gain, 1e-6)
        yield Calibrated(name, Property.DIRECTION, 0.0, 0.03, 1e-3, axis)
        yield Calibrated(name, Property.DELAY, 0.0, 31.4e-6, 1e-7)
        yield Calibrated(name, Property.OFFSET, 0.002, 0.0053, 1e-5)
        yield Calibrated(name, Property.NOISE, 0.01, 0.0123, 1e-5)
        yield Calibrated(name, Property.RESOLUTION, 0.0, 3.05e-4, np.nan)


FORMS = {
    'both styles': LAYOUT,
    'line ends of Windows': LAYOUT.replace('\n', '\r\n'),
    'no end of line at the end': LAYOUT.rstrip('\n'),
    'over several lines': LAYOUT.replace(
        ', gain: 10.2 mV/(m/s^2)}',
        ',\n         # here\n    gain: "10.2 mV/(m/s^2)"  # data sheet\n  }',
    ),
    'a list as the last key': LAYOUT.replace('    direction: +x\n', '').replace(
        '    offset: 2 mV   # of the amplifier\n',
        '    offset: 2 mV   # of the amplifier\n    direction:\n      - 1\n      - 0\n      - 0\n',
    ),
    'all in one line': 'sensors: {flow: {kind: acceleration, body: sled, point: [0, 0, 0], '
    'direction: +x, unit: V, gain: 10.2 mV/(m/s^2)}, block: {kind: acceleration, body: sled, '
    'point: [0, 0, 0], direction: +x, unit: V, gain: 10 mV/(m/s^2), offset: 2 mV}}  # short\n',
}  # fmt: skip


@pytest.mark.parametrize('form', FORMS)
def test_numbers_are_put_into_any_form_of_text(form):
    text = FORMS[form]
    edited = edited_layout(text, 'layout', tuple(values()))
    assert not edited.whole
    sensors = {one.name: one for one in read_layout(edited.text, 'edited').sensors}
    for name, gain in (('flow', 10.2e-3), ('block', 10e-3)):
        assert sensors[name].gain == pytest.approx(1.05 * gain, abs=1e-7)
        np.testing.assert_allclose(
            sensors[name].direction, [np.cos(0.03), np.sin(0.03), 0], atol=1e-4
        )
        assert sensors[name].delay == pytest.approx(31.4e-6, abs=1e-8)
        assert sensors[name].offset == pytest.approx(5.3e-3, abs=1e-6)
        assert sensors[name].noise == pytest.approx(0.0123, abs=1e-6)
        assert sensors[name].resolution == pytest.approx(3.05e-4)
    for line in text.splitlines():
        if '#' in line:
            assert line[line.index('#') :].strip() in edited.text
    # Again: the comments of before give way.
    absolute = tuple(one for one in values() if one.what is not Property.DIRECTION)
    again = edited_layout(edited.text, 'layout', absolute)
    assert not again.whole
    assert again.text.count('# calibrated:') == edited.text.count('# calibrated:')
    assert ('\r\n' in again.text) == ('\r\n' in text)


TRIAXIAL = """\
# Corner of the sled.
defaults:
  acceleration: {unit: mV, gain: 100 mV/g_0, noise: 0.5e-3 g_0}   # data sheet
sensors:
  corner:    # glued
    kind: acceleration
    body: sled
    point: [0, 0, 0]
    axes: [x, z]   # y is broken
    orientation: {x: +z, y: -x}
"""
AXES = {
    'a list': TRIAXIAL,
    'a list over lines': TRIAXIAL.replace('[x, z]', '\n      - x\n      - z'),
    'line ends of Windows': TRIAXIAL.replace('\n', '\r\n'),
    'with keys': TRIAXIAL.replace('[x, z]', '{x: {gain: 98.7 mV/g_0}, z: {}}'),
    'in lines of their own': TRIAXIAL.replace(
        '[x, z]', '\n      x:   # upwards\n        gain: 98.7 mV/g_0\n      z:'
    ),
    'all in one line': 'sensors: {corner: {kind: acceleration, body: sled, point: [0, 0, 0], '
    'unit: mV, gain: 100 mV/g_0, noise: 0.5e-3 g_0, axes: [x, z], orientation: {x: +z, y: -x}}}',
}


@pytest.mark.parametrize('form', AXES)
def test_numbers_are_put_into_triaxial_entries_of_any_form(form):
    text = AXES[form]
    before = {one.name: one for one in read_layout(text, 'layout').sensors}
    assert set(before) == {'corner_x', 'corner_z'}
    axis = np.array([1.0, 0.0, 0.0])
    found = [
        Calibrated('corner_x', Property.GAIN, before['corner_x'].gain, 10.3, 1e-3),
        Calibrated('corner_x', Property.DIRECTION, 0.0, 0.03, 1e-3, axis),
        Calibrated('corner_x', Property.NOISE, before['corner_x'].noise, 0.0061, 1e-5),
        Calibrated('corner_z', Property.DELAY, 0.0, 31.4e-6, 1e-7),
    ]
    for _ in range(2):
        edited = edited_layout(text, 'layout', tuple(found))
        assert not edited.whole
        sensors = {one.name: one for one in read_layout(edited.text, 'edited').sensors}
        assert sensors['corner_x'].gain == pytest.approx(10.3, abs=1e-4)
        assert sensors['corner_x'].noise == pytest.approx(0.0061, abs=1e-6)
        np.testing.assert_allclose(
            sensors['corner_x'].direction, [np.sin(0.03), 0, np.cos(0.03)], atol=1e-4
        )
        assert sensors['corner_x'].delay == 0
        assert sensors['corner_z'].delay == pytest.approx(31.4e-6, abs=1e-8)
        assert sensors['corner_z'].gain == before['corner_z'].gain
        np.testing.assert_array_equal(sensors['corner_z'].direction, before['corner_z'].direction)
        # 10.3 mV/(m/s^2), in the unit of the file.
        assert 'mV/g_0' in edited.text.partition('axes')[2]
        assert '101.00' in edited.text
        for line in AXES[form].splitlines():
            if '#' in line:
                assert line[line.index('#') :].strip() in edited.text
        assert '# calibrated: ' in edited.text
        assert ('\r\n' in edited.text) == ('\r\n' in text)
        # Once more into what was written, with the direction as it is now.
        text, found = edited.text, [one for one in found if one.what is not Property.DIRECTION]
    assert edited.text.count('# calibrated: ') == (
        1 if form in ('all in one line', 'with keys') else 2
    )


def test_a_sensor_that_is_no_entry_of_its_own_is_written_anew(monkeypatch):
    from identnl_ros.storage import layout_editing

    # As where one entry makes several sensors: the text has no such name under its sensors.
    monkeypatch.setattr(layout_editing, '_children', lambda node: {})
    edited = edited_layout(LAYOUT, 'layout', tuple(values()))
    assert edited.whole
    assert '# borrowed' not in edited.text
    sensors = {one.name: one for one in edited.layout.sensors}
    assert sensors['flow'].gain == pytest.approx(1.05 * 10.2e-3, rel=1e-9)
    assert sensors['probe'].gain == pytest.approx(1e6)
