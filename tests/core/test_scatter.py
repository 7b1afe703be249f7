# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Scatter of the estimates against a sandwich computed from all rows, and its coverage."""

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.pointwise.scatter import GROUPS_PER_UNKNOWN, Scatter
import numpy as np
import pytest
from scipy.stats import binom, chi2

SIZES = np.array([1e-9, 1.0, 1e6, 1e-17])  # of the columns: metres, radians, powers of metres


def problem(seed=0, rows=600, noise=1e-3, sizes=SIZES):
    generator = np.random.default_rng(seed)
    regressor = generator.standard_normal((rows, len(sizes))) * sizes
    truth = generator.uniform(0.5, 2.0, len(sizes)) / sizes
    errors = noise * generator.standard_normal(rows) * np.exp(generator.standard_normal(rows))
    return regressor, regressor @ truth + errors, truth


def accumulated(batches, rows):
    size = batches[0][0].shape[1]
    information, scatter = Information.empty(size), Scatter.empty(size)
    for regressor, target in batches:
        information = information.with_rows(regressor, target)
        scatter = scatter.with_rows(regressor, target, rows)
    solution = information.solve()
    return scatter, solution, scatter.covariance(solution.values, solution.inverse)


def sandwich(batches, rows):
    """Return the covariance from all rows at once, group by group, columns scaled to one."""
    regressor, target = (np.concatenate(part) for part in zip(*batches, strict=True))
    scale = np.linalg.norm(regressor, axis=0)
    values = np.linalg.lstsq(regressor / scale, target, rcond=None)[0]
    inverse = np.linalg.inv((regressor / scale).T @ (regressor / scale))
    groups = []
    for one_regressor, one_target in batches:
        count = max(1, len(one_target) // rows)
        # What is left over joins the last group of its batch.
        starts = rows * np.arange(1, count)
        groups += zip(
            np.split(one_regressor / scale, starts), np.split(one_target, starts), strict=True
        )
    meat = np.zeros_like(inverse)
    for part, right in groups:
        score = part.T @ (right - part @ values)
        meat += np.outer(score, score)
    free = len(groups) / (len(groups) - len(scale))
    return free * inverse @ meat @ inverse / np.outer(scale, scale), len(groups)


def cut(regressor, target, edges):
    return list(zip(np.split(regressor, edges), np.split(target, edges), strict=True))


def assert_equal_in_scale(found, expected, tolerance):
    deviations = np.sqrt(np.diag(expected))
    scale = np.outer(deviations, deviations)
    np.testing.assert_allclose(found / scale, expected / scale, atol=tolerance)


@pytest.mark.parametrize('rows', [1, 2, 6, 12])
@pytest.mark.parametrize('edges', [[], [300], [1, 3, 30], [24, 48, 599], [37, 137, 411]], ids=str)
def test_covariance_is_the_sandwich_of_all_rows(rows, edges):
    batches = cut(*problem()[:2], edges)
    scatter, _, covariance = accumulated(batches, rows)
    expected, groups = sandwich(batches, rows)
    assert scatter.groups == groups
    # Where the first batch is a single row its estimate is a poor reference: digits go.
    assert_equal_in_scale(covariance, expected, 1e-9)


@pytest.mark.parametrize('rows', [1, 4, 10])
@pytest.mark.parametrize('batch', [20, 100, 200])
def test_whole_groups_may_come_in_any_batches(rows, batch):
    regressor, target, _ = problem(1)
    *_, whole = accumulated([(regressor, target)], rows)
    *_, parts = accumulated(cut(regressor, target, range(batch, 600, batch)), rows)
    assert_equal_in_scale(parts, whole, 1e-10)


@pytest.mark.parametrize('noise', [1e-2, 1e-5, 1e-8, 1e-10])
def test_small_residuals_of_large_numbers_keep_their_digits(noise):
    # Brute force in extended precision: the residual is a difference of nearly equal numbers.
    regressor, target, truth = problem(2, noise=noise)
    batches = cut(regressor, target, [200, 400])
    _, solution, covariance = accumulated(batches, 1)
    scaled = (regressor / SIZES).astype(np.longdouble)
    inverse = np.linalg.inv((scaled.T @ scaled).astype(float))
    start = (truth * SIZES).astype(np.longdouble)
    right = target.astype(np.longdouble) - scaled @ start
    residual = right - scaled @ (inverse @ (scaled.T @ right))
    score = scaled * residual[:, np.newaxis]
    meat = (score.T @ score).astype(float)
    expected = 600 / 596 * inverse @ meat @ inverse / np.outer(SIZES, SIZES)
    assert_equal_in_scale(covariance, expected, max(1e-9, 1e-14 / noise))
    assert np.all(np.abs(solution.values - truth) < 5 * np.sqrt(np.diag(covariance)))


@pytest.mark.parametrize('noise', [1e-2, 1e-4, 1e-6])
def test_first_rows_that_say_nothing_cost_only_digits(noise):
    # A record begins with the machine at rest: zeros, or noise of sensors alone.
    regressor, target, _ = problem(3, noise=noise)
    generator = np.random.default_rng(9)
    for size in (0.0, 1e-6):
        quiet = size * generator.standard_normal((100, 4)) * SIZES
        silence = (quiet, size * generator.standard_normal(100))
        batches = [silence, *cut(regressor, target, [200])]
        *_, covariance = accumulated(batches, 1)
        assert_equal_in_scale(covariance, sandwich(batches, 1)[0], 1e-6)


def test_unknown_that_appears_late_is_treated_as_the_others():
    regressor, target, truth = problem(4)
    regressor[:200, 1] = 0.0
    target[:200] -= problem(4)[0][:200, 1] * truth[1]
    batches = cut(regressor, target, [200, 400])
    *_, covariance = accumulated(batches, 2)
    assert_equal_in_scale(covariance, sandwich(batches, 2)[0], 1e-9)


def test_too_few_groups_give_no_covariance():
    regressor, target, _ = problem(5)
    least = GROUPS_PER_UNKNOWN * 4 + 2
    for groups in (1, least - 1, least):
        scatter, _, covariance = accumulated([(regressor[: 5 * groups], target[: 5 * groups])], 5)
        assert scatter.groups == groups
        assert (covariance is None) == (groups < least)


def test_adding_rows_leaves_the_earlier_scatter_alone():
    regressor, target, _ = problem(6)
    first = Scatter.empty(4).with_rows(regressor[:300], target[:300], 1)
    before = first.moments.copy(), first.scale.copy(), first.reference.copy()
    copies = regressor.copy(), target.copy()
    first.with_rows(regressor[300:], target[300:], 1)
    for part, kept in zip((first.moments, first.scale, first.reference), before, strict=True):
        np.testing.assert_array_equal(part, kept)
    np.testing.assert_array_equal(regressor, copies[0])
    np.testing.assert_array_equal(target, copies[1])


def two_equations(factors, runs=600, instants=200):
    """Scores of a run of two equations per instant, whose errors are `normal @ factors`."""
    generator = np.random.default_rng(12)
    # Each equation has an unknown of its own and one in common, in units far apart. Columns
    # are alike, as of one motion: else the error of the common unknown alone would make
    # residuals in an exact equation, and its own unknown look less sure than it is.
    regressor = generator.standard_normal((instants, 2, 3))
    regressor[:, :, 1:] += regressor[:, :, :1]
    regressor *= [1e-6, 1.0, 1e3]
    regressor[:, 0, 1] = regressor[:, 1, 2] = 0.0
    regressor = regressor.reshape(-1, 3)
    truth = np.array([3e6, 1.0, 2e-3])
    scores = np.empty((runs, 3))
    for row in scores:
        errors = generator.standard_normal((instants, len(factors))) @ factors
        batches = [(regressor, regressor @ truth + errors.ravel())]
        _, solution, covariance = accumulated(batches, 2)
        row[:] = (solution.values - truth) / np.sqrt(np.diag(covariance))
        joint = solution.values - truth
        assert joint @ np.linalg.solve(covariance, joint) < chi2.ppf(1 - 1e-7, 3)
    return scores


@pytest.mark.parametrize(
    'factors',
    [
        np.diag([1.0, 1.0]),
        np.diag([1.0, 1e-3]),
        np.diag([1e-3, 1.0]),
        np.diag([1.0, 0.0]),
        np.array([[1.0, 1.0]]),
        np.array([[1.0, -0.7]]),
        np.array([[1.0, 30.0]]),
        np.array([[0.3, 0.9], [1.0, 0.0]]),
    ],
    ids=['equal', 'first', 'second', 'exact', 'same', 'against', 'lever', 'partly'],
)
def test_intervals_hold_the_truth_whatever_the_noises_of_two_equations(factors):
    scores = two_equations(factors)
    inside = (np.abs(scores) < 1.96).sum(axis=0)
    low, high = binom.ppf([5e-4, 1 - 5e-4], len(scores), 0.95)
    assert np.all((low <= inside) & (inside <= high)), inside / len(scores)
    assert np.all(np.abs(scores.mean(axis=0)) < 3.9 / np.sqrt(len(scores)))


def test_neighbours_that_share_their_noise_need_groups_of_them():
    # Moving means over 8 instants as residuals: singly much too sure, in groups of 64 right.
    generator = np.random.default_rng(13)
    instants, runs = 4096, 300
    time = np.arange(instants)
    regressor = np.column_stack((np.sin(0.01 * time), np.cos(0.01 * time)))
    scores = {1: [], 64: []}
    for _ in range(runs):
        white = generator.standard_normal(instants + 7)
        target = np.convolve(white, np.ones(8), 'valid')
        for rows, found in scores.items():
            _, solution, covariance = accumulated([(regressor, target)], rows)
            found.append(solution.values / np.sqrt(np.diag(covariance)))
    singly, grouped = (np.mean(np.abs(found) < 1.96) for found in scores.values())
    assert singly < 0.7
    assert binom.ppf(5e-4, 2 * runs, 0.95) <= 2 * runs * grouped
    assert 2 * runs * grouped <= binom.ppf(1 - 5e-4, 2 * runs, 0.95)
