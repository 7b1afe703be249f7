# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Finite-difference and interpolation weights on equally spaced samples."""

from functools import cache

import numpy as np
from numpy.typing import NDArray


@cache
def stencil(derivative: int, offset: float, half_width: int) -> NDArray[np.float64]:
    """
    Weights of the samples around an instant that give a derivative there.

    Exact for polynomials up to degree ``2 * half_width``, after Fornberg (1988), Mathematics
    of Computation 51, 699-706.

    Parameters
    ----------
    derivative : int
        0 interpolates.
    offset : float
        The instant, in samples from the centre of the stencil.
    half_width : int
        Samples on either side of the centre.

    Returns
    -------
    ndarray, shape (2 * half_width + 1,)
        Per sample interval to the power of the derivative; earliest sample first; read-only.

    """
    nodes = np.arange(-half_width, half_width + 1, dtype=np.float64) - offset
    weights: NDArray[np.float64] = np.zeros((derivative + 1, nodes.size))
    weights[0, 0] = 1.0
    previous_product = 1.0
    for j in range(1, nodes.size):
        product = 1.0
        orders = range(min(j, derivative), -1, -1)
        latest = weights[:, j - 1].copy()
        for i in range(j):
            gap = nodes[j] - nodes[i]
            product *= gap
            for k in orders:
                lower = weights[k - 1, i] if k else 0.0
                weights[k, i] = (nodes[j] * weights[k, i] - k * lower) / gap
        for k in orders:
            lower = latest[k - 1] if k else 0.0
            weights[k, j] = previous_product / product * (k * lower - nodes[j - 1] * latest[k])
        previous_product = product
    result: NDArray[np.float64] = weights[derivative]
    result = result.copy()
    result.flags.writeable = False  # shared by all who ask for it
    return result
