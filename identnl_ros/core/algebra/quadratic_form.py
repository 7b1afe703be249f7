# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Probabilities of sums of squares of normal deviates, unequally weighed."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

# Nearer than this to the mean the formula divides zero by zero.
_NEAR_MEAN = 1e-4


def tail_probability(weights: NDArray[np.float64], degrees: NDArray[np.float64]) -> float:
    """
    Probability that a weighted sum of independent chi-squared variables is positive.

    With negative weights this is the distribution of a ratio: of Fisher's F, for example, or of
    a sum of correlated squares over an estimated variance. By the saddlepoint (Kuonen 1999,
    Saddlepoint approximations for distributions of quadratic forms in normal variables,
    Biometrika 86; Barndorff-Nielsen's form): good to some percent of the probability, however
    small that is.

    Parameters
    ----------
    weights : ndarray, shape (n,)
    degrees : ndarray, shape (n,)
        Degrees of freedom of each variable; fractions are allowed, 0 leaves it out.

    Returns
    -------
    float

    """
    used = (degrees > 0) & (weights != 0)
    weights, degrees = weights[used], degrees[used]
    if not (weights > 0).any():
        return 0.0
    if not (weights < 0).any():
        return 1.0
    scale = float(np.abs(weights).max())
    weights = weights / scale
    if not (weights > np.finfo(float).eps).any():
        return 0.0
    # The cumulant-generating function exists between these two.
    low, high = 0.5 / weights.min(), 0.5 / weights.max()

    def slope(place: float) -> float:
        return float(np.sum(degrees * weights / (1 - 2 * place * weights)))

    margin = 1e-12
    saddle = float(brentq(slope, low * (1 - margin), high * (1 - margin), xtol=1e-14, rtol=1e-13))
    share = 1 - 2 * saddle * weights
    deviance = float(np.sum(degrees * np.log(share)))
    root = np.sign(saddle) * np.sqrt(max(deviance, 0.0))
    steep = saddle * np.sqrt(2 * float(np.sum(degrees * (weights / share) ** 2)))
    if abs(root) < _NEAR_MEAN or steep == 0:
        return 0.5
    return float(ndtr(-(root + np.log(steep / root) / root)))
