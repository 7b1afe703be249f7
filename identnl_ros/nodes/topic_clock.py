# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Running index of messages: one message is one sample of a clock with jitter."""

from dataclasses import dataclass

# Share of the deviation of a stamp that moves the clock. It follows rates up to 2 % beside the
# nominal one with a lag of 0.4 samples, and averages the jitter of some 20 messages.
_GAIN = 0.05
# Messages without stamp come in bursts; a longer silence than this is a gap [ns].
_BURST_NS = 500_000_000


@dataclass(frozen=True)
class Numbered:
    """
    A message that counts.

    Parameters
    ----------
    index : int
        Of the sample.
    stamp_ns : int
        Of the clock at it, without jitter [ns].

    """

    index: int
    stamp_ns: int


class TopicClock:
    """
    Numbers messages by their stamps; lost ones make a jump.

    Parameters
    ----------
    rate : float
        Nominal [Hz].
    is_stamped : bool
        Whether the stamps are those of the measurement. Times of arrival say nothing of a single
        lost message: messages are counted then, and only a long silence makes a jump.

    """

    def __init__(self, rate: float, is_stamped: bool) -> None:
        self._period = 1e9 / rate
        self._is_stamped = is_stamped
        self._index: int | None = None
        self._base_ns = 0
        self._time = 0.0  # of the clock at the last message, since the first one [ns]
        self.dropped = 0

    def number(self, stamp_ns: int) -> Numbered | None:
        """
        Give a message its number.

        Parameters
        ----------
        stamp_ns : int
            [ns].

        Returns
        -------
        Numbered or None
            None: it is a duplicate or comes after a later one.

        """
        if self._index is None:
            self._index, self._base_ns = 0, stamp_ns
            return Numbered(0, stamp_ns)
        elapsed = stamp_ns - self._base_ns - self._time
        steps = round(elapsed / self._period)
        if not self._is_stamped and elapsed < self._period + _BURST_NS:
            steps = 1
        if steps < 1:
            self.dropped += 1
            return None
        self._index += steps
        self._time += steps * self._period
        self._time += _GAIN * (stamp_ns - self._base_ns - self._time)
        return Numbered(self._index, self._base_ns + round(self._time))
