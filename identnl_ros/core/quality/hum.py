# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Hum: lines of the mains in a channel that the others do not have."""

from dataclasses import dataclass

from identnl_ros.core.quality.channel_comparison import BandSums, compared, motion_at_sensors, TINY
from identnl_ros.core.quality.contradictions import USUAL_MISMATCH
from identnl_ros.core.quality.leave_one_out import Flags, leave_one_out, Reals
from identnl_ros.core.quality.redundancy import most_suspect, Redundancy, Suspect
import numpy as np

# A line has this many times the power of what is beside it: chance leaves a mean of 15
# overlapping segments below 4 times in all but one of 1e8 cases.
OVER_SIDE = 6.0
# Hum smaller than this share of the motion at its frequency may be a wrong gain or direction.
LEAST_OF_MOTION = 0.01
# Power at the line's bin over that of its neighbours: a line within a bin of it has 0.44 or more.
CENTRED = 0.4


@dataclass(frozen=True)
class LineSums:
    """
    Sums at one line: at its bin, the bin below, the bin above, and beside.

    Parameters
    ----------
    frequency : float
        [Hz].
    at, below, above, beside : BandSums

    """

    frequency: float
    at: BandSums
    below: BandSums
    above: BandSums
    beside: BandSums


def hum_at(
    redundancy: Redundancy,
    line: LineSums,
    used: Flags,
    judged: Flags,
    mismatch: Reals,
    least: Reals,
) -> tuple[dict[int, Suspect], Reals]:
    """
    Find channels with hum at one line, largest first, each left out before the next.

    Parameters
    ----------
    redundancy : Redundancy
    line : LineSums
    used : ndarray of bool, shape (n_channels,)
        Channels that follow the motion: they predict the others.
    judged : ndarray of bool, shape (n_channels,)
        Channels in which hum is looked for.
    mismatch : ndarray, shape (n_channels,)
        Largest error relative to the motion that is no hum.
    least : ndarray, shape (n_channels,)
        Smallest power of hum, as that of a spectrum.

    Returns
    -------
    dict of int to Suspect
        Channels with hum: its power in a spectrum.
    ndarray, shape (n_channels,)
        Smallest power that would be seen; infinite where nothing tells.

    """
    motion = motion_at_sensors(redundancy, line.at)
    variance = np.maximum(line.at.noise + USUAL_MISMATCH**2 * motion, TINY)
    groups = redundancy.sets
    share = np.maximum(LEAST_OF_MOTION, mismatch) ** 2
    remaining = used.copy()
    rivals: dict[int, tuple[int, ...]] = {}
    while True:
        fit = leave_one_out(redundancy.rows, variance, remaining)
        mean = {
            name: compared(fit, part.products, part.noise, motion)
            for name, part in (('at', line.at), ('below', line.below), ('above', line.above),
                               ('beside', line.beside))
        }  # fmt: skip
        levels = {name: one.error[0] / getattr(line, name).counts[0] for name, one in mean.items()}
        floor = np.maximum(levels['beside'], mean['at'].noise[0])
        beside = np.maximum(levels['below'], levels['above'])
        power = np.where(fit.told & judged, np.maximum(levels['at'], beside) - floor, 0.0)
        limit = np.maximum.reduce((least, (OVER_SIDE - 1) * floor, share * mean['at'].mismatch[0]))
        centred = levels['at'] > CENTRED * beside
        shown = (power > limit) & centred
        weight = np.where(remaining, power / fit.variance[0], 0.0)
        new = most_suspect(weight, shown & remaining, groups)
        if not new:
            break
        rivals |= new
        remaining[list(new)] = False
    found = {
        int(i): Suspect(float(power[i]), rivals.get(int(i), ()))
        for i in np.flatnonzero(shown & ~remaining)
    }
    return found, np.where(fit.told & judged, limit, np.inf)
