# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Square-root information: accumulate a regression by orthogonal updates, merge, solve.

Householder triangularisation keeps the condition number of the regressor; forming
``Phi^T Phi`` would square it (Golub and Van Loan, Matrix Computations, section 5.3). The factor
of stacked rows is the factor of stacked factors, so blocks, records and machines merge in any
order; unknowns that do not matter are eliminated, and old data forgotten, on the factor alone
(Bierman 1977, Factorization Methods for Discrete Sequential Estimation).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.algebra.triangle import absorbed
from identnl_ros.core.errors import DataError
import numpy as np
from numpy.typing import NDArray
import scipy.linalg

# Singular values of the column-scaled factor below this fraction of the largest are rounding.
RANK_TOLERANCE = 1e-11
# Steps of iterative refinement; each gains at least four digits at that tolerance.
REFINEMENTS = 4


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
    rows : float
        Number of scalar equations accumulated; a fraction where some have been discounted.
    tail : ndarray, shape (n + 1, n + 1), or None
        What `factor` lacks of the factor in extended precision; None: nothing.

    Raises
    ------
    ValueError
        If the tables are not square or not of one size.

    """

    factor: NDArray[np.float64]
    rows: float = 0
    tail: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Refuse tables that cannot belong together."""
        shape = self.factor.shape
        if shape != (len(self.factor),) * 2 or (
            self.tail is not None and self.tail.shape != shape
        ):
            raise ValueError(f'information of shape {shape}: not square, or its tail does not fit')

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

    @property
    def extended(self) -> NDArray[np.longdouble]:
        """The factor in extended precision, shape (n + 1, n + 1)."""
        whole = self.factor.astype(np.longdouble)
        return whole if self.tail is None else whole + self.tail

    def with_rows(
        self, regressor: NDArray[np.floating], target: NDArray[np.floating]
    ) -> 'Information':
        """
        Add rows.

        Parameters
        ----------
        regressor : ndarray, shape (n_rows, n)
            Up to `triangle.EXTENDED_ROWS` at a time may be of extended precision and keep it.
        target : ndarray, shape (n_rows,)

        Returns
        -------
        Information

        """
        table = np.column_stack((regressor, target))
        return _information(absorbed(self.extended, table), self.rows + len(table))

    def merged(self, other: 'Information') -> 'Information':
        """
        Join with the information of other data on the same unknowns.

        Parameters
        ----------
        other : Information
            Of rows with the same variance of noise; see `scaled`.

        Returns
        -------
        Information

        Raises
        ------
        DataError
            If it belongs to another number of unknowns.

        """
        if other.size != self.size:
            raise DataError(
                f'information on {other.size} unknowns cannot join information on {self.size}; '
                'merge by their names'
            )
        return _information(absorbed(self.extended, other.extended), self.rows + other.rows)

    def scaled(self, weight: float) -> 'Information':
        """
        Multiply all rows by a number: to join data of unlike noise, divide each by its noise.

        Parameters
        ----------
        weight : float
            Greater than zero.

        Returns
        -------
        Information
            Of as many rows.

        Raises
        ------
        DataError
            If the weight is not a positive number.

        """
        if not 0 < weight < np.inf:
            raise DataError(f'weight of rows: {weight}, expected a number greater than 0')
        return _information(self.extended * np.longdouble(weight), self.rows)

    def discounted(self, factor: float) -> 'Information':
        """
        Forget in part: every row so far counts `factor` as much.

        The triangular factor shrinks by the root of `factor`, as if the noise of these rows had
        had a variance ``1 / factor`` times as large. Repeated before every block of n rows, this
        leaves a memory of ``n / (1 - factor)`` rows. `rows` shrinks too, to the sum of the
        weights: ``residual_squares / (rows - n)`` then is the variance of a row that has not been
        discounted, rather too large than too small, if the noise in truth has stayed the same.

        Parameters
        ----------
        factor : float
            Above 0, at most 1.

        Returns
        -------
        Information

        Raises
        ------
        DataError
            If the factor is out of this range.

        """
        if not 0 < factor <= 1:
            raise DataError(f'factor of forgetting: {factor}, expected above 0 and at most 1')
        root = np.sqrt(np.longdouble(factor))
        return _information(self.extended * root, self.rows * factor)

    def shifted(self, offset: NDArray[np.float64]) -> 'Information':
        """
        Express the same information by the unknowns less an offset.

        Parameters
        ----------
        offset : ndarray, shape (n,)
            E.g. nominal values; the solution is the difference from them.

        Returns
        -------
        Information
            Of the target ``Y - Phi offset``.

        """
        table = self.extended
        table[:, -1] -= table[:, :-1] @ offset.astype(np.longdouble)
        return _information(table, self.rows)

    def marginalised(self, keep: Sequence[int]) -> 'Information':
        """
        Eliminate all other unknowns: what the data say of some, whatever the others are.

        The Schur complement in square-root form: the trailing part of the factor with the
        eliminated columns first. The residual and its degrees of freedom stay what they were.

        Parameters
        ----------
        keep : sequence of int
            Indices of the unknowns to keep, in the order of the result.

        Returns
        -------
        Information
            Of fewer rows: each independent unknown that is eliminated takes one with it.

        Raises
        ------
        DataError
            If an index is out of range or occurs twice.

        """
        kept = list(keep)
        if len(set(kept)) != len(kept) or not set(kept) <= set(range(self.size)):
            raise DataError(
                f'unknowns to keep: {kept}, expected different numbers from 0 to {self.size - 1}'
            )
        others = _independent(self.factor, [i for i in range(self.size) if i not in kept])
        # A column that depends on eliminated ones is eliminated with them.
        order = [*others, *kept, self.size]
        table = absorbed(np.zeros((len(order),) * 2, np.longdouble), self.extended[:, order])
        rest = table[len(others) :, len(others) :]
        return _information(rest, max(self.rows - len(others), 0))

    def without(self, held: Sequence[int]) -> 'Information':
        """
        Hold some unknowns at zero: what the data say of the others if these are right.

        Parameters
        ----------
        held : sequence of int
            Indices of the unknowns.

        Returns
        -------
        Information
            Of as many rows, on the others in their order.

        """
        rest = [i for i in range(self.size + 1) if i not in set(held)]
        empty = np.zeros((len(rest),) * 2, np.longdouble)
        return _information(absorbed(empty, self.extended[:, rest]), self.rows)

    def solve(self) -> Solution:
        """
        Solve by a rank-revealing factorisation of the column-scaled factor.

        It is made in double precision and refined with residuals in extended precision.

        Returns
        -------
        Solution

        """
        n = self.size
        factor = self.extended
        lengths = np.linalg.norm(self.factor[:n, :n], axis=0)
        scale = np.where(lengths > 0, lengths, 1.0)
        scaled = factor[:n, :n] / scale
        left, singular, right = np.linalg.svd(scaled.astype(np.float64))
        largest = singular.max(initial=0.0)
        rank = int((singular > RANK_TOLERANCE * largest).sum())
        pseudo_inverse = (right[:rank].T / singular[:rank]) @ left[:, :rank].T
        wanted: NDArray[np.longdouble] = np.column_stack((np.eye(n), factor[:n, n]))
        refined = np.zeros(wanted.shape, np.longdouble)
        for _ in range(REFINEMENTS):
            refined += pseudo_inverse @ (wanted - scaled @ refined).astype(np.float64)
        refined /= scale[:, np.newaxis]
        values = refined[:, n].astype(np.float64)
        null_space = right[rank:].T
        condition_of_seen = largest / singular[rank - 1] if rank else 1.0
        return Solution(
            values=values,
            inverse=(refined[:, :n] @ refined[:, :n].T).astype(np.float64),
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


def merge_by_name(
    parts: Sequence[tuple[Information, Sequence[str]]],
) -> tuple[Information, tuple[str, ...]]:
    """
    Join information on different unknowns that have some in common, e.g. of several machines.

    Parameters
    ----------
    parts : sequence of (Information, sequence of str)
        Each with the names of its unknowns. All rows with the same variance of noise; see
        `Information.scaled`.

    Returns
    -------
    information : Information
    names : tuple of str
        Its unknowns, in the order in which they occur first.

    Raises
    ------
    DataError
        If a part has another number of names than of unknowns, or a name twice.

    """
    for information, names in parts:
        if len(names) != information.size or len(set(names)) != len(names):
            raise DataError(
                f'information on {information.size} unknowns with the names '
                f'{", ".join(names) or "(none)"}: every unknown needs one name of its own'
            )
    union = tuple(dict.fromkeys(name for _, names in parts for name in names))
    place = {name: i for i, name in enumerate(union)}
    whole = np.zeros((len(union) + 1,) * 2, np.longdouble)
    for information, names in parts:
        table = np.zeros((information.size + 1, len(union) + 1), np.longdouble)
        table[:, [*(place[name] for name in names), len(union)]] = information.extended
        whole = absorbed(whole, table)
    return _information(whole, sum(information.rows for information, _ in parts)), union


def _information(triangle: NDArray[np.longdouble], rows: float) -> Information:
    """Split a factor in extended precision into two of double precision."""
    factor = triangle.astype(np.float64)
    return Information(factor, rows, (triangle - factor).astype(np.float64))


def _independent(factor: NDArray[np.float64], columns: list[int]) -> list[int]:
    """Choose columns on which the other ones depend."""
    table = factor[:-1, columns]
    lengths = np.linalg.norm(table, axis=0)
    table = table[:, lengths > 0] / lengths[lengths > 0]
    if not table.size:
        return []
    triangle, order = scipy.linalg.qr(table, mode='r', pivoting=True)
    pivots = np.abs(np.diagonal(triangle))
    rank = int((pivots > RANK_TOLERANCE * pivots[0]).sum())
    used = np.array(columns)[lengths > 0][order[:rank]]
    return [int(i) for i in used]
