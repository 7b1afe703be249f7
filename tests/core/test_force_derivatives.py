# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Derivatives by the unknowns, against differences of the equations of motion."""

from dataclasses import replace

from identnl_ros.core.errors import DataError, MachineError
from identnl_ros.core.estimation.regression import PointwiseRegression
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.joints import Slideway
from identnl_ros.core.mechanics.machine import ConstantForce
from identnl_ros.core.pointwise.pointwise_identifier import PointwiseIdentifier
import numpy as np
import pytest

from tests.core.machines import ORIGIN, skew_machine, slideway, unknown, X
from tests.reference_machines import knee_and_column

STATES = 200


def with_joints(machine, **changes):
    """Replace numbers of joints, given by joint name."""
    return replace(
        machine,
        joints=tuple(replace(joint, **changes.get(joint.name, {})) for joint in machine.joints),
    )


def all_inner_unknown(machine, exponent=1.8):
    changes = {
        joint.name: {
            'exponent': unknown(exponent),
            'preload': unknown(joint.preload.value),
            'normal_stiffness': replace(
                joint.normal_stiffness, value=joint.normal_stiffness.value * 1e-6 ** (2 - exponent)
            ),
        }
        for joint in machine.joints
        if isinstance(joint, Slideway)
    }
    return with_joints(machine, **changes)


def tied_machine(coupled):
    """One exponent for all, preloads and stiffnesses that follow others, also by a chain."""

    def tied(name, times=1.0):
        return Coefficient(tie=Tie(name, times))

    return with_joints(
        knee_and_column(coupled),
        slideway_6={'exponent': tied('slideway_9.exponent'), 'preload': unknown(0.6e-6)},
        slideway_7={
            'exponent': tied('slideway_6.exponent'),
            'preload': tied('slideway_6.preload', 1.3),
            'normal_stiffness': tied('slideway_6.normal_stiffness', 0.97),
            'tangential_damping': tied('slideway_7.tangential_stiffness', 0.2),
        },
        slideway_8={
            'exponent': tied('slideway_7.exponent'),
            'preload': tied('slideway_7.preload', 0.5),
        },
        slideway_9={'exponent': unknown(2.2)},
    )


def heavy_machine():
    """Weight, so that nothing is subtracted at rest; mass and a constant force unknown."""
    machine = all_inner_unknown(skew_machine(gravity=np.array([0.0, 0.0, -9.81])), 2.5)
    bed, saddle = machine.bodies
    force = ConstantForce('hose', 'saddle', ORIGIN, X, unknown(100.0))
    follower = ConstantForce('cable', 'bed', ORIGIN, X, Coefficient(tie=Tie('hose.force', 0.3)))
    bodies = (
        replace(bed, mass=Coefficient(tie=Tie('saddle.mass', 3.0))),
        replace(saddle, mass=unknown(120.0)),
    )
    return replace(machine, bodies=bodies, forces=(force, follower))


MACHINES = {
    'decoupled': lambda: all_inner_unknown(knee_and_column()),
    'coupled': lambda: all_inner_unknown(knee_and_column(coupled=True)),
    'weak exponent': lambda: all_inner_unknown(knee_and_column(coupled=True), 1.0),
    'tied decoupled': lambda: tied_machine(False),
    'tied coupled': lambda: tied_machine(True),
    'weight': heavy_machine,
}
each_machine = pytest.mark.parametrize('machine', MACHINES)


def motion(model, seed=0, size=0.5e-6):
    """Deformations from closed to open contacts and to both sides."""
    shape = (STATES, len(model.coordinates))
    generator = np.random.default_rng(seed)
    return tuple(scale * generator.standard_normal(shape) for scale in (size, 3e-4, 0.1))


def left_hand_side(model, displacement, velocity, acceleration):
    return (
        model.mass_diagonal() * acceleration
        + model.joint_force(displacement, velocity)
        - model.constant_load()
    )


def differences(model, index, states, relative_step=2e-4):
    """Fourth-order central difference by one unknown."""
    values = model.values[list(model.estimated)]
    step = relative_step * values[index]

    def at(shift):
        shifted = values.copy()
        shifted[index] += shift
        return left_hand_side(model.with_unknowns(shifted), *states)

    return (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step)


@each_machine
def test_derivatives_are_those_of_the_equations_of_motion(machine):
    model = assemble(MACHINES[machine]())
    states = motion(model)
    found = ForceDerivatives(model).of_motion(*states)
    assert found.shape == (*states[0].shape, len(model.estimated))
    for index, parameter in enumerate(model.parameters[i] for i in model.estimated):
        expected = differences(model, index, states)
        scale = np.abs(expected).max()
        assert scale > 0
        error = np.abs(found[:, :, index] - expected) / scale
        # Where a contact is about to open, the force is not smooth in the preload; for an
        # exponent of one its derivative jumps.
        assert np.median(error) < 1e-10, parameter.name
        assert np.quantile(error, 0.97) < 1e-8, parameter.name
        assert error.max() < 0.1, parameter.name


