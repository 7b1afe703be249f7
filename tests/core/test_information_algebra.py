# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Merging, forgetting, shifting and eliminating on the factor: the same as on the rows."""

from identnl_ros.core.algebra.information import Information, merge_by_name
from identnl_ros.core.errors import DataError
import numpy as np
import pytest

SEEDS = range(10)


def problem(seed, rows=60, size=5, noise=0.1):
    """Columns whose units differ by up to eight powers of ten."""
    generator = np.random.default_rng(seed)
    units = 10.0 ** generator.uniform(-4, 4, size)
    regressor = generator.standard_normal((rows, size)) * units
    truth = generator.standard_normal(size) / units
    return regressor, regressor @ truth + noise * generator.standard_normal(rows)


def information_of(regressor, target):
    return Information.empty(regressor.shape[1]).with_rows(regressor, target)


def assert_same(first, second, rtol=1e-10):
    """Compare solution, covariance, residual and freedom."""
    one, other = first.solve(), second.solve()
    np.testing.assert_allclose(one.values, other.values, rtol=rtol)
    deviation = np.sqrt(np.diag(other.inverse))
    unit = np.outer(deviation, deviation)
    np.testing.assert_allclose(one.inverse / unit, other.inverse / unit, rtol=0, atol=rtol)
    assert one.residual_squares == pytest.approx(other.residual_squares, rel=rtol)
    assert first.rows - first.size == pytest.approx(second.rows - second.size)


@pytest.mark.parametrize('seed', range(50))
def test_any_partition_merged_in_any_order_gives_the_solution_of_numpy(seed):
    generator = np.random.default_rng(seed)
    rows = int(generator.integers(10, 400))
    regressor, target = problem(seed, rows)
    order = generator.permutation(rows)
    cuts = np.sort(generator.integers(0, rows, generator.integers(1, 12)))
    parts = [
        information_of(regressor[part], target[part])
        if generator.random() < 0.8
        else Information.empty(5)
        .with_rows(regressor[part], target[part])
        .merged(Information.empty(5))
        for part in np.split(order, cuts)
    ]
    while len(parts) > 1:
        # Any two, as a tree: neither a chain nor in the order of the rows.
        first, second = generator.choice(len(parts), 2, replace=False)
        joined = parts[first].merged(parts[second])
        parts = [p for i, p in enumerate(parts) if i not in (first, second)] + [joined]
    unit = np.linalg.norm(regressor, axis=0)
    values, residual, _, _ = np.linalg.lstsq(regressor / unit, target, rcond=None)
    solution = parts[0].solve()
    np.testing.assert_allclose(
        solution.values * unit, values, rtol=0, atol=1e-13 * np.linalg.norm(values)
    )
    assert solution.residual_squares == pytest.approx(residual[0], rel=1e-11)
    assert parts[0].rows == rows


@pytest.mark.skipif(
    np.finfo(np.longdouble).nmant <= np.finfo(float).nmant,
    reason='long double is no wider than double here',
)
def test_a_thousand_blocks_add_no_rounding_to_that_of_their_rows():
    # Condition 1e9 and integers without rounding, whose exact solution is [1, 1].
    generator = np.random.default_rng(3)
    first = generator.integers(-(2**30), 2**30, 1000).astype(float)
    regressor = np.column_stack((first, first + generator.integers(-1, 2, 1000)))
    information = Information.empty(2)
    for row in regressor:
        information = information.with_rows(row[np.newaxis], row[np.newaxis].sum(axis=1))
    solution = information.solve()
    assert solution.condition_number > 1e8
    # In double precision about 1e-16 times the condition number.
    np.testing.assert_allclose(solution.values, [1.0, 1.0], rtol=1e-10)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('factor', [1.0, 0.9, 0.01])
def test_forgetting_weighs_every_earlier_row(seed, factor):
    regressor, target = problem(seed)
    information = Information.empty(5)
    for part in np.split(np.arange(60), 4):
        information = information.discounted(factor).with_rows(regressor[part], target[part])
    weights = np.repeat(factor ** np.arange(3, -1, -1), 15)
    root = np.sqrt(weights)
    weighted = information_of(regressor * root[:, np.newaxis], target * root)
    one, other = information.solve(), weighted.solve()
    np.testing.assert_allclose(one.values, other.values, rtol=1e-10)
    np.testing.assert_allclose(one.inverse, other.inverse, rtol=1e-10)
    assert one.residual_squares == pytest.approx(other.residual_squares, rel=1e-10)
    assert information.rows == pytest.approx(weights.sum())


@pytest.mark.parametrize('factor', [0.3, 0.9, 1.0])
def test_variances_grow_by_the_reciprocal_of_the_factor(factor):
    information = information_of(*problem(1))
    before, after = information.solve(), information.discounted(factor).solve()
    np.testing.assert_allclose(after.inverse, before.inverse / factor, rtol=1e-12)
    np.testing.assert_allclose(after.values, before.values, rtol=1e-12)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('factor', [0.5, 0.9, 0.99])
