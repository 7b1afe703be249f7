# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is known of the faults of every channel so far, and how people are told."""

from dataclasses import dataclass

from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.quality.condition import Condition, Finding
from identnl_ros.core.quality.mark import ALL_CHANNELS
from identnl_ros.core.readable import readable
import numpy as np
from numpy.typing import NDArray

# A fault that comes back after this is told again [s].
QUIET = 1.0
_ALL = -1


@dataclass
class _Fault:
    """A fault of a channel: where it was seen, how often, its largest size."""

    first_index: int
    next_index: int
    samples: int = 0
    episodes: int = 1
    amount: float = float('nan')


class FaultRecord:
    """
    Faults of every channel since the begin of the stream; one entry for a channel and condition.

    Parameters
    ----------
    layout : Layout
    sample_rate : float
        [Hz].

    """

    def __init__(self, layout: Layout, sample_rate: float) -> None:
        self._sensors = layout.sensors
        self._rate = sample_rate
        self._faults: dict[tuple[int, Condition], _Fault] = {}
        self._news: set[tuple[int, Condition]] = set()

    def add(
        self,
        channel: int,
        condition: Condition,
        first_index: int,
        next_index: int,
        samples: int,
        amount: float = float('nan'),
    ) -> None:
        """
        Take note of a fault.

        Parameters
        ----------
        channel : int
            -1: all.
        condition : Condition
            One bit.
        first_index, next_index : int
            Where it was seen.
        samples : int
            How many samples it concerns.
        amount : float
            Its size; the largest absolute one is kept.

        """
        key = channel, condition
        fault = self._faults.get(key)
        if fault is None:
            fault = self._faults[key] = _Fault(first_index, next_index)
            self._news.add(key)
        elif first_index - fault.next_index > QUIET * self._rate:
            fault.episodes += 1
            self._news.add(key)
        fault.next_index = max(fault.next_index, next_index)
        fault.samples += samples
        if not abs(amount) <= abs(fault.amount):
            fault.amount = amount if np.isfinite(amount) else fault.amount

    def news(self) -> tuple[Finding, ...]:
        """
        Tell what has begun since the last call.

        Returns
        -------
        tuple of Finding

        """
        findings = tuple(self._finding(*key) for key in sorted(self._news))
        self._news.clear()
        return findings

    def findings(self) -> tuple[Finding, ...]:
        """
        Tell all faults so far.

        Returns
        -------
        tuple of Finding

        """
        return tuple(self._finding(*key) for key in sorted(self._faults))

    def _finding(self, channel: int, condition: Condition) -> Finding:
        fault = self._faults[channel, condition]
        name = ALL_CHANNELS if channel == _ALL else self._sensors[channel].name
        unit = '' if channel == _ALL else self._sensors[channel].kind.unit
        times = f' in {fault.episodes} stretches' if fault.episodes > 1 else ''
        what = _WORDS[condition].format(
            samples=f'{fault.samples} sample{"s" if fault.samples != 1 else ""}',
            amount=readable(fault.amount, unit),
            expected=readable(self._sensors[channel].noise, unit),
            since=f'from {fault.first_index / self._rate:.4g} s on{times}',
        )
        return Finding(
            channel=name,
            condition=condition,
            first_index=fault.first_index,
            next_index=fault.next_index,
            amount=fault.amount,
            unit=unit,
            sentence=f'{name}: {what}',
        )


_WORDS = {
    Condition.GAP: (
        '{samples} missing {since}; check cables and the load of the recording computer'
    ),
    Condition.REPEAT: (
        '{samples} delivered before come again {since}, left out; check how the source reads '
        'its buffers'
    ),
    Condition.MISSING: (
        '{samples} without a valid number (none, infinite or beyond 1e30) {since}; check cable '
        'and source'
    ),
    Condition.SATURATED: (
        'at the end of the range ({amount}) for {samples} {since}, left out; choose a larger '
        'range or a smaller force'
    ),
    Condition.STUCK: ('stuck at {amount} for {samples} {since}, left out; check cable and supply'),
    Condition.SPIKE: (
        '{samples} far off, by up to {amount}, {since}, left out; check connectors and shielding'
    ),
    Condition.NOISE: (
        'noise of {amount} instead of the {expected} stated {since}; measure the noise at rest '
        'and state it in the layout file, or check the sensor'
    ),
    Condition.ALIASING: (
        'content close to half the sample rate, as noise of {amount} would have, {since}; use '
        'an anti-aliasing filter or a higher sample rate, or find the source of interference'
    ),
    Condition.LOST: (
        'no valid sample for long: {samples} not used {since}; check cable, supply and source'
    ),
}


def bits_set(flags: NDArray[np.uint16]) -> tuple[Condition, ...]:
    """
    List the conditions that occur.

    Parameters
    ----------
    flags : ndarray of uint16

    Returns
    -------
    tuple of Condition

    """
    together = int(np.bitwise_or.reduce(flags, axis=None))
    return tuple(condition for condition in Condition if together & condition)