@pytest.mark.parametrize('coupled', [False, True])
def test_derivatives_are_finite_where_a_contact_has_no_deformation(coupled):
    joint = slideway(preload=unknown(0.0), exponent=unknown(1.0), coupled=coupled)
    machine = skew_machine()
    machine = replace(machine, joints=(*machine.joints, replace(joint, body='bed')))
    for exponent in (0.7, 1.0, 1.5, 2.0):
        model = assemble(machine)
        model = model.with_unknowns(np.array([0.0, exponent]))
        states = np.zeros((1, len(model.coordinates)))
        found = ForceDerivatives(model).of_motion(states, states, states)
        assert np.isfinite(found).all()
        np.testing.assert_array_equal(found[:, :, 1], 0.0)


def test_derivative_by_the_exponent_by_hand():
    # F = a_n s^(2-m) G(m) (|d0 + x|^m sgn - d0^m), s = 1 um; G = (side/2)^(m+1) / (m+2), tilting.
    joint = slideway(body='bed', coupled=False, exponent=unknown(2.0))
    m = 1.9
    model = assemble(replace(skew_machine(), joints=(joint,))).with_unknowns(np.array([m]))
    displacement, *_ = motion(model)
    still = np.zeros_like(displacement)
    expected = np.zeros_like(displacement)
    for term, half_side, preload in zip(
        model.terms, (None, 0.03, 0.2), (0.6e-6, 0.0, 0.0), strict=False
    ):
        geometry, by_geometry = 1.0, 0.0
        if half_side:
            geometry = half_side ** (m + 1) / (m + 2)
            by_geometry = np.log(half_side) - 1 / (m + 2)
        total = preload + displacement @ model.lines[term.line]
        slope = np.sign(total) * np.abs(total) ** m * (np.log(np.abs(total) / 1e-6) + by_geometry)
        if preload:
            slope -= preload**m * np.log(preload / 1e-6)
        slope *= 4e15 * 1e-6 ** (2 - m) * geometry
        expected += slope[:, np.newaxis] * model.lines[term.line]
    found = ForceDerivatives(model).of_motion(displacement, still, still)[:, :, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize('coupled', [False, True])
def test_regression_and_derivatives_are_one(coupled):
    model = assemble(knee_and_column(coupled))
    states = motion(model)
    force = left_hand_side(model, *states)
    regressor, target = PointwiseRegression(model).rows(*states, force)
    truth = model.values[list(model.estimated)]
    np.testing.assert_allclose(
        regressor @ truth, target, rtol=1e-10, atol=1e-10 * np.abs(force).max()
    )
    derivatives = ForceDerivatives(model).of_motion(*states)
    np.testing.assert_array_equal(regressor, derivatives.reshape(regressor.shape))


def test_tied_coefficients_stand_in_the_columns_of_what_they_follow():
    model = assemble(
        with_joints(
            knee_and_column(),
            slideway_7={'normal_stiffness': Coefficient(tie=Tie('slideway_6.normal_stiffness'))},
        )
    )
    states = motion(model)
    force = left_hand_side(model, *states)
    regression = PointwiseRegression(model)
    assert regression.size == 15
    regressor, target = regression.rows(*states, force)
    truth = model.values[list(model.estimated)]
    np.testing.assert_allclose(
        regressor @ truth, target, rtol=1e-10, atol=1e-10 * np.abs(force).max()
    )


@pytest.mark.parametrize('key', ['preload', 'exponent'])
def test_pointwise_estimator_refuses_inner_unknowns_and_names_the_alternative(key):
    machine = knee_and_column()
    model = assemble(with_joints(machine, slideway_8={key: unknown(1.0)}))
    for estimator in (PointwiseRegression, PointwiseIdentifier):
        with pytest.raises(DataError, match=rf'slideway_8\.{key}: .*weak or the likelihood'):
            estimator(model)


@pytest.mark.parametrize(('key', 'value'), [('preload', -1e-9), ('exponent', 0.0)])
def test_impossible_inner_values_are_refused(key, value):
    model = assemble(all_inner_unknown(knee_and_column()))
    values = model.values
    values[[p.name == f'slideway_8.{key}' for p in model.parameters]] = value
    with pytest.raises(MachineError, match=f'joint slideway_8: {key} is'):
        model.with_values(values)
