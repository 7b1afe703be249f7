# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Small vibrations against closed forms."""

from dataclasses import replace

from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.joints import GROUND, SpringDamper
from identnl_ros.core.mechanics.machine import Body, Machine
from identnl_ros.core.mechanics.modes import modes, stiffest_state_matrix
import numpy as np
import pytest

from tests.core.machines import chain, known, ORIGIN, oscillator, skew_machine, slideway, X, Z
from tests.reference_machines import column, knee_and_column, pads


def modes_at_rest(machine):
    model = assemble(machine)
    return modes(model, np.zeros(len(model.coordinates)))


@pytest.mark.parametrize(
    ('masses', 'stiffnesses'),
    [((5.0, 3.0), (2e5, 1e5)), ((1.0, 100.0), (1e7, 1e3)), ((2.0, 2.0), (1e4, 1e4))],
)
def test_two_masses_on_two_springs(masses, stiffnesses):
    (m1, m2), (k1, k2) = masses, stiffnesses
    # det(K - w^2 M) = 0: m1 m2 w^4 - (k2 m1 + (k1 + k2) m2) w^2 + k1 k2 = 0
    half = (k2 * m1 + (k1 + k2) * m2) / (2 * m1 * m2)
    root = np.sqrt(half**2 - k1 * k2 / (m1 * m2))
    squares = np.array([k1 * k2 / (m1 * m2) / (half + root), half + root])
    ratio = 3e-4  # dampers in proportion to the springs: zeta = ratio w / 2
    found = modes_at_rest(chain(masses, stiffnesses, ratio * np.array(stiffnesses)))
    frequencies = [mode.frequency for mode in found]
    np.testing.assert_allclose(frequencies, np.sqrt(squares) / (2 * np.pi), rtol=1e-10)
    damping = [mode.damping_ratio for mode in found]
    np.testing.assert_allclose(damping, ratio * np.sqrt(squares) / 2, rtol=1e-9)


@pytest.mark.parametrize(('mass', 'k', 'c'), [(10.0, 4e5, 200.0), (0.1, 1.0, 5.0), (7.0, 3e9, 0)])
def test_one_mass_on_a_spring_and_damper(mass, k, c):
    (mode,) = modes_at_rest(oscillator(known(mass), known(k), known(c)))
    assert mode.frequency == pytest.approx(np.sqrt(k / mass) / (2 * np.pi), rel=1e-14)
    assert mode.damping_ratio == pytest.approx(c / (2 * np.sqrt(k * mass)), rel=1e-14)


def test_column_on_four_pads_bounces_and_turns_about_its_axis_by_hand():
    frequencies = [mode.frequency for mode in modes_at_rest(Machine('m', (column(),), pads()))]
    bounce = np.sqrt(4 * 2.5e7 / 900) / (2 * np.pi)
    twist = np.sqrt(4 * 1.2e7 * (0.3**2 + 0.3**2) / 60) / (2 * np.pi)
    for expected in (bounce, twist):
        assert np.abs(np.array(frequencies) / expected - 1).min() < 1e-12
    assert frequencies == sorted(frequencies)


@pytest.mark.parametrize('machine', ['skew', 'column', 'chain'])
def test_motions_that_nothing_holds_have_frequency_zero_and_no_damping_ratio(machine):
    free, rigid = {
        'skew': (skew_machine(grounded=False), 6),
        'column': (Machine('free', (column(),), ()), 6),
        'chain': (replace(chain(), joints=chain().joints[1:]), 1),
    }[machine]
    found = modes_at_rest(free)
    assert [mode.frequency for mode in found[:rigid]] == [0.0] * rigid
    assert all(np.isnan(mode.damping_ratio) for mode in found[:rigid])
    assert all(mode.frequency > 1.0 for mode in found[rigid:])
    assert not any(np.isnan(mode.damping_ratio) for mode in found[rigid:])


def test_free_pair_swings_with_its_reduced_mass():
    found = modes_at_rest(replace(chain(), joints=chain().joints[1:]))
    reduced = 5.0 * 3.0 / 8.0
    assert found[1].frequency == pytest.approx(np.sqrt(1e5 / reduced) / (2 * np.pi), rel=1e-12)
    assert found[1].damping_ratio == pytest.approx(30 / (2 * np.sqrt(1e5 * reduced)), rel=1e-12)


