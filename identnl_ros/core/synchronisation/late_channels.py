# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The least number of late channels that explains delays known up to a common one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# A delay so many standard deviations from 0 is there: of a hundred channels, one in 150 bags
# without delays shows one.
SIGNIFICANT = 4.0
# Of the information; combinations of delays that have less are not determined.
NOTHING = 1e-12


@dataclass(frozen=True)
class LateChannels:
    """
    Which channels of a group are late, and by how much all are.

    Parameters
    ----------
    late : frozenset of int
        The others agree.
    rivals : tuple of frozenset of int
        Others of the same size that explain the data too; none: it is unique.
    delays, standard_deviations : ndarray, shape (n_channels,)
        Against those that agree [s].

    """

    late: frozenset[int]
    rivals: tuple[frozenset[int], ...]
    delays: NDArray[np.float64]
    standard_deviations: NDArray[np.float64]


def late_channels(delays: NDArray[np.float64], covariance: NDArray[np.float64]) -> LateChannels:
    """
    Find the largest number of channels that agree; the others are late.

    Every channel is tried as the one that others agree with (consensus, Fischler and Bolles
    1981); then those that the agreeing ones together find late are taken out, and those that
    they find right are taken back.

    Parameters
    ----------
    delays : ndarray, shape (n_channels,)
        Up to a common delay [s].
    covariance : ndarray, shape (n_channels, n_channels)
        Of these; without information on the common delay.

    Returns
    -------
    LateChannels

    """
    information: NDArray[np.float64] = np.linalg.pinv(covariance, NOTHING, True).astype(np.float64)
    score = information @ delays
    variance = np.diag(covariance)
    found = set()
    for channel in range(len(delays)):
        apart = variance + variance[channel] - 2 * covariance[channel]
        differs = (delays - delays[channel]) ** 2 > SIGNIFICANT**2 * np.clip(apart, 0.0, None)
        differs[channel] = False
        found.add(_settled(information, score, frozenset(np.flatnonzero(differs).tolist())))
    least = min(len(one) for one in found)
    best = sorted((one for one in found if len(one) == least), key=sorted)
    best.sort(key=lambda one: _cost(information, score, one))
    told = np.array([_alone(information, score, best[0], one) for one in range(len(delays))])
    return LateChannels(best[0], tuple(best[1:]), told[:, 0], told[:, 1])


def _settled(
    information: NDArray[np.float64], score: NDArray[np.float64], late: frozenset[int]
) -> frozenset[int]:
    """Add channels that are late against the rest, take back those that are not."""
    count = len(score)
    for _ in range(2 * count):
        told = [_alone(information, score, late, one) for one in range(count)]
        sizes = np.array([abs(delay) / deviation for delay, deviation in told])
        others = np.array([one not in late for one in range(count)])
        new = np.where(others, sizes, 0.0)
        old = np.where(others, np.inf, sizes)
        if new.max() > SIGNIFICANT and others.sum() > 1:
            late = late | {int(np.argmax(new))}
        elif old.min() <= SIGNIFICANT:
            late = late - {int(np.argmin(old))}
        else:
            break
    return late


def _alone(
    information: NDArray[np.float64],
    score: NDArray[np.float64],
    late: frozenset[int],
    channel: int,
) -> tuple[float, float]:
    """Delay of a channel against all but the late ones, and its standard deviation."""
    others = sorted(late - {channel})
    row = information[channel, others]
    weights = np.linalg.pinv(information[np.ix_(others, others)], NOTHING, True) @ row
    told = float(information[channel, channel] - row @ weights)
    if told <= NOTHING**0.5 * information[channel, channel]:
        return 0.0, np.inf
    return float(score[channel] - score[others] @ weights) / told, told**-0.5


def _cost(
    information: NDArray[np.float64], score: NDArray[np.float64], late: frozenset[int]
) -> float:
    """Squared misfit that is left, but for a constant."""
    some = sorted(late)
    inverse = np.linalg.pinv(information[np.ix_(some, some)], NOTHING, True)
    return -float(score[some] @ inverse @ score[some])
