# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Smallest wrong gain that data can tell, channel by channel."""

from dataclasses import dataclass, replace

from identnl_ros.core.quality.channel_comparison import Gains
from identnl_ros.core.quality.contradictions import EQUAL_EVIDENCE
from identnl_ros.core.quality.leave_one_out import Reals
from identnl_ros.core.quality.redundancy import EQUAL_SHARE
import numpy as np
from scipy.stats import norm

# Probability with which a fault of the stated size is found.
POWER = 0.99
# Beyond it a factor is no matter of gain: nothing is stated.
LARGEST = 1.0


@dataclass(frozen=True)
class GainLimits:
    """
    Relative errors of gain that are found with a probability of 99 %, in either direction.

    Parameters
    ----------
    found : ndarray, shape (n_channels,)
        Told, be it with other names beside; infinite: none.
    named : ndarray, shape (n_channels,)
        Told of this channel alone; infinite: none.

    """

    found: Reals
    named: Reals


def gain_limits(gains: Gains, significant: float, tolerance: float) -> GainLimits:
    """
    Work out what a stretch of data could have shown.

    A fault is told if what is no fault, the limit of noise and mismatch, and what noise may hide
    all lie between it and one. It is named alone if the evidence against the channel exceeds that
    against every other by the margin: if the errors of two channels correlate by rho, a difference
    of mean D = (size / deviation)^2 (1 - rho^2) has the standard deviation 2 sqrt(D).

    Parameters
    ----------
    gains : Gains
    significant : float
        Standard deviations of the noise that a factor must be off by, beyond
    tolerance : float
        which is no fault.

    Returns
    -------
    GainLimits

    """
    gains = replace(gains, uncertainty=gains.elsewhere)
    harmless = gains.harmless(tolerance)
    quantile = float(norm.ppf(POWER))
    deviation = np.hypot(gains.standard_deviation, gains.uncertainty)
    with np.errstate(divide='ignore', invalid='ignore'):
        limit = gains.limit(significant) + quantile * deviation
        # All errors grow with the factor.
        below = np.minimum(gains.low / gains.value, 1.0) - limit
        upwards = np.where(below > 0, (1 + harmless) / below - 1, np.inf)
        # Noise of the channel itself counts the more, the smaller its reading.
        beyond = np.maximum(gains.high / gains.value, 1.0) - 1
        downwards = harmless + limit + beyond
        for _ in range(10):
            rest = np.clip(1 - downwards, 1e-3, None)
            downwards = np.minimum(harmless + limit + beyond / rest, LARGEST)
        found = np.maximum(upwards, downwards)
        found = np.where(found < LARGEST, found, np.inf)
        alike = (gains.response * deviation[np.newaxis] / deviation[:, np.newaxis]) ** 2
        np.fill_diagonal(alike, 0.0)
        apart = 1 - np.nan_to_num(alike).max(axis=0)
        distance = quantile + np.sqrt(quantile**2 + 2 * EQUAL_EVIDENCE)
        alone = deviation * distance / np.sqrt(np.maximum(apart, EQUAL_SHARE))
        alone = np.where(apart > 2 * EQUAL_SHARE, alone, np.inf)
    found = np.where(np.isfinite(gains.value), found, np.inf)
    named = np.maximum(found, alone)
    return GainLimits(found, np.where(named < LARGEST, named, np.inf))
