# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Drift: zero points that wander while those of the other channels of the kind do not."""

from identnl_ros.core.quality.channel_comparison import TINY
from identnl_ros.core.quality.leave_one_out import Flags, leave_one_out, Reals
from identnl_ros.core.quality.redundancy import most_suspect, Redundancy, Suspect
import numpy as np

PARTS = 3
SIGNIFICANT = 6.0
# Of the change of the motion itself, which usual errors of gain and direction leave.
LEAST_OF_MOTION = 0.05


def drift_in(
    redundancy: Redundancy, means: Reals, used: Flags, judged: Flags, least: Reals, noise: Reals
) -> tuple[dict[int, Suspect], Reals]:
    """
    Find channels whose mean walks, largest first, each left out before the next.

    The stretch is cut into three; a zero point that wanders has different means in them.

    Parameters
    ----------
    redundancy : Redundancy
    means : ndarray, shape (n_means, n_channels)
        Of the readings over equal times, in order; NaN: not valid.
    used : ndarray of bool, shape (n_channels,)
        Channels that follow the motion: they predict the others.
    judged : ndarray of bool, shape (n_channels,)
        Channels in which drift is looked for.
    least : ndarray, shape (n_channels,)
        Smallest range of the three means that is called drift [SI].
    noise : ndarray, shape (n_channels,)
        Standard deviation of one of the means given, from the noise of the sensor alone [SI].

    Returns
    -------
    dict of int to Suspect
        Channels that drift: largest difference between the three [SI].
    ndarray, shape (n_channels,)
        Smallest range that would be seen [SI]; infinite where nothing tells.

    """
    rows = redundancy.by_kind(redundancy.rows)
    groups = redundancy.groups(rows)
    whole = np.isfinite(means).all(axis=0)
    remaining, judged = used & whole, judged & whole
    values = np.where(whole, means, 0.0)
    parts = np.array_split(values, PARTS)
    three = np.stack([part.mean(axis=0) for part in parts])
    inside = np.concatenate([part - part.mean(axis=0) for part in parts])
    variance = np.maximum(noise**2, TINY)[np.newaxis]
    nearby = [redundancy.by_kind(one) for one in redundancy.nearby]
    rivals: dict[int, tuple[int, ...]] = {}
    while True:
        fit = leave_one_out(rows, variance, remaining)
        errors = fit.errors[0]
        ranges = np.ptp(three @ errors.T, axis=0)
        # Scatter that the data show, at least the sensors'; neighbours overlap by half.
        scatter = np.sqrt(
            np.maximum(((inside @ errors.T) ** 2).mean(axis=0), errors**2 @ variance[0])
        )
        scatter *= np.sqrt(2 * PARTS / len(values))
        moved = np.sqrt(sum(np.ptp(three @ fit.fit[0].T @ one.T, axis=0) ** 2 for one in nearby))
        limit = np.maximum.reduce(
            (least, SIGNIFICANT * scatter, LEAST_OF_MOTION * np.sqrt(errors**2 @ moved**2))
        )
        shown = fit.told & judged & (ranges > limit)
        weight = np.where(fit.told & remaining, ranges**2 / fit.variance[0], 0.0)
        new = most_suspect(weight, shown & remaining, groups)
        if not new:
            break
        rivals |= new
        remaining[list(new)] = False
    suspects = {
        int(i): Suspect(float(ranges[i]), rivals.get(int(i), ()))
        for i in np.flatnonzero(shown & ~remaining)
    }
    return suspects, np.where(fit.told & judged, limit, np.inf)
