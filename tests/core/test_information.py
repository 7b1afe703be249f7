# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Square-root information against other solvers and exact arithmetic."""

from fractions import Fraction
from functools import reduce

from identnl_ros.core.algebra.information import Information
import numpy as np
import pytest


def accumulated(regressor, target, rows=7):
    """Add rows a few at a time."""
    information = Information.empty(regressor.shape[1])
    for start in range(0, len(target), rows):
        part = slice(start, start + rows)
        information = information.with_rows(regressor[part], target[part])
    return information


def problem(seed=0, rows=60, size=5, noise=0.1):
    generator = np.random.default_rng(seed)
    regressor = generator.standard_normal((rows, size)) * 10.0 ** np.arange(-4, 2 * size - 4, 2)
    truth = generator.standard_normal(size) * 10.0 ** -np.arange(-4, 2 * size - 4, 2)
    return regressor, regressor @ truth + noise * generator.standard_normal(rows)


@pytest.mark.parametrize('seed', range(10))
@pytest.mark.parametrize('rows', [1, 7, 1000])
def test_solution_residual_and_covariance_equal_those_of_numpy(seed, rows):
    regressor, target = problem(seed)
    information = accumulated(regressor, target, rows)
    solution = information.solve()
    scale = np.linalg.norm(regressor, axis=0)
    values, residual, _, singular = np.linalg.lstsq(regressor / scale, target, rcond=None)
    np.testing.assert_allclose(solution.values, values / scale, rtol=1e-11)
    assert solution.residual_squares == pytest.approx(residual[0], rel=1e-11)
    assert solution.target_squares == pytest.approx(target @ target, rel=1e-12)
    assert solution.condition_number == pytest.approx(singular[0] / singular[-1], rel=1e-10)
    scaled = regressor / scale
    inverse = np.linalg.inv(scaled.T @ scaled) / np.outer(scale, scale)
    np.testing.assert_allclose(solution.inverse, inverse, rtol=1e-9)
    assert information.rows == 60
    assert not solution.free.any()


@pytest.mark.parametrize('seed', range(10))
def test_parts_merge_in_any_order(seed):
    generator = np.random.default_rng(seed)
    regressor, target = problem(seed)
    whole = accumulated(regressor, target).solve()
    cuts = np.sort(generator.choice(np.arange(1, 60), 5, replace=False))
    parts = [
        Information.empty(5).with_rows(*part)
        for part in zip(np.split(regressor, cuts), np.split(target, cuts), strict=True)
    ]
    shuffled = [parts[i] for i in generator.permutation(len(parts))]
    pairs = [shuffled[i].merged(shuffled[i + 1]) for i in range(0, 6, 2)]
    merged = reduce(Information.merged, pairs, Information.empty(5))
    assert merged.rows == 60
    np.testing.assert_allclose(merged.solve().values, whole.values, rtol=1e-11)
    np.testing.assert_allclose(merged.solve().inverse, whole.inverse, rtol=1e-11)


@pytest.mark.parametrize('exponent', [2, 5, 7, 9])
def test_stated_rounding_bounds_the_error_against_exact_rational_arithmetic(exponent):
    # Two nearly parallel columns; the exact solution of the same floating-point numbers.
    generator = np.random.default_rng(exponent)
    first = generator.standard_normal(30)
    regressor = np.column_stack((first, first + 10.0**-exponent * generator.standard_normal(30)))
    target = regressor @ [1.0, 1.0]
    exact = [[Fraction(value) for value in row] for row in np.column_stack((regressor, target))]
    gram = [[sum(row[i] * row[j] for row in exact) for j in range(3)] for i in range(2)]
    determinant = gram[0][0] * gram[1][1] - gram[0][1] ** 2
    expected = [
        float((gram[0][2] * gram[1][1] - gram[0][1] * gram[1][2]) / determinant),
        float((gram[0][0] * gram[1][2] - gram[0][1] * gram[0][2]) / determinant),
    ]
    solution = accumulated(regressor, target).solve()
    error = np.abs(solution.values - expected)
    assert np.all(error <= 10 * solution.rounding)
    assert np.all(solution.rounding < 1e-14 * 10**exponent)


def test_dependent_columns_are_free_and_their_null_direction_is_found():
    generator = np.random.default_rng(4)
    regressor = generator.standard_normal((50, 4)) * [1.0, 1e6, 1e-6, 1.0]
    regressor[:, 2] = 1e-7 * regressor[:, 1]
    truth = np.array([2.0, 3e-6, 5.0, -1.0])
    solution = accumulated(regressor, regressor @ truth).solve()
    assert solution.free.tolist() == [False, True, True, False]
    assert solution.null_space.shape == (4, 1)
    ratio = solution.null_space[1, 0] / solution.null_space[2, 0]
    assert ratio == pytest.approx(-1e-7, rel=1e-6)
    np.testing.assert_allclose(solution.values[[0, 3]], truth[[0, 3]], rtol=1e-12)
    sum_of_both = solution.values[1] + 1e-7 * solution.values[2]
    assert sum_of_both == pytest.approx(3e-6 + 5e-7, rel=1e-10)


def test_column_of_zeros_is_free_and_spoils_nothing():
    regressor, target = problem(1)
    wide = np.column_stack((regressor, np.zeros(60)))
    solution = accumulated(wide, target).solve()
    assert solution.free.tolist() == [False] * 5 + [True]
    assert solution.condition_number == np.inf or solution.condition_number > 1e11
    np.testing.assert_allclose(
        solution.values[:5], accumulated(regressor, target).solve().values, rtol=1e-11
    )


def test_nothing_is_determined_without_data():
    solution = Information.empty(3).solve()
    assert solution.free.all()
    assert solution.condition_number == np.inf
    assert np.all(np.isfinite(solution.values))


def test_adding_rows_leaves_the_earlier_information_alone():
    regressor, target = problem(2)
    first = Information.empty(5).with_rows(regressor[:30], target[:30])
    before = first.factor.copy()
    first.with_rows(regressor[30:], target[30:])
    first.merged(first)
    np.testing.assert_array_equal(first.factor, before)
    assert first.rows == 30
