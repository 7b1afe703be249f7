# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A mean that values far away hardly move."""

from identnl_ros.core.synchronisation.clock_fit import HUBER
import numpy as np
from numpy.typing import NDArray


def robust_mean(values: NDArray[np.float64], deviation: float) -> float:
    """
    Estimate a mean that late arrivals hardly move: Huber's, as the clocks are fitted.

    Parameters
    ----------
    values : ndarray
    deviation : float
        Standard deviation of one of them.

    Returns
    -------
    float

    """
    mean = float(np.median(values))
    for _ in range(10):
        away = np.abs(values - mean)
        weights = HUBER * deviation / np.maximum(away, HUBER * deviation)
        mean = float(weights @ values / weights.sum())
    return mean
