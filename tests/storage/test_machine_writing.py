# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Machines written as files: read again, they are the same."""

from dataclasses import fields, is_dataclass, replace
from enum import Enum
from pathlib import Path

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
from identnl_ros.core.mechanics.elements import ELEMENT_KINDS
from identnl_ros.core.mechanics.joints import SpringDamper
from identnl_ros.core.mechanics.slideway import REFERENCE_DEFORMATION
from identnl_ros.storage.layout_file import default_layout_path
from identnl_ros.storage.machine_file import load_machine, read_machine
from identnl_ros.storage.machine_writing import machine_text
from identnl_ros.storage.yaml_writing import direction, number
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.core.element_cases import CASES, element
from tests.core.machines import known, oscillator, skew_machine, slideway, turned, unknown

CONFIG = Path(__file__).parents[2] / 'config'
MACHINES = sorted(path for path in CONFIG.glob('*.yaml') if default_layout_path(path).exists())

EVERYTHING = """\
machine: everything
rest: computed
gravity: [0, 0.3, -9.7]
bodies:
  block:
    mass: estimate
    centre_of_mass: [0, 0, 0.1]
    inertia: [[1, 0.1, 0], [0.1, 1, 0], [0, 0, 1]]
    degrees_of_freedom: [translation_1, translation_3, rotation_2]
joints:
  rubbing: {kind: coulomb_friction, at: guide, axis: 2, force: {estimate: 4.1 daN},
            transition_velocity: {estimate: 10 um/s}}
  sticking: {kind: stribeck_friction, at: guide, axis: 2, force: {estimate: 20 N},
             transition_velocity: {same_as: rubbing.transition_velocity}, stribeck_velocity: 1e-3}
  oil: {kind: quadratic_damping, at: guide, axis: 5, damping: 30}
  play: {kind: backlash, at: pressed, axis: 3, stiffness: 3 N/um, gap: {estimate: 4 um}}
  stop: {kind: bilinear_stiffness, at: rod, axis: 1, stiffness: 5 N/um, gap: -1 um}
  warm: {kind: drifting_stiffness, at: guide, axis: 1, stiffness_rate: {estimate: -3 N/um/s}}
  loop: {kind: hysteresis, at: guide, axis: 6, stiffness: estimate, limit: 20 urad, exponent: 3}
  more: {kind: six_spring, at: guide, stiffness: [0, 1 N/um],
         cubic_stiffness: [0, {estimate: 2 N/um^3}]}
  bar: {kind: screw, at: guide, stiffness: 10 N/um, damping: 0}
  rod: {kind: screw, body: block, to: ground, point: [0, 0, 1], axis: [1, 2, 3], stiffness: 1e7,
        damping: {same_as: guide.damping, times: 1.7}}
  guide: {kind: pad, body: block, to: ground, point: [0.1, 0, 0.2], axis_1: [1, 1, 1],
          axis_2: [1, -1, 0], stiffness: [1e7, {estimate: 2e7}, estimate], damping: [300]}
  pressed:
    kind: slideway
    body: block
    to: ground
    point: [0.3, 0.1, 0]
    normal: [0, 1, -3]
    longitudinal: +x
    length: 0.3
    width: 0.1
    law: coupled
    exponent: {estimate: 2}
    preload: {estimate: 0.6 um}
    normal_stiffness: {estimate: 4e13}
    tangential_stiffness: estimate
    normal_damping: 1e4
    tangential_damping: {same_as: pressed.normal_damping, times: 0.3}
    gauss_points: 3
  tied:
    kind: slideway
    body: block
    to: ground
    point: [-0.3, 0.1, 0]
    normal: -z
    longitudinal: [1, 0.7, 0]
    length: 0.3
    width: 0.1
    exponent: {same_as: pressed.exponent}
    preload: {same_as: pressed.preload, times: 0.7}
    normal_stiffness: {same_as: pressed.normal_stiffness, times: 1.2}
    tangential_stiffness: 1e8
    normal_hysteretic_damping: 1e7
    tangential_hysteretic_damping: {same_as: tied.normal_hysteretic_damping}
    damping_frequency: 37.3
forces:
  hose: {body: block, point: [0, 0, 0], direction: [0.3, 0.1, 0.7], force: {estimate: 5}}
  pump: {kind: periodic_force, body: block, point: [0, 0, 0.1], direction: [0.3, 0.1, 0.7],
         cosine: {estimate: 3}, sine: 1, frequency: {estimate: 49.6}}
  twice: {kind: periodic_moment, body: block, direction: +z, cosine: {same_as: twice.sine},
          sine: estimate, frequency: {same_as: pump.frequency, times: 2}}
excitations:
  shaker: {body: block, point: [0, 0, 0.1234567890123456], direction: [0.3, 0.4, 0.11],
           amplitude: 10, frequency: 40, band: [5, 300]}
"""