def test_variance_of_a_row_is_expected_rather_too_large_after_forgetting(seed, factor):
    # Exact expectation for independent noise of variance one: the trace of a quadratic form.
    regressor, target = problem(seed, 40)
    information = Information.empty(5)
    for part in np.split(np.arange(40), 2):
        information = information.discounted(factor).with_rows(regressor[part], target[part])
    weights = np.repeat([factor, 1.0], 20)
    root = regressor * np.sqrt(weights)[:, np.newaxis]
    orthogonal, _ = np.linalg.qr(root)
    residual_maker = np.eye(40) - orthogonal @ orthogonal.T
    expected = np.trace(residual_maker @ np.diag(weights))
    ratio = expected / (information.rows - 5)
    assert 1 <= ratio < 1 + 5 / (information.rows - 5)


@pytest.mark.parametrize('factor', [0.0, -1.0, 1.1, np.nan, np.inf])
def test_impossible_factor_of_forgetting_is_refused(factor):
    with pytest.raises(DataError, match='factor of forgetting'):
        Information.empty(2).discounted(factor)


@pytest.mark.parametrize('seed', SEEDS)
def test_scaled_rows_join_data_of_unlike_noise_as_generalised_least_squares(seed):
    regressor, target = problem(seed)
    deviation = np.repeat([0.5, 20.0], 30)
    first, second = (information_of(regressor[p], target[p]) for p in np.split(np.arange(60), 2))
    joined = first.scaled(1 / 0.5).merged(second.scaled(1 / 20.0))
    assert_same(joined, information_of(regressor / deviation[:, np.newaxis], target / deviation))


@pytest.mark.parametrize('weight', [0.0, -1.0, np.nan, np.inf])
def test_impossible_weight_is_refused(weight):
    with pytest.raises(DataError, match='weight'):
        Information.empty(2).scaled(weight)


@pytest.mark.parametrize('seed', SEEDS)
def test_shift_is_that_of_the_target(seed):
    regressor, target = problem(seed)
    offset = np.random.default_rng(seed).standard_normal(5) / np.abs(regressor).max(axis=0)
    information = information_of(regressor, target)
    shifted = information.shifted(offset)
    assert_same(shifted, information_of(regressor, target - regressor @ offset))
    np.testing.assert_allclose(
        shifted.solve().values + offset, information.solve().values, rtol=1e-10
    )
    assert_same(shifted.shifted(-offset), information)
    changed = target - regressor @ offset
    assert shifted.solve().target_squares == pytest.approx(changed @ changed, rel=1e-12)


@pytest.mark.parametrize('seed', SEEDS)
def test_elimination_leaves_values_covariance_and_residual_of_the_others(seed):
    information = information_of(*problem(seed))
    keep = np.random.default_rng(seed).permutation(5)[:3]
    whole, part = information.solve(), information.marginalised(keep).solve()
    np.testing.assert_allclose(part.values, whole.values[keep], rtol=1e-10)
    unit = np.sqrt(np.diag(part.inverse))
    np.testing.assert_allclose(
        part.inverse / np.outer(unit, unit),
        whole.inverse[np.ix_(keep, keep)] / np.outer(unit, unit),
        rtol=0,
        atol=1e-11,
    )
    assert part.residual_squares == pytest.approx(whole.residual_squares, rel=1e-12)
    assert information.marginalised(keep).rows == 58


def test_elimination_is_the_schur_complement():
    regressor, target = problem(2)
    regressor /= np.linalg.norm(regressor, axis=0)
    gram = regressor.T @ regressor
    kept, others = [1, 3], [0, 2, 4]
    inner = gram[np.ix_(others, others)]
    cross = gram[np.ix_(others, kept)]
    schur = gram[np.ix_(kept, kept)] - cross.T @ np.linalg.solve(inner, cross)
    factor = information_of(regressor, target).marginalised(kept).factor[:2, :2]
    np.testing.assert_allclose(factor.T @ factor, schur, rtol=1e-11)


@pytest.mark.parametrize('order', [(0, 1, 2), (2, 0, 1)])
def test_elimination_of_unknowns_that_are_not_determined_loses_nothing_of_the_others(order):
    # A column of zeros, and two of which one is three times the other.
    regressor, target = problem(5, size=3)
    regressor /= np.linalg.norm(regressor, axis=0)
    wide = np.column_stack((np.zeros(60), regressor[:, 0], 3 * regressor[:, 0], regressor[:, 1:]))
    columns = [*order, 3, 4]
    eliminated = information_of(wide[:, columns], target).marginalised([3, 4])
    assert_same(eliminated, information_of(regressor, target).marginalised([1, 2]))
    assert eliminated.rows == 59


def test_elimination_of_an_unknown_that_cannot_be_told_from_a_kept_one_takes_it_along():
    regressor, target = problem(6, size=2)
    wide = np.column_stack((regressor, -2 * regressor[:, 0]))
    solution = information_of(wide, target).marginalised([0, 1]).solve()
    assert solution.free.tolist() == [True, False]
    expected = information_of(regressor, target).solve()
    assert solution.values[1] == pytest.approx(expected.values[1], rel=1e-10)


