# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Machine files: the shipped ones mean what they say, bad ones give one clear line."""

import math
from pathlib import Path

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
from identnl_ros.storage import layout_file, machine_file
from identnl_ros.storage.layout_file import default_layout_path
from identnl_ros.storage.machine_file import load_machine, read_machine
from identnl_ros.storage.yaml_reading import LARGEST_FILE, StrictModel
import numpy as np
import pytest

CONFIG = Path(__file__).parents[2] / 'config'
DOCS = Path(__file__).parents[2] / 'docs'
MACHINES = sorted(path for path in CONFIG.glob('*.yaml') if default_layout_path(path).exists())

MINIMAL = """\
machine: minimal
bodies:
  block:
    mass: 2 kg
    centre_of_mass: [0, 0, 0]
    inertia: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
joints:
  spring:
    kind: six_spring
    body: block
    to: ground
    point: [0, 0, 0]
    stiffness: [1e6]
  guide:
    kind: slideway
    body: block
    to: ground
    point: [0, 0, 0]
    normal: -z
    longitudinal: +x
    length: 0.4
    width: 60 mm
    exponent: 2
    preload: 1 um
    normal_stiffness: estimate
    tangential_stiffness: 10 N/um
    normal_damping: 0
    tangential_damping: 0
excitations:
  shaker:
    body: block
    point: [0, 0, 0]
    direction: +x
    amplitude: 10 N
    frequency: 40 Hz
    band: [5 Hz, 300 Hz]
"""


@pytest.fixture(scope='module')
def reference():
    return load_machine(CONFIG / 'knee_column.yaml').machine


def _part(parts, name):
    return next(part for part in parts if part.name == name)


@pytest.mark.parametrize('path', MACHINES, ids=lambda path: path.stem)
def test_shipped_machines_load_and_keep_their_text(path):
    file = load_machine(path)

    assert file.path == path
    assert file.text == path.read_text()
    assert file.machine.joints
    assert file.machine.excitations


def test_there_are_three_shipped_machines():
    assert [path.stem for path in MACHINES] == ['knee_column', 'oscillator', 'three_body']


def test_reference_machine_has_the_bodies_of_its_description(reference):
    column, knee = reference.bodies
    assert (column.name, column.mass) == ('column', Coefficient(900.0))
    assert (knee.name, knee.mass) == ('knee', Coefficient(260.0))
    np.testing.assert_array_equal(column.inertia, np.diag([190.0, 160.0, 60.0]))
    np.testing.assert_array_equal(knee.inertia, np.diag([14.0, 18.0, 12.0]))
    np.testing.assert_array_equal(column.centre_of_mass, [0.0, 0.0, 0.75])
    np.testing.assert_array_equal(knee.centre_of_mass, [0.42, 0.0, 0.70])
    assert reference.gravity is None


def test_reference_machine_stands_on_four_pads_and_a_screw(reference):
    pads = [joint for joint in reference.joints if joint.kind == 'pad']
    corners = {tuple(pad.point) for pad in pads}
    assert corners == {(x, y, 0.0) for x in (0.3, -0.3) for y in (0.3, -0.3)}
    for pad in pads:
        assert (pad.body, pad.other_body) == ('column', 'ground')
        assert [one.value for one in pad.stiffness] == [1.2e7, 1.2e7, 2.5e7]
        assert [one.value for one in pad.damping] == [6e3, 6e3, 1.2e4]
        np.testing.assert_array_equal(pad.axes, np.eye(3))
    screw = _part(reference.joints, 'screw_5')
    assert (screw.body, screw.other_body) == ('knee', 'column')
    np.testing.assert_array_equal(screw.point, [0.35, 0.0, 0.45])
    np.testing.assert_array_equal(screw.axes[:, 0], [0.0, 0.0, 1.0])
    assert [one.value for one in (*screw.stiffness, *screw.damping)] == [1.2e8, 8e3]


