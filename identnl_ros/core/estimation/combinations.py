# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Say in words what data determine where they do not determine single parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.estimation.estimate import CombinationEstimate
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Combination:
    """
    A weighted sum of parameters.

    Parameters
    ----------
    names : tuple of str
    weights : ndarray, shape (n_names,)
        The first is 1.

    """

    names: tuple[str, ...]
    weights: NDArray[np.float64]

    @property
    def in_words(self) -> str:
        """E.g. ``h_n3 + h_n4``."""
        words = self.names[0]
        for name, weight in zip(self.names[1:], self.weights[1:], strict=True):
            size = abs(weight)
            factor = '' if abs(size - 1) < 1e-6 else f'{size:.4g} * '
            words += f' {"-" if weight < 0 else "+"} {factor}{name}'
        return words


def determined_combinations(
    null_space: NDArray[np.float64], free: NDArray[np.bool_], names: Sequence[str]
) -> list[Combination]:
    """
    Find the combinations of the free parameters that the data do determine.

    Parameters
    ----------
    null_space : ndarray, shape (n, n_null)
        Directions that the data do not determine.
    free : ndarray of bool, shape (n,)
        Parameters that take part in one of them.
    names : sequence of str, length n

    Returns
    -------
    list of Combination
        A reduced basis: each names as few parameters as possible.

    """
    involved = np.flatnonzero(free)
    if involved.size == 0:
        return []
    # Rows of the orthogonal complement, in units in which the null directions are of order one.
    block = null_space[involved]
    scale = np.abs(block).max(axis=1)
    _, singular, right = np.linalg.svd((block / scale[:, np.newaxis]).T)
    rank = int((singular > 1e-9 * singular.max(initial=0.0)).sum())
    reduced = _row_echelon(right[rank:])
    combinations = []
    for row in reduced:
        weights = row / scale
        used = np.abs(row) > 1e-9
        weights = weights[used] / weights[used][0]
        combinations.append(Combination(tuple(names[i] for i in involved[used]), weights))
    return combinations


def combination_estimates(
    null_space: NDArray[np.float64],
    free: NDArray[np.bool_],
    names: Sequence[str],
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> tuple[CombinationEstimate, ...]:
    """
    Estimate the combinations that the data determine.

    Parameters
    ----------
    null_space, free, names
        As in `determined_combinations`.
    values : ndarray, shape (n,)
        Any solution.
    covariance : ndarray, shape (n, n)
        On the determined subspace.

    Returns
    -------
    tuple of CombinationEstimate

    """
    found = []
    for one in determined_combinations(null_space, free, names):
        weights = np.zeros(len(names))
        for name, weight in zip(one.names, one.weights.tolist(), strict=True):
            weights[list(names).index(name)] = weight
        variance = max(float(weights @ covariance @ weights), 0.0)
        deviation = float(np.sqrt(variance))
        found.append(CombinationEstimate(one.in_words, float(weights @ values), deviation))
    return tuple(found)


def _row_echelon(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reduced row echelon form with partial pivoting."""
    rows = matrix.copy()
    pivot_row = 0
    for column in range(rows.shape[1]):
        if pivot_row == rows.shape[0]:
            break
        best = pivot_row + int(np.argmax(np.abs(rows[pivot_row:, column])))
        if abs(rows[best, column]) < 1e-9:
            continue
        rows[[pivot_row, best]] = rows[[best, pivot_row]]
        rows[pivot_row] /= rows[pivot_row, column]
        for other in range(rows.shape[0]):
            if other != pivot_row:
                rows[other] -= rows[other, column] * rows[pivot_row]
        rows[np.abs(rows) < 1e-9] = 0.0
        pivot_row += 1
    return rows
