# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is wrong with channels that contradict: sign, gain, or exchanged with another."""

from collections.abc import Mapping

from identnl_ros.core.quality.channel_comparison import Gains
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.consistency_sentences import Sentences
from identnl_ros.core.quality.contradictions import Contradictions, LEAST_COHERENCE
import numpy as np
from numpy.typing import NDArray

INVERTED_FACTORS = (-1.5, -0.67)
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
    standing: Mapping[Fault, float],
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
    standing : mapping of Fault to float
        Found before, their amounts.

    Returns
    -------
    dict of Fault to Said
    set of Fault
        Standing ones that channels do not have any more: their factors are known, and others.

    """
    gains = search.gains()
    shown: dict[Fault, Said] = {}
    pairs = _exchanged(search, kinds)
    for one, (other, may_be_inverted) in pairs.items():
        sentence = sentences.swapped(one, other, may_be_inverted)
        shown[one, Condition.SWAPPED] = float('nan'), '', sentence
        if may_be_inverted:
            shown[one, Condition.INVERTED] = float(gains.value[one]), '1', sentence
    for channel in search.left_out:
        condition = _condition(gains, channel, significant, tolerance)
        if channel in pairs or condition is None:
            continue
        explanations = search.explanations(channel)
        spread = float(np.hypot(gains.standard_deviation, gains.uncertainty)[channel])
        instead = {
            suspect: one for one in explanations for suspect in one
            if suspect not in search.left_out
        }  # fmt: skip
        suspects = (channel, *sorted(instead))
        both = () if instead else search.outvoting(channel)
        for suspect in suspects:
            alike = [one for one in suspects if one != suspect]
            own, said, value = gains, condition, float(gains.value[channel])
            if suspect != channel:
                if (suspect, condition) in shown:
                    continue
                own = search.gains(search.without(instead[suspect]))
                said = _condition(own, suspect, significant, tolerance) or condition
                value = float(own.value[suspect])
                spread = float(np.hypot(own.standard_deviation, own.uncertainty)[suspect])
            turned = abs(value - 1) / max(float(own.lean[suspect]), 1e-9)
            sentence = sentences.factor(suspect, said, value, spread, alike, turned, both)
            shown[suspect, said] = (value, '1', sentence)
    limit = gains.limit(significant)
    wrong = {channel for channel, _ in shown}
    reach = limit + np.maximum(gains.high - gains.value, gains.value - gains.low)
    right = {
        (channel, condition)
        for (channel, condition), amount in standing.items()
        if condition in RELATED
        and channel not in wrong
        and search.used[channel]
        and limit[channel] < HEALTHY
        # A gain that long windows have found is not refuted by short ones that cannot see it.
        and (
            condition is not Condition.GAIN or abs(amount - gains.value[channel]) > reach[channel]
        )
    }
    return shown, right


def _condition(
    gains: Gains, channel: int, significant: float, tolerance: float
) -> Condition | None:
    """Name what a factor means; None: nothing."""
    if not gains.coherence[channel] > LEAST_COHERENCE:
        return None
    if (
        gains.high[channel] + gains.limit(significant)[channel] < 0
        and INVERTED_FACTORS[0] < gains.value[channel] < INVERTED_FACTORS[1]
    ):
        return Condition.INVERTED
    return Condition.GAIN if gains.wrong(significant, tolerance)[channel] else None


def _exchanged(search: Contradictions, kinds: NDArray[np.int64]) -> dict[int, tuple[int, bool]]:
    """Pair channels of a kind that explain each other; whether two wrong signs do as well."""
    found = search.comparison
    wrong = search.sums.valid & (search.excess(found) > search.limit(found))
    result: dict[int, tuple[int, bool]] = {}
    for one in search.left_out:
        others = np.flatnonzero((kinds == kinds[one]) & wrong)
        remaining = {
            int(other): search.exchange(one, int(other))
            for other in others
            if other != one and int(other) not in result
        }
        if one not in result and remaining:
            best = min(remaining, key=lambda other: remaining[other].share)
            if remaining[best].likely:
                either = remaining[best].may_be_inverted
                result[one], result[best] = (best, either), (one, either)
    return result
