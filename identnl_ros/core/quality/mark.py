# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the detectors share: a stretch of one channel, and how rarely they may be wrong."""

from dataclasses import dataclass

from identnl_ros.core.quality.condition import Condition

# Wrong findings of one detector that white noise may cause in one channel.
FALSE_ALARMS_PER_HOUR = 1e-3
ALL_CHANNELS = 'all channels'


@dataclass(frozen=True)
class Mark:
    """
    Samples that a detector finds fault with.

    Parameters
    ----------
    channel : int
        Index of the channel; -1: all.
    condition : Condition
        One bit.
    first_index, next_index : int
    amount : float
        Size of the fault [SI unit of the channel]; NaN where it has none.

    """

    channel: int
    condition: Condition
    first_index: int
    next_index: int
    amount: float = float('nan')


def chance_per_sample(sample_rate: float) -> float:
    """
    Turn the rate of false alarms into a probability per sample.

    Parameters
    ----------
    sample_rate : float
        [Hz].

    Returns
    -------
    float

    """
    return FALSE_ALARMS_PER_HOUR / (3600.0 * sample_rate)
