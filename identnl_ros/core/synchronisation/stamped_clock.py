# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The clock of one source of a stream, by the stamps of its blocks."""

from collections import deque

from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.core.synchronisation.clock_fit import (
    Clock,
    ClockFit,
    ClockStep,
    CRYSTAL_TOLERANCE,
)
from identnl_ros.core.synchronisation.delay_tracking import CLOCK_WANDER
from identnl_ros.core.synchronisation.stream_source import StreamSource
import numpy as np
from numpy.typing import NDArray


class StampedClock:
    """
    When the samples of a source were taken.

    Parameters
    ----------
    source : StreamSource

    """

    def __init__(self, source: StreamSource) -> None:
        self._source = source
        self._rate = source.sample_rate
        self.stamps: deque[tuple[int, int]] = deque()
        """Index and time of the blocks that it was not given yet [ns]."""
        self.restart()

    def restart(self, keep_from: int | None = None) -> None:
        """
        Forget what is known, and all stamps or those before a sample.

        Parameters
        ----------
        keep_from : int or None
            Index of the sample; None: all.

        """
        self._fit = ClockFit(self._rate, CRYSTAL_TOLERANCE, CLOCK_WANDER)
        self._own: Clock | None = None
        self._fed: list[int] = []
        self._first = 0, 0
        self._steps = 0
        self.stamps = deque(
            one for one in self.stamps if keep_from is not None and one[0] >= keep_from
        )

    def feed(self, up_to: float | None = None, before_ns: int | None = None) -> list[
        tuple[int, int]
    ]:  # fmt: skip
        """
        Give stamps to the clock.

        Parameters
        ----------
        up_to : float or None
            Index after the last one to take; None: not by the index.
        before_ns : int or None
            Time after the last one to take; None: not by the time.

        Returns
        -------
        list of tuple of int
            Index and time of those taken [ns].

        """
        taken: list[tuple[int, int]] = []
        while self.stamps and (up_to is None or self.stamps[0][0] < up_to):
            if before_ns is not None and self.stamps[0][1] >= before_ns:
                break
            index, stamp = self.stamps.popleft()
            if not self._fed:
                self._first = index, stamp
            self._fed = [*self._fed[:1], index]
            if self._source.start_deviation is None:
                self._fit.add(index, stamp)
                taken.append((index, stamp))
            elif self._own is None:
                deviations = np.array([self._source.start_deviation, CRYSTAL_TOLERANCE])
                # About the begin: offset and skew are told apart.
                shift = np.array([[1.0, -index / self._rate], [0.0, 1.0]])
                covariance = shift @ np.diag(deviations**2) @ shift.T
                self._own = Clock(self._rate, stamp, -index / self._rate, 0.0, covariance, 0.0)
        return taken

    def step(self) -> ClockStep | None:
        """
        Find a step of the stamps that nobody has been told of.

        Returns
        -------
        ClockStep or None

        """
        found = self._fit.steps[self._steps :]
        self._steps = len(self._fit.steps)
        return found[-1] if found else None

    @property
    def placeable(self) -> bool:
        """Whether there are stamps enough to tell the times of samples."""
        return self._own is not None or self._fit.ready

    @property
    def followed(self) -> float:
        """Time over which stamps were given to the clock [s]; 0: too few of them."""
        if not self.placeable or not self._fed:
            return 0.0
        return (self._fed[-1] - self._fed[0]) / self._rate

    @property
    def fitted(self) -> Clock:
        """What is known of the clock; without stamps enough, that of the first one alone."""
        if self._own is None and not self._fit.ready:
            index, stamp = self._first
            wide = np.diag([1.0, CRYSTAL_TOLERANCE**2])
            return Clock(self._rate, stamp, -index / self._rate, 0.0, wide, 0.0)
        return self._own or self._fit.clock

    def host_time(self, place: float) -> int:
        """
        Tell the time of a sample by the stamps.

        Parameters
        ----------
        place : float
            [samples].

        Returns
        -------
        int
            [ns].

        """
        clock = self.fitted
        return clock.origin_ns + round(float(clock.time(np.array(place))) * NANOSECONDS)

    def place_at(self, host_ns: int) -> float:
        """
        Find the sample that was taken at a time, by the stamps.

        Parameters
        ----------
        host_ns : int
            [ns].

        Returns
        -------
        float
            [samples].

        """
        clock = self.fitted
        time = (host_ns - clock.origin_ns) / NANOSECONDS
        return (time - clock.offset) * self._rate / (1 + clock.skew)

    def uncertainty(self, place: float) -> NDArray[np.float64]:
        """
        Tell the covariance of delay and skew of readings that were placed by the stamps.

        Parameters
        ----------
        place : float
            Where [samples].

        Returns
        -------
        ndarray, shape (2, 2)

        """
        shift = np.array([[1.0, place / self._rate], [0.0, 1.0]])
        return np.asarray(shift @ self.fitted.covariance @ shift.T)
