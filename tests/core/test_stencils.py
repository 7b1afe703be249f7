# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Finite differences and interpolation against textbook weights and polynomials."""

from identnl_ros.core.measurement.stencils import stencil
import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator


@pytest.mark.parametrize(
    ('derivative', 'half_width', 'twelfths'),
    [
        (0, 2, [0, 0, 12, 0, 0]),
        (1, 1, [-6, 0, 6]),
        (1, 2, [1, -8, 0, 8, -1]),
        (2, 1, [12, -24, 12]),
        (2, 2, [-1, 16, -30, 16, -1]),
        (3, 2, [-6, 12, 0, -12, 6]),
        (4, 2, [12, -48, 72, -48, 12]),
    ],
)
def test_centred_weights_are_those_of_the_textbooks(derivative, half_width, twelfths):
    weights = stencil(derivative, 0.0, half_width)
    np.testing.assert_allclose(weights, np.array(twelfths) / 12, atol=1e-14)


@pytest.mark.parametrize('half_width', [1, 2, 4, 8])
@pytest.mark.parametrize('derivative', [0, 1, 2])
@pytest.mark.parametrize('offset', [0.0, 0.5, -0.25, 0.499, -1.0])
def test_exact_on_all_polynomials_up_to_the_degree_of_the_nodes(derivative, offset, half_width):
    nodes = np.arange(-half_width, half_width + 1.0)
    weights = stencil(derivative, offset, half_width)
    for degree in range(2 * half_width + 1):
        # Chebyshev polynomials on the stencil: of order one, so that errors can be compared.
        polynomial = np.polynomial.Chebyshev.basis(
            degree, domain=[-half_width - 1.0, half_width + 1.0]
        )
        expected = polynomial.deriv(derivative)(offset) if derivative else polynomial(offset)
        assert weights @ polynomial(nodes) == pytest.approx(expected, abs=2e-12)


def test_not_exact_one_degree_higher():
    nodes = np.arange(-2.0, 3.0)
    assert abs(stencil(1, 0.0, 2) @ nodes**5) == pytest.approx(4.0)


@pytest.mark.parametrize('offset', [-0.5, -0.1, 0.3, 0.5])
def test_interpolation_equals_the_barycentric_formula(offset):
    nodes = np.arange(-8, 9.0)
    for column in range(nodes.size):
        unit = np.eye(nodes.size)[column]
        expected = BarycentricInterpolator(nodes, unit)(offset)
        assert stencil(0, offset, 8)[column] == pytest.approx(float(expected), abs=1e-13)


def test_seventeen_points_differentiate_a_sine_at_a_tenth_of_the_sample_rate_to_3e_9():
    nodes = np.arange(-8, 9.0)
    omega = 2 * np.pi * 0.1
    wave = np.exp(1j * omega * nodes)
    assert abs(stencil(1, 0.0, 8) @ wave / (1j * omega) - 1) < 3e-9
    assert abs(stencil(2, 0.0, 8) @ wave / -(omega**2) - 1) < 3e-9