ROOT_HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ('number', 'point', 'normal', 'preload', 'parameters'),
    [
        (6, (0.22, -0.17, 0.62), (-1, 0, 0), 6e-7, (3.8e15, 1.5e8, 3.6e7, 5.5e7)),
        (7, (0.22, 0.17, 0.62), (-1, 0, 0), 6e-7, (3.7e15, 1.5e8, 3.5e7, 5.5e7)),
        (8, (0.19, -0.19, 0.80), (ROOT_HALF, ROOT_HALF, 0), 6e-7, (3.4e15, 1.3e8, 2.7e7, 2.1e6)),
        (
            9,
            (0.19, 0.19, 0.80),
            (ROOT_HALF, -ROOT_HALF, 0),
            6e-7 * math.sqrt(340 / 660),
            (6.6e15, 2.7e8, 2.1e7, 7.7e7),
        ),
    ],
)
def test_reference_machine_has_the_slideways_of_the_paper(
    reference, number, point, normal, preload, parameters
):
    slideway = _part(reference.joints, f'slideway_{number}')

    assert (slideway.body, slideway.other_body) == ('knee', 'column')
    np.testing.assert_array_equal(slideway.point, point)
    np.testing.assert_allclose(slideway.normal, normal, atol=1e-15)
    np.testing.assert_array_equal(slideway.longitudinal, [0, 0, 1])
    assert (slideway.length, slideway.width) == (0.4, 0.06)
    assert slideway.preload == Coefficient(pytest.approx(preload, rel=1e-14))
    assert slideway.exponent == Coefficient(2.0)
    assert (slideway.coupled, slideway.damping_frequency) == (False, 40)
    assert parameters == tuple(
        coefficient.value
        for coefficient in (
            slideway.normal_stiffness,
            slideway.tangential_stiffness,
            slideway.normal_damping,
            slideway.tangential_damping,
        )
    )


def test_sixteen_slideway_parameters_of_the_reference_machine_are_estimated(reference):
    estimated = {
        f'{joint.name}.{term.key}'
        for joint in reference.joints
        for term in joint.terms()
        if term.coefficient.estimated
    }
    assert len(estimated) == 16
    assert {name.split('.')[0] for name in estimated} == {f'slideway_{i}' for i in range(6, 10)}


def test_exciter_of_the_reference_machine_pushes_along_150_and_76_degrees(reference):
    (exciter,) = reference.excitations
    alpha, beta = math.radians(150), math.radians(76)

    np.testing.assert_allclose(
        exciter.direction,
        [math.cos(alpha) * math.sin(beta), math.sin(alpha) * math.sin(beta), math.cos(beta)],
        rtol=1e-14,
    )
    assert (exciter.body, exciter.reaction_body) == ('knee', 'column')
    np.testing.assert_array_equal(exciter.point, [0.6, 0.1, 0.85])
    np.testing.assert_array_equal(exciter.reaction_point, [0.0, 0.0, 1.4])
    assert (exciter.amplitude, exciter.frequency, exciter.band) == (1000.0, 40.0, (5.0, 300.0))


def test_principal_axes_of_the_three_bodies_are_well_off_those_of_the_machine():
    for body in load_machine(CONFIG / 'three_body.yaml').machine.bodies:
        _, axes = np.linalg.eigh(body.inertia)
        nearest = np.degrees(np.arccos(np.abs(axes).max(axis=0)))
        assert nearest.max() > 20


