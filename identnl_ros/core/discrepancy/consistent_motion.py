# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Motion of rigid bodies from more sensors than it takes, without those that contradict the rest.

A sensor with a wrong sign or on the wrong place contradicts the others, whatever the machine does:
no motion of rigid bodies fits all readings. Sensors are left out, worst first, until one does.
"""

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Mean square of what no motion explains, over that of noise, that is let pass.
INCONSISTENT = 1.1
SMALLEST = 1e-9


def consistent_motion(readings: Reals, rows: Reals, noise: Reals) -> tuple[Reals, Reals]:
    """
    Find the map from readings to coordinates that uses consistent sensors only.

    Parameters
    ----------
    readings : ndarray, shape (n_samples, n_sensors)
        Of one kind.
    rows : ndarray, shape (n_sensors, n_coordinates)
        Reading per unit of every coordinate.
    noise : ndarray, shape (n_sensors,)
        Standard deviation of a reading.

    Returns
    -------
    matrix : ndarray, shape (n_coordinates, n_sensors)
        Coordinates that no sensor sees stay at zero.
    covariance : ndarray, shape (n_coordinates, n_coordinates)
        Of the noise of the coordinates.

    """
    white = readings / noise
    products = white.T @ white / len(white)
    weighted = rows / noise[:, np.newaxis]
    lengths = np.linalg.norm(weighted, axis=0)
    lengths[lengths == 0] = 1.0
    scaled = weighted / lengths
    used = np.ones(len(rows), dtype=np.bool_)
    rank = _rank(scaled)
    while _unexplained(scaled, products, used, rank) > INCONSISTENT:
        trials = {}
        for i in np.flatnonzero(used):
            fewer = used.copy()
            fewer[i] = False
            if _rank(scaled[fewer]) == rank:
                trials[i] = _unexplained(scaled, products, fewer, rank)
        if not trials or used.sum() <= rank + 1:
            break
        used[min(trials, key=lambda i: trials[i])] = False
    inverse = np.zeros((rows.shape[1], len(rows)))
    inverse[:, used] = np.linalg.pinv(scaled[used], rcond=SMALLEST)
    inverse /= lengths[:, np.newaxis]
    return inverse / noise, inverse @ inverse.T


def _rank(rows: Reals) -> int:
    return int(np.linalg.matrix_rank(rows, tol=SMALLEST))


def _unexplained(rows: Reals, products: Reals, used: NDArray[np.bool_], rank: int) -> float:
    """Mean square, per degree of freedom, of what no motion explains."""
    freedom = int(used.sum()) - rank
    if freedom <= 0:
        return 0.0
    left, sizes, _ = np.linalg.svd(rows[used], full_matrices=False)
    basis = left[:, sizes > SMALLEST]
    own = products[np.ix_(used, used)]
    return float(np.trace(own) - np.trace(basis.T @ own @ basis)) / freedom
