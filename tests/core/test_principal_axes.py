# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Principal axes: an eigenvalue problem with a fixed choice of order and sign."""

from identnl_ros.core.mechanics.principal_axes import principal_axes
import numpy as np
import pytest
from scipy.spatial.transform import Rotation


def small_rotation(generator, largest):
    vector = generator.standard_normal(3)
    return Rotation.from_rotvec(
        vector / np.linalg.norm(vector) * generator.uniform(0, largest)
    ).as_matrix()


@pytest.mark.parametrize('seed', range(40))
def test_slightly_turned_tensor_gives_back_its_moments_and_axes_in_order(seed):
    generator = np.random.default_rng(seed)
    moments = generator.permutation([11.0, 17.0, 26.0])
    axes = small_rotation(generator, 0.6)
    found_moments, found_axes = principal_axes(axes @ np.diag(moments) @ axes.T)
    np.testing.assert_allclose(found_moments, moments, rtol=1e-13)
    np.testing.assert_allclose(found_axes, axes, atol=1e-13)


@pytest.mark.parametrize('seed', range(100))
def test_axes_are_principal_and_right_handed_for_any_rotation(seed):
    generator = np.random.default_rng(seed)
    turn = Rotation.from_quat(generator.standard_normal(4)).as_matrix()
    moments = np.array([1.0, 1.0 if seed % 3 == 0 else 1.4, 1.0 if seed % 6 == 0 else 2.1])
    inertia = turn @ np.diag(moments) @ turn.T
    found, axes = principal_axes(inertia)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-13)
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(axes @ np.diag(found) @ axes.T, inertia, atol=1e-12)


@pytest.mark.parametrize(
    'moments', [(3, 2, 1), (1, 2, 3), (2, 3, 1), (2, 2, 1), (1, 2, 2), (2, 1, 2), (5, 5, 5)]
)
def test_diagonal_tensor_keeps_the_machine_axes(moments):
    found, axes = principal_axes(np.diag(np.array(moments, dtype=float)))
    np.testing.assert_array_equal(axes, np.eye(3))
    np.testing.assert_array_equal(found, moments)


@pytest.mark.parametrize('seed', range(20))
@pytest.mark.parametrize('moments', [(2, 2, 1), (1, 2, 2), (2, 1, 2), (4, 4, 4)])
def test_rounding_does_not_turn_the_axes_of_a_round_body(moments, seed):
    noise = np.random.default_rng(seed).standard_normal((3, 3)) * 1e-15
    _, axes = principal_axes(np.diag(np.array(moments, dtype=float)) + noise + noise.T)
    np.testing.assert_allclose(axes, np.eye(3), atol=1e-13)


@pytest.mark.parametrize('seed', range(20))
def test_round_body_tilted_by_a_little_keeps_axes_as_near_as_can_be(seed):
    generator = np.random.default_rng(seed)
    tilt = small_rotation(generator, 0.3)
    _, axes = principal_axes(tilt @ np.diag([2.0, 2.0, 1.0]) @ tilt.T)
    np.testing.assert_allclose(axes[:, 2], tilt[:, 2], atol=1e-13)
    # Nearest frame with this axis 3: no spin about it makes the trace larger.
    for spin in np.linspace(-np.pi, np.pi, 37):
        other = axes @ Rotation.from_rotvec([0.0, 0.0, spin]).as_matrix()
        assert np.trace(other) <= np.trace(axes) + 1e-12
