# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Joint geometry against the integrals it stands for."""

from dataclasses import replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.joints import frame_about, SpringDamper
from identnl_ros.core.mechanics.machine import Body, Machine
import numpy as np
import pytest
from scipy.integrate import dblquad, quad

from tests.core.machines import known, ORIGIN, slideway, X, Y, Z

A_N = 4e15
AT_REST = np.zeros(6)
LENGTH, WIDTH = 0.4, 0.06


def wrench(joint, deformation, rate=AT_REST):
    """Sum a joint's terms, in its own frame."""
    total = np.zeros(6)
    for term in joint.terms():
        force = term.law.force(term.direction @ deformation, term.direction @ rate)
        total += term.coefficient.value * term.factor * force * term.direction
    return total


def factors(joint, key):
    return {
        int(np.flatnonzero(term.direction)[0]): term.factor
        for term in joint.terms()
        if term.key == key
    }


def test_factors_of_a_linear_slideway_are_second_moments_of_area_per_unit_area():
    joint = slideway(exponent=1.0, coupled=False)
    about_2, about_3 = WIDTH**2 / 12, LENGTH**2 / 12
    normal = {0: 1.0, 4: about_2, 5: about_3}
    tangential = {1: 1.0, 2: 1.0, 3: about_2 + about_3}
    for key, expected in (
        ('normal_stiffness', normal),
        ('normal_damping', normal),
        ('tangential_stiffness', tangential),
        ('tangential_damping', tangential),
    ):
        assert factors(joint, key) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize('exponent', [0.7, 1.0, 1.5, 2.0, 2.6, 3.0])
def test_decoupled_tilting_factors_are_the_integral_of_pressure_times_lever(exponent):
    joint = slideway(exponent=exponent, coupled=False)
    found = factors(joint, 'normal_stiffness')
    for axis, side in ((4, WIDTH), (5, LENGTH)):
        # Mean over the area of |angle z|^m sgn(angle z) z, angle 1; (9) of the paper.
        integral = 2 * quad(lambda z: z**exponent * z, 0, side / 2, epsabs=0, epsrel=1e-12)[0]
        assert found[axis] == pytest.approx(integral / side, rel=1e-11)


def pressure_wrench(deformation, exponent, preload):
    def pressure(z, y):
        approach = preload + deformation[0] + deformation[4] * z - deformation[5] * y
        return A_N / (LENGTH * WIDTH) * max(approach, 0.0) ** exponent

    def over_area(weight):
        return dblquad(
            lambda z, y: weight(y, z) * pressure(z, y),
            -LENGTH / 2, LENGTH / 2, -WIDTH / 2, WIDTH / 2, epsabs=0, epsrel=1e-10,
        )[0]  # fmt: skip

    return np.array(
        [over_area(lambda y, z: 1.0), over_area(lambda y, z: z), over_area(lambda y, z: -y)]
    )


@pytest.mark.parametrize('exponent', [1.0, 2.0, 3.0])
@pytest.mark.parametrize('seed', range(3))
def test_coupled_law_is_the_integral_of_the_pressure_while_closed(exponent, seed):
    generator = np.random.default_rng(seed)
    deformation = np.zeros(6)
    deformation[[0, 4, 5]] = generator.uniform(-0.3e-6, 0.3e-6, 3) * [0.5, 1, 1]
    joint = slideway(exponent=exponent, tangential_stiffness=known(0.0))
    expected = pressure_wrench(deformation, exponent, 0.6e-6)
    found = wrench(joint, deformation)
    np.testing.assert_allclose(found[[0, 4, 5]], expected, rtol=1e-8)
    np.testing.assert_array_equal(found[1:4], 0.0)


def test_coupled_law_of_any_power_converges_to_the_integral_with_more_points():
    deformation = np.array([-0.1e-6, 0, 0, 0, 1e-6, -0.8e-6])
    expected = pressure_wrench(deformation, 1.6, 0.6e-6)
    joint = slideway(exponent=1.6, tangential_stiffness=known(0.0), gauss_points=12)
    np.testing.assert_allclose(wrench(joint, deformation)[[0, 4, 5]], expected, rtol=1e-8)


def test_half_open_contact_approaches_the_integral_of_the_pressure():
    # Approach 0.1 um - 2 urad * y: open beyond y = 0.05 m.
    deformation = np.array([-0.5e-6, 0, 0, 0, 0, 2e-6])
    expected = [
        quad(lambda y, k=k: A_N / LENGTH * (0.1e-6 - 2e-6 * y) ** 2 * (-y) ** k, -0.2, 0.05,
             epsabs=0, epsrel=1e-12)[0]
        for k in (0, 1)
    ]  # fmt: skip
    assert expected[0] == pytest.approx(A_N * 0.5e-6**3 / (3 * 2e-6 * LENGTH))
    errors = []
    for points in (4, 8, 16, 32):
        joint = slideway(tangential_stiffness=known(0.0), gauss_points=points)
        errors.append(np.abs(wrench(joint, deformation)[[0, 5]] / expected - 1).max())
    assert errors[0] < 0.1
    assert errors[-1] < 1e-3


def free_block(joint):
    body = Body('block', known(10.0), ORIGIN, np.eye(3))
    return assemble(Machine('one joint', (body,), (joint,)))


def test_preload_gives_a_coupled_slideway_tilting_stiffness_at_rest_and_a_decoupled_one_none():
    # Axes 1, 2, 3 of the joint: -z, x, -y of the machine.
    expected = {4: 2 * A_N * 0.6e-6 * LENGTH**2 / 12, 3: 2 * A_N * 0.6e-6 * WIDTH**2 / 12}
    for coupled in (True, False):
        stiffness = free_block(slideway(coupled=coupled)).tangent_stiffness(np.zeros(6))
        for axis, value in expected.items():
            assert stiffness[axis, axis] == pytest.approx(value if coupled else 0.0, rel=1e-12)
        assert stiffness[2, 2] == pytest.approx(2 * A_N * 0.6e-6, rel=1e-12)
        assert stiffness[0, 0] == stiffness[1, 1] == pytest.approx(1.5e8)