def test_elimination_of_all_or_nothing():
    information = information_of(*problem(7))
    assert_same(information.marginalised(range(5)), information, rtol=1e-12)
    nothing = information.marginalised([])
    assert nothing.size == 0
    assert nothing.rows == 55
    residual = information.solve().residual_squares
    assert nothing.solve().residual_squares == pytest.approx(residual, rel=1e-12)


@pytest.mark.parametrize('keep', [[5], [-1], [1, 1]])
def test_unknowns_to_keep_that_do_not_exist_or_recur_are_refused(keep):
    with pytest.raises(DataError, match='from 0 to 4'):
        Information.empty(5).marginalised(keep)


def machines(seed):
    """Three machines with some parameters in common: rows of each, and of all with all names."""
    generator = np.random.default_rng(seed)
    names = [('k1', 'h1', 'shared'), ('shared', 'k2', 'k1'), ('m', 'k2')]
    union = ('k1', 'h1', 'shared', 'k2', 'm')
    truth = dict(zip(union, generator.standard_normal(5), strict=True))
    parts, whole = [], []
    for own in names:
        regressor = generator.standard_normal((20, len(own)))
        target = regressor @ [truth[name] for name in own] + 0.1 * generator.standard_normal(20)
        parts.append((information_of(regressor, target), own))
        wide = np.zeros((20, 6))
        wide[:, [union.index(name) for name in own]] = regressor
        wide[:, 5] = target
        whole.append(wide)
    stacked = np.vstack(whole)
    return parts, union, information_of(stacked[:, :5], stacked[:, 5])


@pytest.mark.parametrize('seed', SEEDS)
def test_machines_with_common_parameters_merge_by_name(seed):
    parts, union, whole = machines(seed)
    information, names = merge_by_name(parts)
    assert names == union
    assert information.rows == 60
    assert_same(information, whole)
    backwards, other_names = merge_by_name(parts[::-1])
    assert other_names == ('m', 'k2', 'shared', 'k1', 'h1')
    assert_same(backwards.marginalised([other_names.index(name) for name in union]), whole)


@pytest.mark.parametrize('seed', SEEDS)
def test_what_is_private_may_be_eliminated_before_machines_merge(seed):
    parts, union, whole = machines(seed)
    private = {'h1', 'm'}
    reduced = []
    for information, names in parts:
        keep = [i for i, name in enumerate(names) if name not in private]
        reduced.append((information.marginalised(keep), [names[i] for i in keep]))
    information, names = merge_by_name(reduced)
    assert_same(information, whole.marginalised([union.index(name) for name in names]))


def test_merging_no_machine_gives_no_unknowns():
    information, names = merge_by_name([])
    assert (information.size, information.rows, names) == (0, 0, ())


@pytest.mark.parametrize('names', [('a',), ('a', 'a'), ('a', 'b', 'c')])
def test_names_that_do_not_fit_are_refused(names):
    with pytest.raises(DataError, match='2 unknowns'):
        merge_by_name([(Information.empty(2), names)])


def test_information_on_another_number_of_unknowns_is_refused():
    with pytest.raises(DataError, match='3 unknowns'):
        Information.empty(2).merged(Information.empty(3))


@pytest.mark.parametrize(
    ('factor', 'tail'), [((2, 3), None), ((3,), None), ((3, 3), (2, 2)), ((3, 3), (3,))]
)
def test_tables_that_do_not_fit_are_refused(factor, tail):
    with pytest.raises(ValueError, match='shape'):
        Information(np.zeros(factor), 0, None if tail is None else np.zeros(tail))


def test_factor_and_tail_are_the_factor_in_extended_precision():
    information = information_of(*problem(8))
    assert information.factor.dtype == information.tail.dtype == np.float64
    assert np.all(np.abs(information.tail) <= np.spacing(np.abs(information.factor)))
    again = Information(information.factor, information.rows, information.tail)
    np.testing.assert_array_equal(again.extended, information.extended)
    rounded = Information(information.factor, information.rows)
    np.testing.assert_allclose(rounded.solve().values, information.solve().values, rtol=1e-12)


def test_values_that_are_not_finite_stay_visible():
    information = Information.empty(2).with_rows(np.array([[1.0, np.nan]]), np.ones(1))
    assert np.isnan(information.factor).any()


def test_exactly_collinear_columns_are_free_although_nearly_collinear_ones_are_not():
    generator = np.random.default_rng(9)
    first = generator.standard_normal(300)
    near = np.column_stack((first, first + 1e-10 * generator.standard_normal(300)))
    assert not information_of(near, first).solve().free.any()
    exact = np.column_stack((first, first / 3.0))
    solution = Information.empty(2)
    for part in np.split(np.arange(300), 60):
        solution = solution.with_rows(exact[part], first[part])
    assert solution.solve().free.all()
