# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is said of parameters that data determine only together."""

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.estimation.combinations import determined_combinations
import numpy as np
import pytest

NAMES = ('a', 'b', 'c', 'd', 'e', 'f')


def combinations_of(mixing, scales=None, seed=0):
    """Say what random rows determine of parameters that act only through ``mixing @ x``."""
    mixing = np.asarray(mixing, dtype=float)
    if scales is not None:
        mixing = mixing / np.asarray(scales)
    size = mixing.shape[1]
    regressor = np.random.default_rng(seed).standard_normal((80, len(mixing))) @ mixing
    solution = Information.empty(size).with_rows(regressor, regressor.sum(axis=1)).solve()
    found = determined_combinations(solution.null_space, solution.free, NAMES[:size])
    return [combination.in_words for combination in found], found, regressor


@pytest.mark.parametrize(
    ('mixing', 'expected'),
    [
        (np.eye(3), []),
        ([[1, 1]], ['a + b']),
        ([[1, -1]], ['a - b']),
        ([[1, 0, 0], [0, 1, 1]], ['b + c']),
        ([[1, 2]], ['a + 2 * b']),
        ([[1, -0.25]], ['a - 0.25 * b']),
        ([[1, 1, 1]], ['a + b + c']),
        ([[1, 1, 0, 0], [0, 0, 1, 1]], ['a + b', 'c + d']),
        ([[1, 0, 1, 0, 0], [0, 1, 0, 0, 3], [0, 0, 0, 1, 0]], ['a + c', 'b + 3 * e']),
        ([[1, 0, 1], [0, 1, 1]], ['a + c', 'b + c']),
        ([[0, 1, 0], [0, 0, 0]], []),
        ([[1, 1, 0], [0, 0, 0]], ['a + b']),
        ([[0, 0], [0, 0]], []),
    ],
)
@pytest.mark.parametrize('seed', range(3))
def test_words_of_dependent_parameters(mixing, expected, seed):
    assert combinations_of(mixing, seed=seed)[0] == expected


@pytest.mark.parametrize('seed', range(5))
def test_parameters_of_very_different_size_keep_their_exact_ratio(seed):
    words, found, _ = combinations_of([[1, 1, 0], [0, 0, 1]], scales=[1e15, 1e7, 1e-3], seed=seed)
    assert words == ['a + 1e+08 * b']
    np.testing.assert_allclose(found[0].weights, [1.0, 1e8], rtol=1e-8)


@pytest.mark.parametrize('seed', range(10))
def test_named_combinations_are_determined_and_complete(seed):
    generator = np.random.default_rng(seed)
    mixing = np.zeros((4, 6))
    mixing[:2, :3] = generator.integers(-3, 4, (2, 3))
    mixing[2, 3:5] = generator.integers(1, 4, 2)
    mixing[3, 5] = 1
    _, found, regressor = combinations_of(mixing, seed=seed)
    rows = np.zeros((len(found), 6))
    for row, combination in zip(rows, found, strict=True):
        row[[NAMES.index(name) for name in combination.names]] = combination.weights
    rank = np.linalg.matrix_rank(mixing)
    # Each lies in the row space of the data, and with the rest they span it.
    assert np.linalg.matrix_rank(np.vstack((regressor, rows)), tol=1e-6) == rank
    single = [np.eye(6)[i] for i in range(6)
              if np.linalg.matrix_rank(np.vstack((mixing, np.eye(6)[i]))) == rank]  # fmt: skip
    assert np.linalg.matrix_rank(np.vstack((rows, *single)), tol=1e-6) == rank