def test_coupled_slideway_opens_under_tension_and_the_paper_s_does_not():
    lifted = np.array([[0.0, 0.0, 5e-6, 0.0, 0.0, 0.0]])  # block rises, normal is -z
    at_rest = A_N * 0.6e-6**2
    opened = free_block(slideway()).joint_force(lifted, 0 * lifted)[0]
    np.testing.assert_allclose(opened, [0, 0, at_rest, 0, 0, 0], rtol=1e-12, atol=1e-6)
    held = free_block(slideway(coupled=False)).joint_force(lifted, 0 * lifted)[0, 2]
    assert held == pytest.approx(at_rest + A_N * (5e-6 - 0.6e-6) ** 2)


def test_pressing_the_body_along_the_normal_pushes_it_back():
    pressed = np.array([[0.0, 0.0, -0.2e-6, 0.0, 0.0, 0.0]])
    force = free_block(slideway()).joint_force(pressed, 0 * pressed)[0, 2]
    assert force == pytest.approx(-A_N * (0.8e-6**2 - 0.6e-6**2))


def test_hysteretic_damping_is_viscous_damping_of_h_over_omega():
    rate = np.array([1.0, -2.0, 3.0, 0.4, 0.5, -0.6])
    joint = slideway(normal_damping=known(3.6e7), tangential_damping=known(5.5e7))
    hysteretic = replace(joint, damping_frequency=40.0)
    omega = 2 * np.pi * 40
    rest = wrench(joint, np.zeros(6))
    np.testing.assert_allclose(
        (wrench(hysteretic, np.zeros(6), rate) - rest) * omega,
        wrench(joint, np.zeros(6), rate) - rest,
        rtol=1e-13,
    )
    assert {term.unit for term in hysteretic.terms() if term.symbol.startswith('h')} == {'N/m'}
    assert {term.unit for term in joint.terms() if term.symbol.startswith('c')} == {'N*s/m'}


def test_axes_of_a_slideway_are_normal_longitudinal_and_their_product():
    axes = slideway(normal=-2 * Z, longitudinal=3 * Y).axes
    np.testing.assert_allclose(axes, np.column_stack((-Z, Y, X)), atol=1e-15)


def test_absent_springs_have_no_terms_and_estimated_zeros_have():
    joint = SpringDamper('s', 'block', 'ground', ORIGIN, np.eye(3), (known(0.0), known(2.0)))
    assert [term.key for term in joint.terms()] == ['stiffness_2']
    maybe = replace(joint, stiffness=(replace(known(0.0), estimated=True), known(2.0)))
    assert [term.key for term in maybe.terms()] == ['stiffness_1', 'stiffness_2']


def test_units_of_springs_follow_power_and_axis():
    joint = SpringDamper(
        's', 'block', 'ground', ORIGIN, np.eye(3),
        *(tuple(known(1.0) for _ in range(6)) for _ in range(4)),
    )  # fmt: skip
    units = {(term.symbol, int(np.argmax(term.direction))): term.unit for term in joint.terms()}
    assert [units[symbol, 0] for symbol in ('k', 'k_2', 'k_3', 'c')] == [
        'N/m', 'N/m^2', 'N/m^3', 'N*s/m',
    ]  # fmt: skip
    assert [units[symbol, 3] for symbol in ('k', 'k_2', 'k_3', 'c')] == [
        'N*m', 'N*m', 'N*m', 'N*m*s',
    ]  # fmt: skip


@pytest.mark.parametrize('seed', range(20))
def test_frame_about_is_right_handed_and_starts_with_the_axis(seed):
    axis = np.random.default_rng(seed).standard_normal(3) * 7
    frame = frame_about(axis, 'test')
    np.testing.assert_allclose(frame[:, 0], axis / np.linalg.norm(axis), atol=1e-15)
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-14)
    assert np.linalg.det(frame) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        ({'longitudinal': X + 0.01 * Z}, 'perpendicular.*angle of 90.57'),
        ({'normal': 0 * Z}, 'zero'),
        ({'normal': np.array([np.nan, 0, 1])}, 'finite'),
        ({'length': 0.0}, 'length'),
        ({'width': -1.0}, 'width'),
        ({'exponent': np.nan}, 'exponent'),
        ({'preload': -1e-6}, 'preload'),
        ({'preload': np.inf}, 'preload'),
        ({'damping_frequency': 0.0}, 'damping_frequency'),
        ({'gauss_points': 0}, 'gauss_points'),
        ({'point': np.array([np.nan, 0.0, 0.0])}, 'point'),
    ],
)
def test_impossible_slideways_are_refused(changes, says):
    with pytest.raises(MachineError, match=f'joint slide.*{says}'):
        slideway(**changes)


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        ({'axes': np.diag([1.0, 1.0, -1.0])}, 'right-handed'),
        ({'axes': np.eye(3) + 0.01}, 'perpendicular'),
        ({'axes': 2 * np.eye(3)}, 'unit'),
        ({'stiffness': (known(1.0),) * 7}, 'stiffness has 7'),
        ({'point': np.array([0.0, np.inf, 0.0])}, 'point'),
    ],
)
def test_impossible_springs_are_refused(changes, says):
    joint = SpringDamper('spring', 'block', 'ground', ORIGIN)
    with pytest.raises(MachineError, match=f'joint spring.*{says}'):
        replace(joint, **changes)
