# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Parameters that follow others, and models at other values of preloads and exponents."""

from dataclasses import replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.simulation.simulation import equations_of
import numpy as np
import pytest

from tests.core.machines import known, oscillator, slideway, unknown, X
from tests.core.test_force_derivatives import all_inner_unknown, tied_machine, with_joints
from tests.reference_machines import knee_and_column


def tied(name, times=1.0):
    return Coefficient(tie=Tie(name, times))


def numbers(model):
    """Everything that depends on values, as arrays."""
    equations = equations_of(model)
    return [*equations.arrays, np.array([parameter.value for parameter in model.parameters])]


def assert_same(model, other):
    for found, expected in zip(numbers(model), numbers(other), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_known_preloads_and_exponents_are_no_parameters():
    model = assemble(knee_and_column())
    assert not any(parameter.inner for parameter in model.parameters)
    assert len(model.estimated) == 16
    assert model.tied == ()


def test_estimated_preload_and_exponent_are_parameters_with_symbol_and_unit():
    model = assemble(
        with_joints(
            knee_and_column(), slideway_6={'preload': unknown(5e-7), 'exponent': unknown(2.0)}
        )
    )
    found = {p.name: p for p in model.parameters if p.inner}
    preload, exponent = found['slideway_6.preload'], found['slideway_6.exponent']
    assert (preload.symbol, preload.unit, preload.value) == ('delta_0', 'm', 5e-7)
    assert (exponent.symbol, exponent.unit, exponent.value) == ('m', '1', 2.0)
    assert len(model.estimated) == 18


@pytest.mark.parametrize('coupled', [False, True])
def test_model_at_the_start_values_is_the_model_with_known_ones(coupled):
    machine = knee_and_column(coupled)
    estimated = assemble(all_inner_unknown(machine, 2.0))
    fixed = assemble(machine)
    for found, expected in zip(
        equations_of(estimated).arrays, equations_of(fixed).arrays, strict=True
    ):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize('coupled', [False, True])
def test_model_at_other_values_is_the_machine_described_with_them(coupled):
    model = assemble(all_inner_unknown(knee_and_column(coupled), 2.0))
    values = {parameter.name: parameter.value for parameter in model.parameters}
    described = {}
    for number in range(6, 10):
        name, exponent, preload = f'slideway_{number}', 1.7 + 0.1 * number, number * 1e-7
        values |= {f'{name}.exponent': exponent, f'{name}.preload': preload}
        values[f'{name}.normal_stiffness'] *= 1.1
        # The force at 1 um is the same: a_n (1 um)^m.
        stiffness = values[f'{name}.normal_stiffness'] * 1e-6 ** (2.0 - exponent)
        described[name] = {
            'exponent': exponent,
            'preload': preload,
            'normal_stiffness': unknown(stiffness),
        }
    changed = model.with_values(np.array(list(values.values())))
    expected = assemble(with_joints(knee_and_column(coupled), **described))
    for found, other in zip(
        equations_of(changed).arrays, equations_of(expected).arrays, strict=True
    ):
        np.testing.assert_allclose(found, other, rtol=1e-13)
    # And back: nothing is remembered of the way.
    assert_same(changed.with_values(model.values), model)


def test_number_of_daN_per_micrometre_to_the_m_does_not_depend_on_m():
    # 380 daN/um^2 with m = 2: 3800 N at 1 um, and so for every other exponent.
    machine = oscillator(
        more_joints=(
            slideway(
                normal=X,
                longitudinal=np.array([0.0, 1.0, 0.0]),
                normal_stiffness=unknown(3.8e15),
                exponent=unknown(2.0),
                preload=0.0,
                tangential_stiffness=known(0.0),
            ),
        )
    )
    machine = replace(machine, joints=machine.joints[1:])
    model = assemble(machine)
    for exponent in (1.5, 2.0, 2.3):
        at = model.with_unknowns(np.array([3.8e15, exponent]))
        force = at.joint_force(np.array([[1e-6]]), np.zeros((1, 1)))
        assert force[0, 0] == pytest.approx(3800.0, rel=1e-12)
    assert model.parameters[model.estimated[0]].unit == 'N/m^2'


@pytest.mark.parametrize('coupled', [False, True])
def test_tied_numbers_follow_in_a_changed_model(coupled):
    model = assemble(tied_machine(coupled))
    names = [model.parameters[i].name for i in model.estimated]
    assert 'slideway_9.exponent' in names
    assert not {one.name for one in model.tied} & set(names)
    assert {one.name: one.times for one in model.tied} == pytest.approx({
        'slideway_6.exponent': 1.0,
        'slideway_7.exponent': 1.0,
        'slideway_8.exponent': 1.0,
        'slideway_7.preload': 1.3,
        'slideway_8.preload': 0.65,
        'slideway_7.normal_stiffness': 0.97,
        'slideway_7.tangential_hysteretic_damping': 0.2,
    })  # fmt: skip
    values = dict(zip(names, model.values[list(model.estimated)], strict=True))
    values |= {'slideway_9.exponent': 2.1, 'slideway_6.preload': 0.4e-6}
    values['slideway_6.normal_stiffness'] *= 1.2
    changed = model.with_unknowns(np.array(list(values.values())))
    scale = 1e-6 ** (2.2 - 2.1)
    start = knee_and_column(coupled)
    stiffness = {joint.name: joint.normal_stiffness.value for joint in start.joints[-4:]}
    stiffness['slideway_6'] *= 1.2
    stiffness['slideway_7'] = 0.97 * stiffness['slideway_6']
    preload = {'slideway_6': 0.4e-6, 'slideway_7': 0.52e-6, 'slideway_8': 0.26e-6}
    changes = {
        name: {'exponent': 2.1, 'normal_stiffness': known(value * scale)}
        for name, value in stiffness.items()
    }
    for name, value in preload.items():
        changes[name]['preload'] = value
    changes['slideway_7']['tangential_damping'] = known(0.2 * 15e7)
    expected = assemble(with_joints(start, **changes))
    for found, other in zip(
        equations_of(changed).arrays, equations_of(expected).arrays, strict=True
    ):
        np.testing.assert_allclose(found, other, rtol=1e-12)


def test_tied_masses_and_forces_follow():
    machine = oscillator(mass=unknown(10.0), gravity=np.array([9.81, 0.0, 0.0]))
    block = machine.bodies[0]
    follower = replace(block, name='follower', mass=tied('block.mass', 0.5))
    springs = (
        machine.joints[0],
        replace(machine.joints[0], name='second', body='follower', stiffness=(
            tied('spring.stiffness', 2.0),
        )),
    )  # fmt: skip
    model = assemble(replace(machine, bodies=(block, follower), joints=springs))
    assert model.with_unknowns(np.array([8.0])).mass_diagonal() == pytest.approx([8.0, 4.0])
    rest = static_equilibrium(model.with_unknowns(np.array([8.0])))
    assert rest == pytest.approx([8 * 9.81 / 4e5, 4 * 9.81 / 8e5])


def test_tie_to_a_known_number_makes_it_known():
    model = assemble(
        with_joints(
            knee_and_column(),
            slideway_7={'preload': tied('slideway_6.preload', 2.0)},
            slideway_8={'normal_stiffness': tied('slideway_6.normal_stiffness')},
            slideway_6={'normal_stiffness': known(1e15)},
        )
    )
    law = next(t.law for t in model.terms if model.line_joints[t.line] == 'slideway_7')
    assert law.preload == 1.2e-6
    assert len(model.estimated) == 14
    assert [one.name for one in model.tied] == ['slideway_8.normal_stiffness']


def test_values_that_are_not_known_give_a_model_that_cannot_be_simulated():
    model = assemble(tied_machine(True))
    blank = model.with_unknowns(np.full(len(model.estimated), np.nan))
    with pytest.raises(MachineError, match='no value to simulate with'):
        equations_of(blank)
    assert_same(blank.with_values(model.values), model)


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        (
            {'slideway_7': {'preload': tied('slideway_6.preloat')}},
            r'joint slideway_7: preload is the same as "slideway_6\.preloat", which is no '
            r'parameter of this machine; did you mean "slideway_6\.preload"\?',
        ),
        (
            {'slideway_7': {'normal_stiffness': tied('x.y')}},
            r'joint slideway_7: normal_stiffness .*; expected one of '
            r'slideway_6\.normal_stiffness, slideway_8\.normal_stiffness',
        ),
        (
            {'slideway_7': {'preload': tied('slideway_6.exponent')}},
            r'joint slideway_7: preload \[m\] is the same as "slideway_6\.exponent" \[1\], but '
            'the units differ',
        ),
        (
            {
                'slideway_7': {'normal_stiffness': tied('slideway_6.normal_stiffness')},
                'slideway_6': {'exponent': 1.5},
            },
            r'normal_stiffness \[N/m\^2\] is .* \[N/m\^1\.5\], but the units differ',
        ),
        (
            {'slideway_7': {'exponent': tied('slideway_7.exponent')}},
            'joint slideway_7: exponent is the same as itself; give it a value',
        ),
        (
            {
                'slideway_6': {'preload': tied('slideway_8.preload')},
                'slideway_7': {'preload': tied('slideway_6.preload')},
                'slideway_8': {'preload': tied('slideway_7.preload')},
            },
            r'joint slideway_7: preload follows itself \(slideway_6\.preload -> '
            r'slideway_8\.preload -> slideway_7\.preload -> slideway_6\.preload\); give one',
        ),
    ],
)
def test_impossible_ties_are_refused(changes, says):
    with pytest.raises(MachineError, match=says):
        assemble(with_joints(knee_and_column(), **changes))


@pytest.mark.parametrize('times', [0.0, -1.0, np.nan, np.inf])
def test_factor_of_a_tie_is_positive(times):
    with pytest.raises(MachineError, match='expected a positive number'):
        Tie('a.b', times)
