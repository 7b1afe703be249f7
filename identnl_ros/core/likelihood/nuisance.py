# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Least squares with unknowns common to all records and unknowns of each record alone."""

from dataclasses import dataclass, replace

from identnl_ros.core.algebra.information import Information, Solution
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

# Rows that hold what a record does not determine of its own unknowns, relative to what it
# determines best: far too weak to move anything else.
HOLD = 1e-7


# Rows that LAPACK triangularises together: fits the cache. Many more make it, with several
# threads on a long and narrow table, ten times slower.
ROWS_AT_ONCE = 1024


def with_many_rows(
    information: Information, regressor: NDArray[np.float64], target: NDArray[np.float64]
) -> Information:
    """
    Add many rows.

    Parameters
    ----------
    information : Information
    regressor : ndarray, shape (n_rows, n)
    target : ndarray, shape (n_rows,)

    Returns
    -------
    Information

    """
    triangle = np.empty((0, information.size + 1))
    for start in range(0, target.size, ROWS_AT_ONCE):
        part = slice(start, start + ROWS_AT_ONCE)
        rows = np.column_stack((regressor[part], target[part]))
        triangle = np.asarray(np.linalg.qr(np.vstack((triangle, rows)), mode='r'))
    added = information.with_rows(triangle[:, :-1], triangle[:, -1])
    return replace(added, rows=information.rows + target.size)


@dataclass(frozen=True)
class Step:
    """
    Solution of the joint least squares.

    Parameters
    ----------
    common : ndarray, shape (n_common,)
    own : tuple of ndarray, each shape (n_own,)
        Of each record.
    size : float
        Root mean square over all unknowns of the step in standard errors [-].
    solution : Solution
        Of the common unknowns, those of the records eliminated.

    """

    common: NDArray[np.float64]
    own: tuple[NDArray[np.float64], ...]
    size: float
    solution: Solution


@dataclass(frozen=True)
class RecordInformation:
    """
    What one record tells of its own and of the common unknowns.

    Parameters
    ----------
    information : Information
        Of the own unknowns, then the common ones.
    n_own : int
        Even: initial displacement, then initial velocity.

    """

    information: Information
    n_own: int

    def reduced(self, damping: float = 0.0) -> NDArray[np.float64]:
        """
        Triangularise with the own unknowns held where nothing else holds them.

        Parameters
        ----------
        damping : float
            Of Levenberg and Marquardt, relative to the squared column lengths.

        Returns
        -------
        ndarray, shape (n + 1, n + 1)
            Its lower right part is the information on the common unknowns.

        """
        factor = self.information.factor
        lengths = np.linalg.norm(factor[:, : self.n_own], axis=0)
        half = self.n_own // 2
        longest = np.repeat([lengths[:half].max(initial=0), lengths[half:].max(initial=0)], half)
        hold = np.zeros((self.n_own, factor.shape[1]))
        np.fill_diagonal(hold, np.sqrt((HOLD * longest) ** 2 + damping * lengths**2))
        return np.asarray(np.linalg.qr(np.vstack((factor, hold)), mode='r'))

    def marginal(self, damping: float = 0.0) -> Information:
        """
        Eliminate the own unknowns.

        Parameters
        ----------
        damping : float
            As in `reduced`.

        Returns
        -------
        Information
            On the common unknowns.

        """
        triangle = self.reduced(damping)
        return Information(
            np.ascontiguousarray(triangle[self.n_own :, self.n_own :]),
            self.information.rows - self.n_own,
        )


def joint_step(
    records: list[RecordInformation], damping: float = 0.0, common_held: bool = False
) -> Step:
    """
    Solve for all unknowns of all records.

    Parameters
    ----------
    records : list of RecordInformation
        At least one.
    damping : float
        Of Levenberg and Marquardt, relative to the squared column lengths; 0: Gauss-Newton.
    common_held : bool
        Solve for the records' own unknowns only.

    Returns
    -------
    Step

    """
    total = Information.empty(records[0].information.size - records[0].n_own)
    for record in records:
        total = total.merged(record.marginal(damping))
    if damping > 0:
        lengths = np.linalg.norm(total.factor[:-1, :-1], axis=0)
        total = total.with_rows(np.sqrt(damping) * np.diag(lengths), np.zeros(total.size))
    solution = total.solve()
    common = np.zeros(total.size) if common_held else solution.values
    own = []
    squares = 0.0
    for record in records:
        n = record.n_own
        triangle = record.reduced(damping)
        target = triangle[:n, -1] - triangle[:n, n:-1] @ common
        diagonal = np.abs(np.diag(triangle[:n, :n]))
        step = np.zeros(n)
        if n and diagonal.min() > 0:
            step = solve_triangular(triangle[:n, :n], target)
        own.append(step)
        moved = record.information.factor[:, :-1] @ np.concatenate((step, common))
        squares += float(moved @ moved)
    unknowns = len(common) + sum(record.n_own for record in records)
    return Step(common, tuple(own), float(np.sqrt(squares / max(unknowns, 1))), solution)