def written(machine, values=(), headline='written'):
    return read_machine(machine_text(machine, dict(values), headline), 'written')


def assert_same(first, second, close=0.0):
    """Compare all that two objects are made of."""
    assert type(first) is type(second)
    if is_dataclass(first) and not isinstance(first, Enum):
        for field in fields(first):
            assert_same(getattr(first, field.name), getattr(second, field.name), close)
    elif isinstance(first, dict):
        assert list(first) == list(second)
        assert_same(tuple(first.values()), tuple(second.values()), close)
    elif isinstance(first, tuple):
        assert len(first) == len(second)
        for one, other in zip(first, second, strict=True):
            assert_same(one, other, close)
    elif isinstance(first, float | np.ndarray):
        np.testing.assert_allclose(first, second, rtol=close, atol=close)
    else:
        assert first == second


def values_of(model):
    return {one.name: one.value for one in model.parameters}


@pytest.mark.parametrize('path', MACHINES, ids=lambda path: path.stem)
def test_shipped_machines_come_back(path):
    machine = load_machine(path).machine
    again = written(machine)
    assert_same(machine, again)
    assert_same(assemble(machine), assemble(again))


def test_all_that_a_file_can_say_comes_back():
    machine = read_machine(EVERYTHING, 'everything')
    assert {joint.kind for joint in machine.joints} >= {
        'pad', 'screw', 'six_spring', 'slideway', *ELEMENT_KINDS,
    }  # fmt: skip
    # A slideway normalises its directions whenever it is copied: the last bit may differ.
    again = written(machine)
    assert_same(machine, again, close=1e-15)
    assert_same(assemble(machine), assemble(again), close=1e-14)


def test_written_text_is_short_and_in_the_usual_order():
    text = machine_text(read_machine(EVERYTHING, 'everything'), {}, 'One\n\nthree')
    assert text.startswith('# One\n#\n# three\n\nmachine: everything\nrest: computed\ngravity: [')
    assert '\n\nbodies:\n  block:\n    mass: estimate\n' in text
    assert '    transition_velocity: {same_as: rubbing.transition_velocity}\n' in text
    assert '    stiffness: [1e7, {estimate: 2e7}, estimate]\n' in text
    assert '      - [1, 0.1, 0]\n' in text
    assert machine_text(read_machine(EVERYTHING, ''), {}, '').startswith('machine: everything\n')


def test_found_values_replace_estimated_ones_only():
    machine = load_machine(CONFIG / 'three_body.yaml').machine
    model = assemble(machine)
    generator = np.random.default_rng(3)
    found = {one.name: one.value * generator.uniform(0.5, 2) for one in model.parameters}
    left = 'flat.tangential_stiffness'
    found[left] = float('nan')

    again = assemble(written(machine, found))

    for before, after in zip(model.parameters, again.parameters, strict=True):
        new = before.estimated and before.name != left
        assert after.value == (found[before.name] if new else before.value)
        assert after == replace(before, value=after.value)


def test_a_value_fills_what_had_none():
    machine = read_machine(EVERYTHING, 'everything')
    found = {'block.mass': 3.1, 'loop.stiffness': 1e3, 'guide.stiffness_3': 7.0}
    values = values_of(assemble(written(machine, found)))
    assert {name: values[name] for name in found} == found
    assert np.isnan(values['pressed.tangential_stiffness'])


def normal_force(model, name, deformation):
    """Force of the springs of a slideway along its lines, all deformed alike."""
    return sum(
        model.parameters[term.parameter].value
        * term.factor
        * term.law.force(np.array([deformation]), np.zeros(1))[0]
        for term in model.terms
        if model.line_joints[term.line] == name
        and model.parameters[term.parameter].name.endswith('normal_stiffness')
    )


