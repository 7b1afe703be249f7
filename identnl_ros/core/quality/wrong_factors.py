# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is wrong with channels that contradict: sign, gain, or exchanged with another."""

from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.consistency_sentences import Sentences
from identnl_ros.core.quality.contradictions import Contradictions, Gains, MISMATCHES
from identnl_ros.core.quality.leave_one_out import Reals
import numpy as np
from numpy.typing import NDArray

# Below it a factor does not describe what differs; it may be noise, or change within the stretch.
LEAST_COHERENCE = 0.7
INVERTED_FACTORS = (-1.5, -0.67)
# Share of the contradiction that may remain if two channels are exchanged.
EXCHANGED = 0.1
# A channel is right if its factor is known at least so well and no fault is seen.
HEALTHY = 0.3

RELATED = (Condition.INVERTED, Condition.SWAPPED, Condition.GAIN)

# A fault: the channel and what it is. What is said of it: amount, unit, sentence.
Fault = tuple[int, Condition]
Said = tuple[float, str, str]


def wrong_factors(
    search: Contradictions,
    kinds: NDArray[np.int64],
    sentences: Sentences,
    significant: float,
    tolerance: float,
) -> tuple[dict[Fault, Said], set[Fault]]:
    """
    Classify what is left out.

    Parameters
    ----------
    search : Contradictions
    kinds : ndarray of int, shape (n_channels,)
        Equal for channels that may be exchanged.
    sentences : Sentences
    significant : float
        Standard deviations of the noise that a factor must be off by, beyond
    tolerance : float
        which is no fault.

    Returns
    -------
    dict of Fault to Said
    set of Fault
        That channels do not have: their factors are known, and right.

    """
    gains = search.gains()
    shown: dict[Fault, Said] = {}
    limit = np.sqrt(
        (significant * gains.standard_deviation) ** 2 + (MISMATCHES * gains.uncertainty) ** 2
    )
    pairs = _exchanged(search, kinds)
    for one, other in pairs.items():
        both = all(_inverted(gains, limit, channel) for channel in (one, other))
        shown[one, Condition.SWAPPED] = (
            float('nan'), '', sentences.swapped(one, other, both),
        )  # fmt: skip
    for channel in search.left_out:
        if channel in pairs or not gains.coherence[channel] > LEAST_COHERENCE:
            continue
        spread = float(np.hypot(gains.standard_deviation, gains.uncertainty)[channel])
        value = float(gains.value[channel])
        if _inverted(gains, limit, channel):
            condition = Condition.INVERTED
        elif (
            gains.low[channel] - limit[channel] > 1 + tolerance
            or gains.high[channel] + limit[channel] < 1 - tolerance
        ):
            condition = Condition.GAIN
        else:
            continue
        rivals = search.rivals(channel)
        for suspect in (channel, *rivals):
            alike = [one for one in (channel, *rivals) if one != suspect]
            factor = value if suspect == channel or not value else 1 / value
            sentence = sentences.factor(
                suspect, condition, factor, spread * abs(factor / value), alike
            )
            shown[suspect, condition] = (factor, '1', sentence)
    wrong = {channel for channel, _ in shown}
    right = {
        (channel, condition)
        for channel in np.flatnonzero(search.used & (limit < HEALTHY))
        for condition in RELATED
        if int(channel) not in wrong
    }
    return shown, {(int(channel), condition) for channel, condition in right}


def _inverted(gains: Gains, limit: Reals, channel: int) -> bool:
    return bool(
        gains.coherence[channel] > LEAST_COHERENCE
        and gains.high[channel] + limit[channel] < 0
        and INVERTED_FACTORS[0] < gains.value[channel] < INVERTED_FACTORS[1]
    )


def _exchanged(search: Contradictions, kinds: NDArray[np.int64]) -> dict[int, int]:
    """Pair channels of a kind that explain each other."""
    found = search.comparison
    wrong = search.sums.valid & (search.excess(found) > search.limit(found))
    result: dict[int, int] = {}
    for one in search.left_out:
        others = np.flatnonzero((kinds == kinds[one]) & wrong)
        remaining = {
            int(other): search.exchange(one, int(other))
            for other in others
            if other != one and int(other) not in result
        }
        if one not in result and remaining:
            best = min(remaining, key=lambda other: remaining[other])
            if remaining[best] < EXCHANGED:
                result[one], result[best] = best, one
    return result
