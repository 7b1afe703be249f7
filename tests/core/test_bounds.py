# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Estimates within bounds: optimality against other solvers, coverage by proof and by trial."""

from itertools import product

from identnl_ros.core.algebra.bounds import bounded, bounded_solution
from identnl_ros.core.algebra.information import Information
from identnl_ros.core.errors import DataError
import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.stats import norm, t

NORMAL = norm.ppf(0.975)


def case(seed, size):
    """Correlated errors in units that differ, and bounds of which some are violated."""
    generator = np.random.default_rng(seed)
    units = 10.0 ** generator.uniform(-6, 6, size)
    root = generator.standard_normal((size + 3, size))
    covariance = np.linalg.inv(root.T @ root) * np.outer(units, units)
    values = generator.standard_normal(size) * units
    lowest = np.where(generator.random(size) < 0.7, -0.3 * units, -np.inf)
    highest = np.where(generator.random(size) < 0.5, 0.4 * units, np.inf)
    return values, covariance, lowest, highest


def nearest_of_all_active_sets(values, covariance, lowest, highest):
    """Try every choice of parameters at their bounds, each a linear problem."""
    unit = np.sqrt(np.diag(covariance))
    metric = np.linalg.inv(covariance / np.outer(unit, unit))
    best, least = None, np.inf
    for choice in product('-lh', repeat=len(values)):
        held = np.array([c != '-' for c in choice])
        point = np.where([c == 'l' for c in choice], lowest, highest)
        if not np.isfinite(point[held]).all():
            continue
        off = np.zeros(len(values))
        off[held] = (point - values)[held] / unit[held]
        off[~held] = np.linalg.solve(
            metric[np.ix_(~held, ~held)], -metric[np.ix_(~held, held)] @ off[held]
        )
        found = np.where(held, point, values + off * unit)
        inside = (found >= lowest - 1e-12 * unit) & (found <= highest + 1e-12 * unit)
        if inside.all() and off @ metric @ off < least:
            best, least = found, off @ metric @ off
    return best


