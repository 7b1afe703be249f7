# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What can be wrong with a channel."""

from dataclasses import dataclass
from enum import IntFlag


class Condition(IntFlag):
    """Condition of a channel over a stretch of samples; values as in DataQuality.msg."""

    OK = 0
    GAP = 1  # samples missing between blocks
    REPEAT = 2  # samples delivered twice
    MISSING = 4  # no valid number
    SATURATED = 8  # at the end of the range
    STUCK = 16  # the same value again and again
    SPIKE = 32  # single samples far off
    HUM = 64  # 50 or 60 Hz and multiples that no motion explains
    DRIFT = 128  # zero point wanders
    NOISE = 256  # noise is not what the layout states
    ALIASING = 512  # content close to half the sample rate, or folded there
    INVERTED = 1024  # wrong sign
    SWAPPED = 2048  # has the readings of another channel
    GAIN = 4096  # gain inconsistent with the motion of the rigid bodies
    LOST = 8192  # not used any more: no valid sample for long

    @property
    def in_words(self) -> str:
        """Name of a single condition as people read it."""
        return str(self.name).lower()


# Samples with these are left out of the regression.
EXCLUDING = (
    Condition.REPEAT
    | Condition.MISSING
    | Condition.SATURATED
    | Condition.STUCK
    | Condition.SPIKE
    | Condition.LOST
)

# What is learned from a channel with these is wrong.
CONTRADICTING = Condition.INVERTED | Condition.SWAPPED | Condition.GAIN


@dataclass(frozen=True)
class Finding:
    """
    A fault of one channel, in words.

    Parameters
    ----------
    channel : str
        Name of the sensor.
    condition : Condition
        One bit.
    first_index, next_index : int
        Samples it was seen in: from the first, up to the one after the last.
    amount : float
        Size of the fault in `unit`; NaN where it has none.
    unit : str
    sentence : str
        What is seen, what to do; begins with the channel's name.

    """

    channel: str
    condition: Condition
    first_index: int
    next_index: int
    amount: float
    unit: str
    sentence: str
