# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Elements in machine files: what they mean, and one clear line where they are wrong."""

from pathlib import Path

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
from identnl_ros.storage import machine_elements
from identnl_ros.storage.machine_file import read_machine
from identnl_ros.storage.yaml_reading import StrictModel
import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / 'docs'

MACHINE = """\
machine: rubbing
bodies:
  block:
    mass: 2 kg
    centre_of_mass: [0, 0, 0]
    inertia: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
joints:
  rubbing:
    kind: coulomb_friction
    at: guide
    axis: 2
    force: {estimate: 4.1 daN}
    transition_velocity: 10 um/s
  sticking:
    kind: stribeck_friction
    at: guide
    axis: 2
    force: {estimate: 20 N}
    transition_velocity: {same_as: rubbing.transition_velocity}
    stribeck_velocity: 1 mm/s
  oil:
    kind: quadratic_damping
    at: guide
    axis: 5
    damping: 30 N*m*s^2/rad^2
  play:
    kind: backlash
    at: guide
    axis: 3
    stiffness: 3 N/um
    gap: {estimate: 4 um}
  stop:
    kind: bilinear_stiffness
    at: guide
    axis: 1
    stiffness: 5 N/um
  warming:
    kind: drifting_stiffness
    at: guide
    axis: 5
    stiffness_rate: {estimate: -3 kN*m/rad/s}
  loop:
    kind: hysteresis
    at: guide
    axis: 6
    stiffness: estimate
    limit: 20 urad
    exponent: 3
  more:
    kind: six_spring
    at: guide
    stiffness: [0, 1 N/um]
    cubic_stiffness: [0, {estimate: 2 N/um^3}]
  rod:
    kind: screw
    at: guide
    stiffness: 10 N/um
    damping: 0
  guide:
    kind: pad
    body: block
    to: ground
    point: [0.1, 0, 0.2]
    axis_1: +z
    axis_2: +x
    stiffness: [10 N/um, 10 N/um, 10 N/um]
"""


def joints_of(text=MACHINE):
    return {joint.name: joint for joint in read_machine(text, 'text').joints}


def test_elements_take_their_place_from_the_joint_they_name():
    joints = joints_of()
    assert list(joints) == [
        'rubbing', 'sticking', 'oil', 'play', 'stop', 'warming', 'loop', 'more', 'rod', 'guide',
    ]  # fmt: skip
    for joint in joints.values():
        assert (joint.body, joint.other_body) == ('block', 'ground')
        np.testing.assert_array_equal(joint.point, [0.1, 0, 0.2])
        np.testing.assert_array_equal(joint.axes[:, :2], [[0, 1], [0, 0], [1, 0]])
    assert joints['more'].kind == 'six_spring'


def test_numbers_of_elements_are_read_with_their_units():
    joints = joints_of()
    assert joints['rubbing'].coefficient == Coefficient(41.0, estimated=True)
    assert joints['rubbing'].numbers == {'transition_velocity': Coefficient(1e-5)}
    assert joints['sticking'].numbers == {
        'transition_velocity': Coefficient(1e-5, tie=Tie('rubbing.transition_velocity')),
        'stribeck_velocity': Coefficient(1e-3),
    }
    assert joints['oil'].coefficient == Coefficient(30.0)
    assert joints['play'].numbers == {'gap': Coefficient(4e-6, estimated=True)}
    assert joints['stop'].numbers == {'gap': Coefficient(0.0)}
    assert joints['loop'].numbers == {'limit': Coefficient(2e-5), 'exponent': Coefficient(3.0)}
    assert [one.value for one in joints['more'].cubic_stiffness] == [0.0, 2e18]
    assert np.isnan(joints['loop'].coefficient.value)


def test_unknowns_of_elements_have_names_and_units():
    model = assemble(read_machine(MACHINE, 'text'))
    assert [(one.name, one.unit, one.inner) for one in model.parameters if one.estimated] == [
        ('rubbing.force', 'N', False),
        ('sticking.force', 'N', False),
        ('play.gap', 'm', True),
        ('warming.stiffness_rate', 'N*m/s', False),
        ('loop.stiffness', 'N*m', False),
        ('more.cubic_stiffness_2', 'N/m^3', False),
    ]