def test_three_body_machine_has_unknowns_of_every_sort():
    machine = load_machine(CONFIG / 'three_body.yaml').machine

    np.testing.assert_array_equal(machine.gravity, [0.0, 0.0, -9.80665])
    assert _part(machine.bodies, 'table').mass == Coefficient(180.0, True)
    assert _part(machine.forces, 'energy_chain').force == Coefficient(120.0, True)
    assert _part(machine.joints, 'flange').stiffness[5] == Coefficient(1.1e8, True)
    assert _part(machine.joints, 'screw').damping == (Coefficient(9e3, True),)
    vee = _part(machine.joints, 'vee_left')
    assert (vee.coupled, vee.exponent, vee.damping_frequency) == (True, Coefficient(1.8), None)
    assert vee.normal_damping == Coefficient(4e4, True)
    np.testing.assert_array_equal(
        _part(machine.joints, 'flange').axes, [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    )


def test_oscillator_can_only_move_along_x_and_resonates_near_68_hertz():
    machine = load_machine(CONFIG / 'oscillator.yaml').machine
    (body,), (spring,) = machine.bodies, machine.joints

    assert body.degrees_of_freedom == ('translation_1',)
    frequency = math.sqrt(spring.stiffness[0].value / body.mass.value) / (2 * math.pi)
    assert frequency == pytest.approx(68.6, abs=0.1)
    assert all(term.coefficient.estimated for term in spring.terms())


def test_bare_word_estimate_leaves_no_nominal_value():
    guide = _part(read_machine(MINIMAL, 'text').joints, 'guide')

    assert guide.normal_stiffness.estimated
    assert math.isnan(guide.normal_stiffness.value)


def test_unit_of_normal_stiffness_follows_from_the_exponent():
    text = MINIMAL.replace('exponent: 2', 'exponent: 1.5')
    text = text.replace('normal_stiffness: estimate', 'normal_stiffness: 2 N/um^1.5')

    assert _part(read_machine(text, 'text').joints, 'guide').normal_stiffness.value == 2e9


SECOND_GUIDE = """\
  other:
    kind: slideway
    body: block
    to: ground
    point: [0.1, 0, 0]
    normal: -z
    longitudinal: +x
    length: 0.4
    width: 60 mm
    exponent: {same_as: guide.exponent, times: 0.75}
    preload: {same_as: guide.preload}
    normal_stiffness: 2 N/um^1.5
    tangential_stiffness: {same_as: guide.tangential_stiffness, times: 1.2}
    normal_damping: 0
    tangential_damping: 0
excitations:
"""


def test_preload_and_exponent_may_be_estimated():
    text = MINIMAL.replace('exponent: 2', 'exponent: {estimate: 1.5}')
    text = text.replace('preload: 1 um', 'preload: {estimate: 0.6 um}')
    text = text.replace('stiffness: estimate', 'stiffness: {estimate: 2 N/um^1.5}')
    guide = _part(read_machine(text, 'text').joints, 'guide')

    assert guide.exponent == Coefficient(1.5, estimated=True)
    assert guide.preload == Coefficient(6e-7, estimated=True)
    assert guide.normal_stiffness == Coefficient(2e9, estimated=True)


def test_every_number_may_follow_another_one():
    text = MINIMAL.replace('excitations:\n', SECOND_GUIDE)
    text = text.replace('[1e6]', '[1e6, {same_as: spring.stiffness_1, times: 3}]')
    machine = read_machine(text, 'text')
    other = _part(machine.joints, 'other')

    assert other.exponent == Coefficient(1.5, tie=Tie('guide.exponent', 0.75))
    assert other.preload == Coefficient(1e-6, tie=Tie('guide.preload'))
    assert other.tangential_stiffness.tie == Tie('guide.tangential_stiffness', 1.2)
    assert _part(machine.joints, 'spring').stiffness[1].tie == Tie('spring.stiffness_1', 3.0)


def test_unit_of_a_contact_stiffness_follows_from_a_tied_exponent():
    text = MINIMAL.replace('excitations:\n', SECOND_GUIDE)

    assert _part(read_machine(text, 'text').joints, 'other').normal_stiffness.value == 2e9
    with pytest.raises(MachineError) as caught:
        read_machine(text.replace('2 N/um^1.5', '2 N/um^2'), 'bad.yaml')
    assert str(caught.value) == (
        'bad.yaml:40: joints.other.normal_stiffness: found "2 N/um^2", expected a contact '
        'stiffness such as "380 daN/um^1.5"'
    )


@pytest.mark.parametrize('number', ['2', '2.0', '2e0', '+2.', '0.2E1', '"2"', '2 # comment'])
def test_every_way_to_write_a_number_is_understood(number):
    machine = read_machine(MINIMAL.replace('mass: 2 kg', f'mass: {number}'), 'text')

    assert machine.bodies[0].mass == Coefficient(2.0)


def test_weight_acts_downwards_unless_gravity_says_otherwise():
    computed = read_machine(f'rest: computed\n{MINIMAL}', 'text')
    tilted = read_machine(f'rest: computed\ngravity: [1 g_0, 0, 0]\n{MINIMAL}', 'text')

    np.testing.assert_array_equal(computed.gravity, [0, 0, -9.80665])
    np.testing.assert_array_equal(tilted.gravity, [9.80665, 0, 0])


BAD = [
    # what to replace, by what, line, words of the error
    ('mass: 2 kg', 'mass: 900 m', 4, 'bodies.block.mass: found "900 m", expected a mass such as'),
    ('mass: 2 kg', 'mass:', 4, 'bodies.block.mass: found nothing, expected a mass'),
    ('    mass: 2 kg\n', '', 3, 'bodies.block.mass: found nothing, expected a mass'),
    ('mass: 2 kg', 'mas: 2 kg', 4, 'bodies.block.mas: unknown key; did you mean "mass"?'),
    ('mass: 2 kg', 'mas: 2 kg', 4, 'allowed here: mass, centre_of_mass, inertia'),
    ('mass: 2 kg', 'mass: nan', 4, 'found "nan"'),
    ('mass: 2 kg', 'mass: .inf', 4, 'found ".inf"'),
    ('mass: 2 kg', 'mass: true', 4, 'found "true"'),
    ('mass: 2 kg', 'mass: abc', 4, 'found "abc"'),
    ('mass: 2 kg', 'mass: [2 kg]', 4, 'found a list of 1'),
    ('mass: 2 kg', 'mass: -2 kg', 3, 'body block: mass is -2.0 kg'),
    ('mass: 2 kg', 'mass: {estimate: 2 m}', 4, 'bodies.block.mass: found "2 m"'),
    ('centre_of_mass: [0, 0, 0]', 'centre_of_mass: [0, 0]', 5, 'found a list of 2'),
    ('centre_of_mass: [0, 0, 0]', 'centre_of_mass: [0, 0, estimate]', 5, 'must be known'),
    ('[0, 1, 0]', '[0, -1, 0]', 3, 'inertia is not positive definite'),
    ('[0, 1, 0]', '[0.5, 1, 0]', 3, 'inertia is not symmetric'),
    ('[0, 1, 0]', '[1, 0]', 6, 'bodies.block.inertia: found a list of 2'),
    ('[0, 1, 0], ', '', 6, 'expected three rows of three numbers'),
    ('    inertia: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n', '', 3, 'inertia is missing'),
    ('kind: six_spring', 'kind: spring', 9, 'joints.spring.kind: found "spring", expected "pad"'),
    ('    kind: six_spring\n', '', 8, 'joints.spring.kind: found nothing, expected "pad"'),
    ('to: ground', 'to: blok', 8, 'joint spring: attached to "blok", which is no body'),
    ('to: ground', 'to: block', 8, 'joint spring: both ends'),
    ('    to: ground\n', '', 8, 'joints.spring.to: found nothing, expected a name'),
    ('[1e6]', '[1e6, 1 kg]', 13, 'joints.spring.stiffness: number 2: found "1 kg"'),
    ('[1e6]', '[1, 1, 1, 1 N/m]', 13, 'number 4: found "1 N/m", expected a rotational'),
    ('[1e6]', '[1, 1, 1, 1, 1, 1, 1]', 13, 'found a list of 7, expected a list of 1 to 6'),
    ('[1e6]', '1e6', 13, 'found "1e6", expected a list'),
    ('[1e6]', '[1e6]\n    axis_1: +x', 8, 'axis_1 and axis_2 belong together'),
    ('normal: -z', 'normal: -w', 19, 'joints.guide.normal: found "-w"'),
    ('normal: -z', 'normal: +x', 14, 'must be perpendicular'),
    ('length: 0.4', 'length: 0', 14, 'length is 0.0'),
    ('exponent: 2', 'exponent: estimate', 23, 'needs a start; expected {estimate: start} with a'),
    ('preload: 1 um', 'preload: estimate', 24, 'needs a start; expected {estimate: start} with a'),
    ('preload: 1 um', 'preload: {estimate: -1 um}', 14, 'preload is -1e-06 m'),
    ('exponent: 2', 'exponent: {estimate: 0}', 14, 'exponent is 0.0'),
    ('mass: 2 kg', 'mass: {same_as: spring}', 4, 'same_as: found "spring", expected the name'),
    ('mass: 2 kg', 'mass: {same_as: [a.b]}', 4, 'same_as: found a list of 1'),
    ('mass: 2 kg', 'mass: {times: 2}', 4, 'or {same_as: another parameter, times: factor}'),
    ('mass: 2 kg', 'mass: {same_as: a.b, times: 0}', 4, 'times: found "0", expected a positive'),
    ('mass: 2 kg', 'mass: {same_as: a.b, times: 1 kg}', 4, 'times: found "1 kg"'),
    ('mass: 2 kg', 'mass: {same_as: a.b, estimate: 1}', 4, 'found {same_as, estimate}, expected'),
    ('mass: 2 kg', 'mass: {same_as: block.mas}', 3, 'body block: mass is the same as "block.mas"'),
    ('mass: 2 kg', 'mass: {same_as: block.mass}', 3, 'is the same as itself; give it a value'),
    ('length: 0.4', 'length: {same_as: guide.width}', 21, 'cannot be tied to another one'),
    (
        'tangential_stiffness: 10 N/um',
        'tangential_stiffness: {same_as: spring.stifness}',
        14,
        'did you mean "spring.stiffness"?',
    ),
    (
        'normal_stiffness: estimate',
        'normal_stiffness: {same_as: spring.stiffness}',
        14,
        'guide: normal_stiffness [N/m^2] is the same as "spring.stiffness" [N/m], but the units',
    ),
    ('exponent: 2', 'exponent: {same_as: guide.preload}', 14, 'but the units differ'),
    ('exponent: 2', 'exponent: {same_as: guide.exponent}', 14, 'is the same as itself'),
    ('preload: 1 um', 'preload: -1 um', 14, 'preload is -1e-06 m'),
    ('preload: 1 um', 'preload: 1 um\n    law: stiff', 25, 'expected "decoupled" or "coupled"'),
    ('preload: 1 um', 'gauss_points: 1.5', 24, 'found "1.5", expected a whole number'),
    (
        'normal_stiffness: estimate',
        'normal_stiffness: 1 N/m',
        25,
        'found "1 N/m", expected a contact stiffness such as "380 daN/um^2"',
    ),
    ('    normal_damping: 0\n', '', 14, 'give either normal_damping and tangential_damping'),
    ('normal_damping: 0', 'damping_frequency: 40', 14, 'or normal_hysteretic_damping'),
    ('frequency: 40 Hz', 'frequency: 251 rad/s', 35, 'an angular velocity'),
    ('[5 Hz, 300 Hz]', '[300 Hz, 5 Hz]', 30, 'the lower one first'),
    ('[5 Hz, 300 Hz]', '5 Hz', 36, 'found "5 Hz", expected a list of two'),
    ('  block:\n', '  the block:\n', 3, 'expected a name'),
    ('  guide:\n', '  spring:\n', 14, 'the key "spring" is here twice, first in line 8'),
    ('  guide:\n', '  block:\n', None, 'two parts are called block'),
    ('  block:\n', '  ground:\n', 3, '"ground" is the inertial frame'),
    ('machine: minimal', 'machine: minimal\nrest: no', 2, 'expected "locked_in" or "computed"'),
    (
        'machine: minimal',
        'machine: minimal\ngravity: [0, 0, -9]',
        2,
        'gravity: found a value',
    ),
    ('machine: minimal', 'machin: minimal', 1, 'machin: unknown key; did you mean "machine"?'),
    ('    mass', '\tmass', 4, 'found a tab; indent with spaces'),
    ('mass: 2 kg', 'mass: &m 2 kg\n    x: *m', 5, 'aliases'),
    ('mass: 2 kg', 'mass: !!python/name:os.system', 4, 'tags'),
    ('mass: 2 kg', 'mass: 2: kg', 4, 'a second ":"'),
    ('mass: 2 kg', 'mass: "2 kg', 37, 'unexpected end'),
]


@pytest.mark.parametrize(('old', 'new', 'line', 'words'), BAD, ids=[f'{b[1]!r}' for b in BAD])
def test_bad_file_gives_one_line_with_place_and_cause(old, new, line, words):
    assert old in MINIMAL

    with pytest.raises(MachineError) as caught:
        read_machine(MINIMAL.replace(old, new, 1), 'bad.yaml')

    message = str(caught.value)
    assert message.startswith('bad.yaml: ' if line is None else f'bad.yaml:{line}: ')
    assert words in message
    assert '\n' not in message


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'found nothing'),
        ('# only a comment\n', 'found nothing'),
        ('- a\n- b\n', 'found a list of 2, expected keys and values'),
        ('just words', 'found "just words"'),
        ('machine: m', 'bodies: found nothing'),
        ('machine: m\nbodies: {}\njoints: {}', 'no bodies'),
        ('machine: m\nbodies: [a]\njoints: {}', 'bodies: found a list of 1'),
        ('\x00\x07', 'is not YAML'),
        ('[' * 10000, 'nested deeper'),
        ('a: ' * 10000, 'a second ":"'),
        ('a' * (LARGEST_FILE + 1), 'larger than'),
        ('a: &a [x]\nb: &b [*a, *a]\nc: &c [*b, *b]', 'aliases'),
        ('{"a\\nb": 1}', 'a b: unknown key'),
    ],
)
def test_text_that_is_no_machine_file_gives_a_line_for_each_problem(text, words):
    with pytest.raises(MachineError) as caught:
        read_machine(text, 'bad.yaml')

    assert words in str(caught.value)
    assert all(line.startswith('bad.yaml') for line in str(caught.value).splitlines())


