# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Square-root information against other solvers and certified data."""

from fractions import Fraction
from functools import reduce

from identnl_ros.core.information import Information
import numpy as np
import pytest

# Longley (1967), JASA 62, 819-841, as in the NIST Statistical Reference Datasets.
LONGLEY_TEXT = """
60323 83.0 234289 2356 1590 107608 1947
61122 88.5 259426 2325 1456 108632 1948
60171 88.2 258054 3682 1616 109773 1949
61187 89.5 284599 3351 1650 110929 1950
63221 96.2 328975 2099 3099 112075 1951
63639 98.1 346999 1932 3594 113270 1952
64989 99.0 365385 1870 3547 115094 1953
63761 100.0 363112 3578 3350 116219 1954
66019 101.2 397469 2904 3048 117388 1955
67857 104.6 419180 2822 2857 118734 1956
68169 108.4 442769 2936 2798 120445 1957
66513 110.8 444546 4681 2637 121950 1958
68655 112.6 482704 3813 2552 123366 1959
69564 114.2 502601 3931 2514 125368 1960
69331 115.7 518173 4806 2572 127852 1961
70551 116.9 554894 4007 2827 130081 1962
"""
LONGLEY = np.array(LONGLEY_TEXT.split(), dtype=float).reshape(16, 7)
LONGLEY_VALUES = [
    -3482258.63459582, 15.0618722713733, -0.0358191792925910, -2.02022980381683,
    -1.03322686717359, -0.0511041056535807, 1829.15146461355,
]  # fmt: skip
LONGLEY_DEVIATIONS = [
    890420.383607373, 84.9149257747669, 0.0334910077722432, 0.488399681651699,
    0.214274163161675, 0.226073200069370, 455.478499142212,
]  # fmt: skip

# Filippelli's data of the same collection: y, x; a polynomial of degree ten.
FILIP_TEXT = """
0.8116 -6.860120914 0.9072 -4.324130045 0.9052 -4.358625055 0.9039 -4.358426747
0.8053 -6.955852379 0.8377 -6.661145254 0.8667 -6.355462942 0.8809 -6.118102026
0.7975 -7.115148017 0.8162 -6.815308569 0.8515 -6.519993057 0.8766 -6.204119983
0.8885 -5.853871964 0.8859 -6.109523091 0.8959 -5.79832982 0.8913 -5.482672118
0.8959 -5.171791386 0.8971 -4.851705903 0.9021 -4.517126416 0.909 -4.143573228
0.9139 -3.709075441 0.9199 -3.499489089 0.8692 -6.300769497 0.8872 -5.953504836
0.89 -5.642065153 0.891 -5.031376979 0.8977 -4.680685696 0.9035 -4.329846955
0.9078 -3.928486195 0.7675 -8.56735134 0.7705 -8.363211311 0.7713 -8.107682739
0.7736 -7.823908741 0.7775 -7.522878745 0.7841 -7.218819279 0.7971 -6.920818754
0.8329 -6.628932138 0.8641 -6.323946875 0.8804 -5.991399828 0.7668 -8.781464495
0.7633 -8.663140179 0.7678 -8.473531488 0.7697 -8.247337057 0.77 -7.971428747
0.7749 -7.676129393 0.7796 -7.352812702 0.7897 -7.072065318 0.8131 -6.774174009
0.8498 -6.478861916 0.8741 -6.159517513 0.8061 -6.835647144 0.846 -6.53165267
0.8751 -6.224098421 0.8856 -5.910094889 0.8919 -5.598599459 0.8934 -5.290645224
0.894 -4.974284616 0.8957 -4.64454848 0.9047 -4.290560426 0.9129 -3.885055584
0.9209 -3.408378962 0.9219 -3.13200249 0.7739 -8.726767166 0.7681 -8.66695597
0.7665 -8.511026475 0.7703 -8.165388579 0.7702 -7.886056648 0.7761 -7.588043762
0.7809 -7.283412422 0.7961 -6.995678626 0.8253 -6.691862621 0.8602 -6.392544977
0.8809 -6.067374056 0.8301 -6.684029655 0.8664 -6.378719832 0.8834 -6.065855188
0.8898 -5.752272167 0.8964 -5.132414673 0.8963 -4.811352704 0.9074 -4.098269308
0.9119 -3.66174277 0.9228 -3.2644011
"""
FILIP = np.array(FILIP_TEXT.split(), dtype=float).reshape(82, 2)
FILIP_VALUES = [
    -1467.48961422980, -2772.17959193342, -2316.37108160893, -1127.97394098372,
    -354.478233703349, -75.1242017393757, -10.8753180355343, -1.06221498588947,
    -0.670191154593408e-01, -0.246781078275479e-02, -0.402962525080404e-04,
]  # fmt: skip
FILIP_DEVIATIONS = [
    298.084530995537, 559.779865474950, 466.477572127796, 227.204274477751,
    71.6478660875927, 15.2897178747400, 2.23691159816033, 0.221624321934227,
    0.142363763154724e-01, 0.535617408889821e-03, 0.896632837373868e-05,
]  # fmt: skip


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


def deviations(solution, information):
    freedom = information.rows - information.size
    return np.sqrt(solution.residual_squares / freedom * np.diag(solution.inverse))


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


@pytest.mark.parametrize('rows', [3, 100])
def test_longley_agrees_with_the_certified_values_to_nine_digits(rows):
    regressor = np.column_stack((np.ones(16), LONGLEY[:, 1:]))
    information = accumulated(regressor, LONGLEY[:, 0], rows)
    solution = information.solve()
    np.testing.assert_allclose(solution.values, LONGLEY_VALUES, rtol=1e-9)
    np.testing.assert_allclose(deviations(solution, information), LONGLEY_DEVIATIONS, rtol=1e-9)
    assert np.sqrt(solution.residual_squares / 9) == pytest.approx(304.854073561965, rel=1e-10)


def test_wampler_1_gives_ones_to_nine_digits():
    x = np.arange(21.0)
    regressor = x[:, np.newaxis] ** np.arange(6)
    solution = accumulated(regressor, regressor.sum(axis=1)).solve()
    np.testing.assert_allclose(solution.values, np.ones(6), rtol=1e-9)


def test_filip_agrees_with_the_certified_values_to_six_digits():
    regressor = FILIP[:, 1:] ** np.arange(11)
    information = accumulated(regressor, FILIP[:, 0], 20)
    solution = information.solve()
    assert not solution.free.any()
    np.testing.assert_allclose(solution.values, FILIP_VALUES, rtol=1e-6)
    np.testing.assert_allclose(deviations(solution, information), FILIP_DEVIATIONS, rtol=1e-6)


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
