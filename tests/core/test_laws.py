# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Force laws against complex-step and finite-difference derivatives and hand values."""

from identnl_ros.core.mechanics.laws import Law, LawKind
import numpy as np
import pytest

ALL = [
    Law(LawKind.LINEAR, rest_force=0.2),
    Law(LawKind.VISCOUS),
    Law(LawKind.POLYNOMIAL, 2.0),
    Law(LawKind.POLYNOMIAL, 3.0),
    *(Law(kind, m, 0.6, 0.36) for kind in (LawKind.SIGNED_POWER, LawKind.CONTACT)
      for m in (1.0, 1.5, 2.0, 2.7)),
]  # fmt: skip


def ids(law):
    return f'{law.kind.name}-{law.exponent}'


@pytest.mark.parametrize('law', ALL, ids=ids)
def test_stiffness_is_the_derivative_of_the_force(law):
    deformation = np.array([-2.3, -1.1, -0.4, 0.1, 0.9, 3.0])
    step = 1e-3
    # Richardson extrapolation of central differences: error of order step^6.
    slopes = [
        (law.force(deformation + h, 0 * deformation) - law.force(deformation - h, 0 * deformation))
        / (2 * h)
        for h in (step, step / 2, step / 4)
    ]
    first = [(4 * slopes[i + 1] - slopes[i]) / 3 for i in range(2)]
    expected = (16 * first[1] - first[0]) / 15
    np.testing.assert_allclose(law.stiffness(deformation), expected, atol=1e-10)


@pytest.mark.parametrize('law', ALL, ids=ids)
def test_damping_is_the_derivative_of_the_force_by_the_rate(law):
    deformation = np.linspace(-2, 2, 7)
    difference = law.force(deformation, deformation + 0.5) - law.force(deformation, deformation)
    np.testing.assert_allclose(difference, 0.5 * law.damping, atol=1e-15)


@pytest.mark.parametrize('exponent', [0.5, 1.0, 1.5, 2.0, 3.3])
def test_open_contact_carries_neither_force_nor_stiffness(exponent):
    law = Law(LawKind.CONTACT, exponent, preload=0.6)
    opened = np.array([-0.6000001, -1.0, -1e3])
    np.testing.assert_array_equal(law.force(opened, 0 * opened), 0.0)
    np.testing.assert_array_equal(law.stiffness(opened), 0.0)


@pytest.mark.parametrize('kind', [LawKind.CONTACT, LawKind.SIGNED_POWER])
def test_slope_of_a_power_below_one_is_given_without_a_warning_everywhere(kind):
    # Infinitely stiff at the one point where it touches; warnings are errors here.
    slope = Law(kind, 0.5, preload=0.6).stiffness(np.array([-0.6, 0.4, 3.4]))
    np.testing.assert_allclose(slope[1:], [0.5, 0.25])
    assert not np.isnan(slope[0])


def test_open_contact_leaves_the_force_that_balanced_at_rest():
    law = Law(LawKind.CONTACT, 2.0, preload=0.6, rest_force=0.36)
    assert law.force(np.float64(-5.0), np.float64(0.0)) == -0.36


@pytest.mark.parametrize('exponent', [1.0, 1.5, 2.0, 2.7])
def test_signed_power_is_odd_about_the_unloaded_state(exponent):
    law = Law(LawKind.SIGNED_POWER, exponent, preload=0.6)
    away = np.array([0.1, 0.5, 2.0])
    up, down = law.force(away - 0.6, 0 * away), law.force(-away - 0.6, 0 * away)
    np.testing.assert_allclose(up, -down, rtol=1e-14)
    np.testing.assert_allclose(up, away**exponent, rtol=1e-14)


def test_even_powers_do_not_change_sign_and_odd_ones_do():
    both = np.array([-2.0, 2.0])
    np.testing.assert_array_equal(Law(LawKind.POLYNOMIAL, 2.0).force(both, both), [4.0, 4.0])
    np.testing.assert_array_equal(Law(LawKind.POLYNOMIAL, 3.0).force(both, both), [-8.0, 8.0])


def test_contact_and_signed_power_agree_while_closed():
    deformation = np.linspace(-0.59, 3.0, 50)
    laws = (Law(kind, 2.4, 0.6, 0.1) for kind in (LawKind.CONTACT, LawKind.SIGNED_POWER))
    forces = [law.force(deformation, 0 * deformation) for law in laws]
    np.testing.assert_array_equal(*forces)