def _models(module):
    return [
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, StrictModel)
    ]


@pytest.mark.parametrize(
    ('module', 'page'), [(machine_file, 'machine_file.md'), (layout_file, 'layout_file.md')]
)
def test_reference_page_explains_every_key(module, page):
    text = (DOCS / page).read_text()
    keys = {key for model in _models(module) for key in model.model_fields}

    assert len(keys) > 10
    assert not {key for key in keys if f'`{key}`' not in text and f'`{key}:' not in text}


def test_examples_of_the_reference_pages_load():
    machine_text, layout_text = (
        (DOCS / page).read_text().split('```yaml')[1].split('```')[0]
        for page in ('machine_file.md', 'layout_file.md')
    )

    machine = machine_file.read_machine(machine_text, 'machine_file.md')
    layout = layout_file.read_layout(layout_text, 'layout_file.md')

    assert {sensor.body for sensor in layout.sensors if sensor.body} == {machine.bodies[0].name}


def test_missing_file_suggests_its_neighbour():
    with pytest.raises(MachineError, match=r'no such file; did you mean .*knee_column\.yaml'):
        load_machine(CONFIG / 'knee_colum.yaml')


def test_folder_binary_and_huge_files_are_refused(tmp_path):
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(bytes(range(256)))
    huge = tmp_path / 'huge.yaml'
    huge.write_bytes(b'#' * (LARGEST_FILE + 1))

    with pytest.raises(MachineError, match='is a folder'):
        load_machine(tmp_path)
    with pytest.raises(MachineError, match='not a text file'):
        load_machine(binary)
    with pytest.raises(MachineError, match='larger than'):
        load_machine(huge)


def test_byte_order_mark_and_windows_line_ends_do_no_harm(tmp_path):
    path = tmp_path / 'windows.yaml'
    path.write_bytes(b'\xef\xbb\xbf' + MINIMAL.replace('\n', '\r\n').encode())

    assert load_machine(path).machine.name == 'minimal'
