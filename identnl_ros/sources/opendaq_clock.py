# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The clock of openDAQ signals: what their domain signal says of time."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta, UTC
from fractions import Fraction
from itertools import pairwise
from typing import Any

from identnl_ros.core.errors import DataError
import numpy as np
from numpy.typing import NDArray

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class DomainClock:
    """
    A clock that counts ticks, a whole number of them from sample to sample.

    Parameters
    ----------
    resolution : Fraction
        Length of a tick [s].
    step : int
        Ticks from sample to sample.
    origin_ns : int or None
        Time of tick 0 since 1970-01-01 [ns]; None: the device does not know the time of day.

    """

    resolution: Fraction
    step: int
    origin_ns: int | None

    @property
    def sample_rate(self) -> float:
        """Samples per second [Hz]."""
        return float(1 / (self.resolution * self.step))

    def index(self, tick: int) -> int:
        """Give the number of a sample, which is the same after a new start."""
        return tick // self.step

    def stamp_ns(self, tick: int, origin_ns: int) -> int:
        """Time of a tick [ns], rounded down from its exact value."""
        return origin_ns + int(tick * self.resolution * 10**9 // 1)

    def runs(self, ticks: NDArray[np.int64]) -> Iterator[slice]:
        """Yield the parts of the ticks of consecutive samples in which none is missing."""
        edges = np.flatnonzero(np.diff(ticks) != self.step) + 1
        bounds = [0, *edges.tolist(), ticks.size]
        for first, end in pairwise(bounds):
            yield slice(first, end)


def clock_of(signal: Any, where: str) -> DomainClock:
    """
    Read what the domain signal of a signal says.

    Parameters
    ----------
    signal : opendaq.ISignal
    where : str
        Names the signal in errors.

    Returns
    -------
    DomainClock

    Raises
    ------
    DataError
        If its samples are not equally spaced in time.

    """
    domain = signal.domain_signal.descriptor
    parameters = domain.rule.parameters if domain is not None else None
    if not parameters or 'delta' not in parameters:
        raise DataError(
            f'{where} has no samples at a fixed rate (its time signal has no linear rule); '
            'leave it out of the channels'
        )
    unit = domain.unit.symbol if domain.unit is not None else ''
    if unit != 's':
        raise DataError(
            f'{where} is not sampled in time: its domain is in "{unit}", expected "s"; '
            'leave it out of the channels'
        )
    resolution, step = domain.tick_resolution, parameters['delta']
    if resolution is None or int(step) != step or step < 1 or resolution.numerator < 1:
        raise DataError(
            f'{where} has a time signal with {step} ticks from sample to sample, expected a whole '
            'number of them, at least 1, and a length of the tick'
        )
    return DomainClock(
        Fraction(resolution.numerator, resolution.denominator),
        int(step),
        _nanoseconds(domain.origin),
    )


def _nanoseconds(origin: str | None) -> int | None:
    """Read the ISO 8601 time of tick 0; without a zone it is UTC."""
    try:
        # Python reads at most six digits of a second; an origin needs none.
        time = datetime.fromisoformat((origin or '').replace('.000000000', ''))
    except ValueError:
        return None
    if time.tzinfo is None:
        time = time.replace(tzinfo=UTC)
    return (time - _EPOCH) // timedelta(microseconds=1) * 1000
