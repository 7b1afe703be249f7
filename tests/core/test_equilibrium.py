# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Static equilibrium against statics by hand."""

from dataclasses import replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.joints import GROUND, SpringDamper
from identnl_ros.core.mechanics.machine import Body, ConstantForce, Machine
import numpy as np
import pytest
from scipy.optimize import brentq

from tests.core.machines import known, ORIGIN, skew_machine, slideway, X, Z
from tests.reference_machines import column, knee_and_column, pads

G = 9.81
DOWN = np.array([0.0, 0.0, -G])


def block_on_contact(side=0.0, force=0.0, **changes):
    """Block that moves along x and z, on a slideway; a constant force pulls along x and z."""
    body = Body('block', known(10.0), ORIGIN, None, ('translation_1', 'translation_3'))
    forces = tuple(
        ConstantForce(name, 'block', ORIGIN, direction, known(value))
        for name, direction, value in (('side', X, side), ('lift', Z, force))
        if value
    )
    return assemble(Machine('block', (body,), (slideway(**changes),), (), forces, DOWN))


def test_column_sinks_by_its_weight_over_the_stiffness_of_the_pads():
    machine = Machine('column', (column(),), pads(), gravity=DOWN)
    expected = np.zeros(6)
    expected[2] = -900 * G / (4 * 2.5e7)
    np.testing.assert_allclose(static_equilibrium(assemble(machine)), expected, atol=1e-16)


def test_weight_beside_the_centre_of_the_pads_tilts_the_machine():
    # About the pads' centre: moment m g e against the stiffness 4 k L^2 of pads at x = +-L.
    excess = 0.08
    heavy = replace(column(), centre_of_mass=np.array([excess, 0.0, 0.75]))
    machine = Machine('column', (heavy,), pads(), gravity=DOWN)
    tilt = 900 * G * excess / (4 * 2.5e7 * 0.3**2)
    sink = -900 * G / (4 * 2.5e7)
    # The centre lies beside and above the centre of the pads, which turn about it.
    expected = [tilt * 0.75, 0.0, sink - tilt * excess, 0.0, tilt, 0.0]
    np.testing.assert_allclose(static_equilibrium(assemble(machine)), expected, atol=1e-15)


@pytest.mark.parametrize('exponent', [1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize('coupled', [True, False])
def test_block_sinks_into_a_power_law_contact(exponent, coupled):
    stiffness = 98.1 / 3e-6**exponent
    model = block_on_contact(
        exponent=exponent, coupled=coupled, preload=0.0, normal_stiffness=known(stiffness)
    )
    np.testing.assert_allclose(static_equilibrium(model), [0.0, -3e-6], rtol=1e-9)


@pytest.mark.parametrize('side', [1.0, 10.0, 100.0, 123.4, 333.3, 1e4])
def test_side_load_does_not_keep_a_contact_without_preload_from_being_loaded(side):
    model = block_on_contact(side, preload=0.0)
    expected = [side / 1.5e8, -np.sqrt(98.1 / 4e15)]
    np.testing.assert_allclose(static_equilibrium(model), expected, rtol=1e-9)


def test_assembly_preload_counts_from_the_unloaded_joint():
    model = block_on_contact(preload=0.1e-6)
    sink = brentq(lambda z: 4e15 * (0.1e-6 + z) ** 2 - 98.1, 0, 1e-6, xtol=1e-18)
    np.testing.assert_allclose(static_equilibrium(model), [0.0, -sink], rtol=1e-9)


@pytest.mark.parametrize('machine', ['skew', 'decoupled', 'coupled'])
def test_all_forces_and_moments_balance(machine):
    machine = {
        'skew': skew_machine(gravity=DOWN),
        'decoupled': replace(knee_and_column(), gravity=DOWN),
        'coupled': replace(knee_and_column(coupled=True), gravity=DOWN),
    }[machine]
    model = assemble(machine)
    rest = static_equilibrium(model)
    left = model.joint_force(rest[np.newaxis], 0 * rest[np.newaxis])[0] - model.constant_load()
    assert np.abs(left).max() < 1e-8 * np.abs(model.constant_load()).max()
    # Newton's third law: the ground bears the weight of all, whatever happens inside.
    borne = sum(
        joint.stiffness[2].value * model.motion_of_point(joint.body, joint.point, Z) @ rest
        for joint in machine.joints
        if joint.other_body == GROUND
    )
    weight = sum(body.mass.value for body in machine.bodies) * G
    assert -borne == pytest.approx(weight, rel=1e-9)


def test_machine_that_counts_from_its_state_of_rest_is_at_rest():
    np.testing.assert_array_equal(static_equilibrium(assemble(skew_machine())), 0.0)


def test_constant_force_stretches_a_spring_where_weight_is_left_out():
    body = Body('block', known(10.0), ORIGIN, None, ('translation_1',))
    spring = SpringDamper('spring', 'block', GROUND, ORIGIN, np.eye(3), (known(4e5),))
    force = ConstantForce('hose', 'block', ORIGIN, -3 * X, known(20.0))
    model = assemble(Machine('pulled', (body,), (spring,), (), (force,)))
    np.testing.assert_allclose(static_equilibrium(model), [-20 / 4e5], rtol=1e-14)


def test_error_names_the_motion_that_nothing_holds():
    with pytest.raises(MachineError, match='nothing holds translation 3 of block'):
        static_equilibrium(block_on_contact(force=150.0, preload=0.0))


def test_column_on_one_pad_cannot_stand():
    machine = Machine('column', (column(),), pads()[:1], gravity=DOWN)
    with pytest.raises(MachineError, match=r'nothing holds .* of column'):
        static_equilibrium(assemble(machine))