BAD = [
    ('at: guide', 'at: guid', 'joint rubbing: at: found "guid", which is no joint of this machine;'
     ' did you mean "guide"?'),
    ('at: guide', 'at: oil', 'joint rubbing: at: found "oil", which takes its own place from '
     '"guide"; name that joint'),
    ('    at: guide\n', '', 'joints.rubbing.at: found nothing, expected a name'),
    ('axis: 2', 'axis: 7', 'bad.yaml:11: joints.rubbing.axis: found "7", expected 1, 2 or 3'),
    ('axis: 2', 'axis: x', 'joints.rubbing.axis: found "x"'),
    ('    axis: 2\n', '', 'joints.rubbing.axis: found nothing'),
    ('4.1 daN', '4.1 daN/um', 'bad.yaml:12: joints.rubbing.force: found "4.1 daN/um", expected a '
     'force such as "40 N"'),
    ('    force: {estimate: 4.1 daN}\n', '', 'joints.rubbing.force: found nothing, expected a '
     'force'),
    ('10 um/s', '10 um', 'joints.rubbing.transition_velocity: found "10 um", expected a velocity'),
    ('10 um/s', '0', 'joint rubbing: transition_velocity is 0.0, expected more than 0'),
    ('10 um/s', 'estimate', 'joints.rubbing.transition_velocity: found "estimate", but the '
     'search for this number needs a start'),
    ('    transition_velocity: 10 um/s\n', '', 'joints.rubbing.transition_velocity: found '
     'nothing'),
    ('axis: 2\n    force', 'axis: 4\n    force', 'joints.rubbing.force: found "4.1 daN", '
     'expected a moment such as'),
    ('axis: 2\n    force: {estimate: 4.1 daN}\n    transition_velocity: 10 um/s',
     'axis: 5\n    force: 1 N*m\n    transition_velocity: 1 Hz',
     'found "1 Hz", a frequency instead of an angular velocity (multiply by 2 pi), expected an '
     'angular velocity such as'),
    ('limit: 20 urad', 'limit: 20 um', 'joints.loop.limit: found "20 um", expected an angle'),
    ('limit: 20 urad', 'limit: {estimate: 20 urad}', 'joints.loop.limit: found keys and values, '
     'but this number must be known'),
    ('exponent: 3', 'exponent: 0.5', 'joint loop: exponent is 0.5, expected at least 1'),
    ('gap: {estimate: 4 um}', 'gap: -4 um', 'joint play: gap is'),
    ('gap: {estimate', 'gop: {estimate', 'joints.play.gop: unknown key; did you mean "gap"?'),
    ('kind: six_spring\n', 'kind: six_spring\n    body: block\n', 'joints.more.body: comes from '
     'the joint that "at" names; leave it out'),
    ('kind: screw\n', 'kind: screw\n    axis: +x\n', 'joints.rod.axis: comes from the joint'),
    ('    body: block\n    to: ground\n    point', '    to: ground\n    point',
     'joints.guide.body: found nothing, expected a name'),
    ('kind: coulomb_friction', 'kind: friction', 'joints.rubbing.kind: found "friction", '
     'expected "pad", "six_spring", "screw", "slideway", "coulomb_friction", '),
]  # fmt: skip


@pytest.mark.parametrize(('old', 'new', 'words'), BAD)
def test_what_is_wrong_is_said_in_one_line(old, new, words):
    assert old in MACHINE
    with pytest.raises(MachineError) as caught:
        read_machine(MACHINE.replace(old, new, 1), 'bad.yaml')
    assert words in str(caught.value)
    assert str(caught.value).startswith('bad.yaml:')


def test_reference_page_explains_every_element():
    text = (DOCS / 'machine_file.md').read_text()
    models = [
        one for one in vars(machine_elements).values()
        if isinstance(one, type) and issubclass(one, StrictModel) and one is not StrictModel
    ]  # fmt: skip
    for model in models:
        for key in model.model_fields:
            assert f'`{key}' in text
    for kind in machine_elements.ELEMENT_KINDS:
        assert f'`{kind}`' in text