def test_contact_is_as_stiff_as_its_load_makes_it():
    body = Body('block', known(10.0), ORIGIN, None, ('translation_3',))
    slide = slideway(preload=0.0, normal_stiffness=known(4e15))
    model = assemble(Machine('block', (body,), (slide,), gravity=-9.81 * Z))
    (mode,) = modes(model, static_equilibrium(model))
    stiffness = 2 * 4e15 * np.sqrt(98.1 / 4e15)
    assert mode.frequency == pytest.approx(np.sqrt(stiffness / 10) / (2 * np.pi), rel=1e-8)


@pytest.mark.parametrize('machine', [chain(), skew_machine(), knee_and_column(coupled=True)])
def test_state_matrix_shows_the_same_modes_where_there_is_hardly_any_damping(machine):
    model = assemble(machine)
    values = model.values
    values[['damping' in parameter.name for parameter in model.parameters]] *= 1e-4
    model = model.with_values(values)
    rest = np.zeros(len(model.coordinates))
    values = np.linalg.eigvals(stiffest_state_matrix(model, rest[np.newaxis]))
    values = values[values.imag > 0]
    values = values[np.argsort(np.abs(values))]
    expected = modes(model, rest)
    frequencies = [2 * np.pi * mode.frequency for mode in expected]
    np.testing.assert_allclose(np.abs(values), frequencies, rtol=1e-7)
    ratios = [mode.damping_ratio for mode in expected]
    np.testing.assert_allclose(-values.real / np.abs(values), ratios, rtol=1e-3)


def test_state_matrix_is_that_of_the_equations_of_motion():
    model = assemble(skew_machine())
    n = len(model.coordinates)
    state = np.zeros((1, n))
    matrix = stiffest_state_matrix(model, state)
    for column_number in range(2 * n):
        step = 1e-11 if column_number < n else 1e-3  # contacts: force of second order
        moved = []
        for sign in (1, -1):
            both = np.concatenate((state, 0 * state), axis=1)
            both[0, column_number] += sign * step
            force = model.joint_force(both[:, :n], both[:, n:])[0]
            moved.append(np.concatenate((both[0, n:], -force / model.mass_diagonal())))
        slope = (moved[0] - moved[1]) / (2 * step)
        scale = np.abs(matrix[:, column_number]).max()
        np.testing.assert_allclose(matrix[:, column_number], slope, atol=1e-5 * scale)


def test_stiffest_state_counts_for_every_spring_by_itself():
    # One spring is stiffest in one state, another in the other, one softens to negative slope.
    aside = SpringDamper(
        'aside', 'block', GROUND, ORIGIN, np.eye(3), (known(1e3),), (), (), (known(1e15),)
    )
    bend = oscillator(known(2.0), known(1e4), known(0.0), known(1e10), more_joints=(aside,))
    states = np.array([[2e-6], [-5e-6]])
    matrix = stiffest_state_matrix(assemble(bend), states)
    # Quadratic spring: |2 k2 q|, its sign is left out; cubic: 3 k3 q^2.
    assert -2.0 * matrix[1, 0] == pytest.approx(1e4 + 1e3 + 2e10 * 5e-6 + 3e15 * 25e-12)
    np.testing.assert_array_equal(matrix[0], [0.0, 1.0])


@pytest.mark.parametrize('coupled', [True, False])
def test_power_below_one_at_its_infinitely_stiff_point_is_left_out(coupled):
    slide = slideway(
        normal=X, longitudinal=Z, exponent=0.5, preload=0.0, normal_stiffness=known(1e3),
        coupled=coupled,
    )  # fmt: skip
    model = assemble(oscillator(known(2.0), known(1e4), more_joints=(slide,)))
    matrix = stiffest_state_matrix(model, np.zeros((1, 1)))
    assert np.isfinite(matrix).all()
    assert -2.0 * matrix[1, 0] == pytest.approx(1e4)