@pytest.mark.parametrize('seed', range(40))
@pytest.mark.parametrize('size', [1, 2, 5])
def test_values_are_the_nearest_of_all_active_sets(seed, size):
    values, covariance, lowest, highest = case(seed, size)
    expected = nearest_of_all_active_sets(values, covariance, lowest, highest)
    unit = np.sqrt(np.diag(covariance))
    estimate = bounded(values, covariance, lowest, highest)
    np.testing.assert_allclose(estimate.values / unit, expected / unit, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(
        estimate.at_bound, (estimate.values == lowest) | (estimate.values == highest)
    )
    off = (np.abs(expected - lowest) < 1e-9 * unit) | (np.abs(expected - highest) < 1e-9 * unit)
    np.testing.assert_array_equal(estimate.at_bound, off)


@pytest.mark.parametrize('seed', range(20))
def test_values_satisfy_the_conditions_of_karush_kuhn_and_tucker(seed):
    values, covariance, lowest, highest = case(seed, 17)
    unit = np.sqrt(np.diag(covariance))
    estimate = bounded(values, covariance, lowest, highest)
    slope = np.linalg.solve(covariance / np.outer(unit, unit), (estimate.values - values) / unit)
    low, high = estimate.values == lowest, estimate.values == highest
    assert np.all(np.abs(slope[~low & ~high]) < 1e-9 * np.abs(slope).max())
    assert np.all(slope[low] > 0)
    assert np.all(slope[high] < 0)


@pytest.mark.parametrize('seed', range(20))
def test_regression_with_nonnegative_parameters_agrees_with_nnls_on_its_rows(seed):
    generator = np.random.default_rng(seed)
    regressor = generator.standard_normal((50, 6)) @ generator.standard_normal((6, 6))
    target = regressor @ generator.standard_normal(6) + generator.standard_normal(50)
    information = Information.empty(6).with_rows(regressor, target)
    estimate = bounded_solution(information, np.zeros(6), np.full(6, np.inf))
    expected, _ = nnls(regressor, target)
    np.testing.assert_allclose(estimate.values, expected, rtol=1e-9, atol=1e-12)


def test_estimate_inside_keeps_its_values_and_the_interval_of_student():
    generator = np.random.default_rng(0)
    regressor = generator.standard_normal((12, 3))
    target = regressor @ [5.0, 6.0, 7.0] + generator.standard_normal(12)
    information = Information.empty(3).with_rows(regressor, target)
    values, residual, _, _ = np.linalg.lstsq(regressor, target, rcond=None)
    inverse = np.linalg.inv(regressor.T @ regressor)
    reach = t.ppf(0.975, 9) * np.sqrt(residual[0] / 9 * np.diag(inverse))
    estimate = bounded_solution(information, np.zeros(3), np.full(3, np.inf))
    np.testing.assert_allclose(estimate.values, values, rtol=1e-12)
    np.testing.assert_allclose(estimate.lower, values - reach, rtol=1e-10)
    np.testing.assert_allclose(estimate.upper, values + reach, rtol=1e-10)
    assert not estimate.at_bound.any()
    assert not estimate.contradicted.any()


@pytest.mark.parametrize('seed', range(40))
@pytest.mark.parametrize('size', [1, 2, 17])
def test_interval_includes_the_feasible_part_of_the_unconstrained_one_and_the_value(seed, size):
    # Whence it covers at least as often; and it is feasible and never shorter than one arm.
    values, covariance, lowest, highest = case(seed, size)
    reach = NORMAL * np.sqrt(np.diag(covariance))
    estimate = bounded(values, covariance, lowest, highest)
    assert np.all((lowest <= estimate.lower) & (estimate.upper <= highest))
    assert np.all((estimate.lower <= estimate.values) & (estimate.values <= estimate.upper))
    start = np.maximum(values - reach, lowest)
    end = np.minimum(values + reach, highest)
    overlap = start <= end
    slack = 1e-12 * reach
    assert np.all((estimate.lower <= start + slack)[overlap])
    assert np.all((estimate.upper >= end - slack)[overlap])
    np.testing.assert_array_equal(estimate.contradicted, ~overlap)
    shortest = np.minimum(reach, highest - lowest)
    assert np.all(estimate.upper - estimate.lower >= (1 - 1e-12) * shortest)


def trials(truth, correlation, count=3000, seed=0):
    """Unconstrained estimates of two parameters with unit deviations."""
    covariance = np.array([[1.0, correlation], [correlation, 1.0]])
    draws = np.random.default_rng(seed).multivariate_normal(truth, covariance, count)
    return draws, covariance


@pytest.mark.parametrize('correlation', [0.0, 0.9, -0.9])
@pytest.mark.parametrize('first', [0.0, 0.5, 2.0])
@pytest.mark.parametrize('second_bounded', [False, True])
def test_intervals_cover_near_the_bound(first, correlation, second_bounded):
    truth = np.array([first, 0.0])
    lowest = np.array([0.0, 0.0 if second_bounded else -np.inf])
    draws, covariance = trials(truth, correlation)
    covered, false_alarms = np.zeros(2), np.zeros(2)
    for values in draws:
        estimate = bounded(values, covariance, lowest, np.full(2, np.inf))
        covered += (estimate.lower <= truth) & (truth <= estimate.upper)
        false_alarms += estimate.contradicted
    assert np.all(covered >= 0.94 * len(draws))
    assert np.all(false_alarms <= 0.035 * len(draws))


@pytest.mark.parametrize('correlation', [0.9, -0.9])
def test_interval_conditional_on_a_neighbour_at_its_bound_would_not_cover(correlation):
    # Why it is not used. Truth: the neighbour a deviation and a half inside its bound.
    draws, _ = trials([1.5, 0.0], correlation, 100_000)
    held = np.minimum(draws[:, 0], 0.0)
    value = draws[:, 1] - correlation * held
    deviation = np.where(held < 0, np.sqrt(1 - correlation**2), 1.0)
    among_held = np.abs(value[held < 0]) <= NORMAL * deviation[held < 0]
    assert np.mean(among_held) < 0.5


def test_likelihood_ratio_with_the_quantile_of_chi_squared_would_cover_too_seldom():
    # Why it is not used. Truth on the bound of the neighbour, which is strongly correlated.
    correlation = 0.99
    draws, _ = trials([0.0, 0.0], correlation, 100_000)
    neighbour, value = draws.T

    def distance(a, b):
        return (a * a - 2 * correlation * a * b + b * b) / (1 - correlation**2)

    # Least distance from the draw with the neighbour feasible: value free, and value at truth.
    free = np.minimum(neighbour, 0.0) ** 2
    best = np.maximum(neighbour - correlation * value, 0.0)
    at_truth = distance(neighbour - best, value)
    assert np.mean(at_truth - free <= NORMAL**2) < 0.945


def test_a_value_far_outside_is_a_contradiction_with_an_interval_at_the_bound():
    estimate = bounded(
        np.array([-5.0, 5.0]), np.diag([1.0, 4.0]), np.zeros(2), np.array([np.inf, 0.5])
    )
    assert estimate.values.tolist() == [0.0, 0.5]
    assert estimate.lower.tolist() == [0.0, 0.0]
    np.testing.assert_allclose(estimate.upper, [NORMAL, 0.5])
    assert estimate.at_bound.tolist() == [True, True]
    assert estimate.contradicted.tolist() == [True, True]


def test_interval_contains_a_value_that_a_contradicted_neighbour_has_moved_far():
    covariance = np.array([[1.0, 0.99], [0.99, 1.0]])
    estimate = bounded(
        np.array([-6.0, 0.0]), covariance, np.array([0.0, -np.inf]), np.full(2, np.inf)
    )
    assert estimate.values[1] == pytest.approx(0.99 * 6)
    assert estimate.lower[1] == pytest.approx(-NORMAL)
    assert estimate.upper[1] == estimate.values[1]
    assert estimate.contradicted.tolist() == [True, False]
    assert estimate.at_bound.tolist() == [True, False]


def test_what_the_data_do_not_determine_stays_within_the_bounds_and_moves_nothing():
    covariance = np.array([[1.0, np.nan, 0.5], [np.nan, np.nan, np.nan], [0.5, np.nan, 1.0]])
    values, lowest = np.array([-1.0, np.nan, 3.0]), np.zeros(3)
    estimate = bounded(values, covariance, lowest, np.array([np.inf, 7.0, np.inf]))
    np.testing.assert_allclose(estimate.values, [0.0, np.nan, 3.5])
    assert (estimate.lower[1], estimate.upper[1]) == (0.0, 7.0)
    assert estimate.at_bound.tolist() == [True, False, False]
    assert not estimate.contradicted.any()


def test_collinear_columns_of_a_regression_have_their_bounds_for_intervals():
    generator = np.random.default_rng(1)
    regressor = generator.standard_normal((30, 3))
    regressor[:, 1] = 2 * regressor[:, 0]
    target = regressor @ [1.0, 1.0, 2.0] + 0.1 * generator.standard_normal(30)
    information = Information.empty(3).with_rows(regressor, target)
    estimate = bounded_solution(information, np.zeros(3), np.full(3, 9.0))
    assert np.isnan(estimate.values).tolist() == [True, True, False]
    assert estimate.lower[:2].tolist() == [0.0, 0.0]
    assert estimate.upper[:2].tolist() == [9.0, 9.0]
    assert estimate.lower[2] < 2 < estimate.upper[2]


def test_exact_data_are_held_at_the_bound_without_scatter():
    estimate = bounded(np.array([-1.0, 2.0]), np.zeros((2, 2)), np.zeros(2), np.full(2, np.inf))
    assert estimate.values.tolist() == [0.0, 2.0]
    assert estimate.lower.tolist() == [0.0, 2.0]
    assert estimate.contradicted.tolist() == [True, False]


def test_perfect_correlation_moves_both():
    covariance = np.array([[1.0, 2.0], [2.0, 4.0]])
    estimate = bounded(
        np.array([-1.0, 5.0]), covariance, np.array([0.0, -np.inf]), np.full(2, np.inf)
    )
    np.testing.assert_allclose(estimate.values, [0.0, 7.0], rtol=1e-6)


@pytest.mark.parametrize(('low', 'high'), [(1.0, 0.0), (0.0, 0.0), (np.nan, 1.0), (0.0, np.nan)])
def test_impossible_bounds_are_refused(low, high):
    with pytest.raises(DataError, match='bounds of parameter 0'):
        bounded(np.zeros(1), np.eye(1), np.array([low]), np.array([high]))


def test_regression_without_freedom_is_refused():
    information = Information.empty(2).with_rows(np.eye(2), np.ones(2))
    with pytest.raises(DataError, match='degrees of freedom'):
        bounded_solution(information, np.zeros(2), np.ones(2))
