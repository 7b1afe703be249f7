# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Absorb rows into a triangular factor, in extended precision.

Householder reflections of one row of the triangle and all new rows at a time (Golub and Van Loan,
Matrix Computations, section 6.5). Each block rounds the factor once more; in ``numpy.longdouble``
that is far below the rounding of the double-precision rows themselves, whatever the number of
blocks. Where ``longdouble`` is no wider than ``double`` the same code runs in double precision.
"""

import numpy as np
from numpy.typing import NDArray

# Blocks of at most this many rows are absorbed as they are. Longer ones are first reduced to a
# triangle by LAPACK in double precision, which rounds them about as much as a computer with
# doubles has rounded them already: extended precision throughout would take ten times as long.
EXTENDED_ROWS = 100


def absorbed(
    triangle: NDArray[np.longdouble], rows: NDArray[np.floating]
) -> NDArray[np.longdouble]:
    """
    Triangular factor of a triangular factor and more rows.

    Parameters
    ----------
    triangle : ndarray, shape (n, n)
        Upper triangular.
    rows : ndarray, shape (n_rows, n)

    Returns
    -------
    ndarray, shape (n, n)
        Upper triangular ``R`` with ``R^T R = triangle^T triangle + rows^T rows``.

    """
    if len(rows) > EXTENDED_ROWS:
        # Columns that are zero cost nothing.
        used = np.count_nonzero(rows, axis=0) > 0
        reduced = np.linalg.qr(np.asarray(rows[:, used], np.float64), mode='r')
        rows = np.zeros((len(reduced), rows.shape[1]))
        rows[:, used] = reduced
    rest = rows.astype(np.longdouble)
    result = triangle.copy()
    for k in range(len(result)):
        column = rest[:, k].copy()
        squares = column @ column
        if squares == 0:
            continue
        head = result[k, k]
        length = np.sqrt(head * head + squares)
        pivot = head + np.copysign(length, head)
        overlap = pivot * result[k, k:] + column @ rest[:, k:]
        overlap /= length * abs(pivot)
        result[k, k:] -= pivot * overlap
        rest[:, k:] -= column[:, np.newaxis] * overlap
    return result
