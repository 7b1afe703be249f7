# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Square-root information: accumulate a regression by orthogonal updates, merge, solve.

Householder triangularisation keeps the condition number of the regressor; forming
``Phi^T Phi`` would square it (Golub and Van Loan, Matrix Computations, section 5.3). The factor
of stacked rows is the factor of stacked factors, so blocks, records and machines merge in any
order.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Singular values of the column-scaled factor below this fraction of the largest are rounding.
RANK_TOLERANCE = 1e-11


@dataclass(frozen=True)
class Solution:
    """
    Least-squares solution of an accumulated regression.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Minimum-norm in the scaled columns; meaningless where `free` is True.
    inverse : ndarray, shape (n, n)
        ``(Phi^T Phi)^-1`` on the determined subspace.
    free : ndarray of bool, shape (n,)
        Columns that take part in a combination the data do not determine.
    null_space : ndarray, shape (n, n_null)
        Directions of the unknowns, in their own units, that leave every row unchanged.
    rounding : ndarray, shape (n,)
        Size of the error of `values` from the arithmetic alone.
    residual_squares : float
        Sum of squares of the residual.
    target_squares : float
        Sum of squares of the target.
    condition_number : float
        Of the column-scaled regressor.

    """

    values: NDArray[np.float64]
    inverse: NDArray[np.float64]
    free: NDArray[np.bool_]
    null_space: NDArray[np.float64]
    rounding: NDArray[np.float64]
    residual_squares: float
    target_squares: float
    condition_number: float


@dataclass(frozen=True)
class Information:
    """
    Triangular factor of ``[Phi, Y]`` of all rows so far.

    Parameters
    ----------
    factor : ndarray, shape (n + 1, n + 1)
        Upper triangular; the last column belongs to the target.
    rows : int
        Number of scalar equations accumulated.

    """

    factor: NDArray[np.float64]
    rows: int = 0

    @classmethod
    def empty(cls, size: int) -> 'Information':
        """
        Begin with no data.

        Parameters
        ----------
        size : int
            Number of unknowns.

        Returns
        -------
        Information

        """
        return cls(np.zeros((size + 1, size + 1)))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.factor.shape[0]) - 1

    def with_rows(
        self, regressor: NDArray[np.float64], target: NDArray[np.float64]
    ) -> 'Information':
        """
        Add rows.

        Parameters
        ----------
        regressor : ndarray, shape (n_rows, n)
        target : ndarray, shape (n_rows,)

        Returns
        -------
        Information

        """
        stacked = np.empty((self.size + 1 + target.size, self.size + 1))
        stacked[: self.size + 1] = self.factor
        stacked[self.size + 1 :, :-1] = regressor
        stacked[self.size + 1 :, -1] = target
        return Information(_triangle(stacked), self.rows + target.size)

    def merged(self, other: 'Information') -> 'Information':
        """
        Join with the information of other data on the same unknowns.

        Parameters
        ----------
        other : Information

        Returns
        -------
        Information

        """
        return Information(
            _triangle(np.vstack((self.factor, other.factor))), self.rows + other.rows
        )

    def solve(self) -> Solution:
        """
        Solve by a rank-revealing factorisation of the column-scaled factor.

        Returns
        -------
        Solution

        """
        n = self.size
        lengths = np.linalg.norm(self.factor[:n, :n], axis=0)
        scale = np.where(lengths > 0, lengths, 1.0)
        left, singular, right = np.linalg.svd(self.factor[:n, :n] / scale)
        largest = singular.max(initial=0.0)
        rank = int((singular > RANK_TOLERANCE * largest).sum())
        seen = right[:rank]
        half_inverse = (seen.T / singular[:rank]) / scale[:, np.newaxis]
        values = half_inverse @ (left[:, :rank].T @ self.factor[:n, n])
        null_space = right[rank:].T
        condition_of_seen = largest / singular[rank - 1] if rank else 1.0
        return Solution(
            values=values,
            inverse=half_inverse @ half_inverse.T,
            free=np.linalg.norm(null_space, axis=1) > 1e-6,
            null_space=null_space / scale[:, np.newaxis],
            rounding=np.finfo(float).eps
            * n
            * condition_of_seen
            * float(np.linalg.norm(scale * values))
            / scale,
            residual_squares=float(self.factor[n, n] ** 2),
            target_squares=float(np.sum(self.factor[:, n] ** 2)),
            condition_number=(
                float(largest / singular[-1]) if n and singular[-1] > 0 else float('inf')
            ),
        )


def _triangle(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    triangle: NDArray[np.float64] = np.asarray(np.linalg.qr(rows, mode='r'))
    size = rows.shape[1]
    if triangle.shape[0] < size:
        triangle = np.vstack((triangle, np.zeros((size - triangle.shape[0], size))))
    return triangle
