# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Root of a covariance, of which parts may be unknown."""

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


def covariance_root(covariance: Reals) -> Reals:
    """
    Write a covariance as a product of a table with its transpose.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Rows and columns with NaN on the diagonal count as zero.

    Returns
    -------
    ndarray, shape (n, n_independent)

    """
    deviation = np.sqrt(np.maximum(np.nan_to_num(np.diag(covariance)), 0.0))
    known = deviation > 0
    scale = deviation[known]
    squares, shapes = np.linalg.eigh(
        np.nan_to_num(covariance[np.ix_(known, known)]) / np.outer(scale, scale)
    )
    root = np.zeros((len(deviation), int(known.sum())))
    root[known] = scale[:, np.newaxis] * shapes * np.sqrt(np.maximum(squares, 0.0))
    return root