@pytest.mark.parametrize('exponent', [1.7, 2.0, 2.3])
def test_another_exponent_leaves_the_forces(exponent):
    machine = read_machine(EVERYTHING, 'everything')
    found = {'pressed.exponent': exponent, 'pressed.normal_stiffness': 5e13}
    model = assemble(machine)
    values = [found.get(one.name, one.value) for one in model.parameters]
    model = model.with_values(np.array(values))

    again = assemble(written(machine, found))

    assert again.machine.joints[-1].normal_stiffness.tie == Tie('pressed.normal_stiffness', 1.2)
    np.testing.assert_allclose(
        values_of(again)['pressed.normal_stiffness'],
        5e13 * REFERENCE_DEFORMATION ** (2 - exponent),
        rtol=1e-12,
    )
    for name in ('pressed', 'tied'):
        for deformation in (0.3e-6, 2e-6):
            expected = normal_force(model, name, deformation)
            np.testing.assert_allclose(
                normal_force(again, name, deformation), expected, rtol=1e-10
            )


def test_a_tie_between_different_exponents_is_written_out():
    text = EVERYTHING.replace('exponent: {same_as: pressed.exponent}', 'exponent: 2')
    machine = read_machine(text, 'everything')
    found = {'pressed.exponent': 1.8, 'pressed.normal_stiffness': 5e13}

    new = machine_text(machine, found, 'written')

    assert new.startswith(
        '# written\n'
        '# tied.normal_stiffness was tied to pressed.normal_stiffness; their units differ now.\n'
    )
    tied = read_machine(new, 'new').joints[-1]
    assert tied.normal_stiffness == Coefficient(1.2 * 5e13, estimated=True)
    assert tied.preload.tie == Tie('pressed.preload', 0.7)


@pytest.mark.parametrize('seed', range(5))
def test_machines_in_any_frame_come_back(seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    machine = turned(skew_machine(gravity=np.array([0.1, 0.2, -9.0])), rotation)
    # Third axes of spring joints are computed from the others: the last bit may differ.
    again = written(machine)
    assert_same(machine, again, close=1e-14)
    assert_same(assemble(machine), assemble(again), close=1e-12)


@pytest.mark.parametrize('kind', CASES)
def test_elements_of_machines_without_a_file_come_back(kind):
    model = CASES[kind].model(estimated=True)
    assert_same(model, assemble(written(model.machine)))


def test_an_element_alone_cannot_be_written():
    one = replace(
        element('coulomb_friction', known(1), transition_velocity=1.0),
        point=np.array([0.0, 0.0, 1.0]),
    )
    with pytest.raises(MachineError, match=r'^joint extra: no slideway, pad, .* takes its place'):
        machine_text(oscillator(more_joints=(one,)), {}, '')


def test_a_screw_with_too_many_springs_becomes_a_six_spring():
    spring = SpringDamper(
        'rod', 'block', 'ground', np.zeros(3), np.eye(3), (known(1e5), known(2e5)), kind='screw'
    )
    machine = oscillator(more_joints=(spring,))
    again = written(machine)
    assert again.joints[-1].kind == 'six_spring'
    assert_same(replace(spring, kind='six_spring'), again.joints[-1])
    bare = oscillator(more_joints=(replace(spring, stiffness=()), slideway()))
    assert_same(assemble(bare).parameters, assemble(written(bare)).parameters)


def test_what_cannot_be_read_is_not_written():
    machine = oscillator(mass=unknown(10.0))
    with pytest.raises(MachineError, match=r'machine oscillator as written:.*mass is -3'):
        machine_text(machine, {'block.mass': -3.0}, '')
    with pytest.raises(MachineError, match='"two words", expected a name'):
        machine_text(replace(machine, name='two words'), {}, '')


def test_numbers_and_directions_keep_their_last_bit():
    generator = np.random.default_rng(1)
    numbers = generator.normal(size=200) * 10.0 ** generator.integers(-300, 300, 200)
    assert [float(number(one)) for one in numbers] == list(numbers)
    assert [number(one) for one in (900.0, 3.8e15, 6e-7, 0.0, -0.25, 1 / 3)] == [
        '900', '3.8e15', '6e-7', '0', '-0.25', '0.3333333333333333',
    ]  # fmt: skip
    exact = 0
    for vector in generator.normal(size=(200, 3)):
        unit = vector / np.linalg.norm(vector)
        read = np.array([float(one) for one in direction(unit)])
        np.testing.assert_allclose(read / np.linalg.norm(read), unit, rtol=1e-15)
        exact += np.array_equal(read / np.linalg.norm(read), unit)
    assert exact > 195
