# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""One source of a stream: its newest samples, its stamps, and where the grid lies in them."""

from collections import deque
from dataclasses import dataclass

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.core.synchronisation.clock_fit import (
    Clock,
    ClockFit,
    ClockStep,
    CRYSTAL_TOLERANCE,
    HUBER,
)
from identnl_ros.core.synchronisation.delay_tracking import CLOCK_WANDER
from identnl_ros.core.synchronisation.resampling import interpolate, reach_of
import numpy as np
from numpy.typing import NDArray

Block = tuple[int, int, NDArray[np.float64]]

# A jump of the index by more is a new beginning [s].
LONGEST_GAP = 10.0
# Longest part that is kept of a source that the others do not follow [s].
LONGEST_BUFFER = 15.0


@dataclass(frozen=True)
class StreamSource:
    """
    A device with a sample clock of its own.

    Parameters
    ----------
    name : str
    channels : tuple of str
        Names of the sensors of the layout that the columns are.
    sample_rate : float
        Nominal [Hz].
    start_deviation : float or None
        None: stamps are times of the host, with jitter. Else: stamps count the source's own
        clock, and only their begin is known, with this standard deviation [s].

    Raises
    ------
    DataError
        If a number is out of its range.

    """

    name: str
    channels: tuple[str, ...]
    sample_rate: float
    start_deviation: float | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        if not (np.isfinite(self.sample_rate) and self.sample_rate > 0):
            raise DataError(
                f'source {self.name}: the sample rate is {self.sample_rate} Hz, expected a '
                'positive number'
            )
        if self.start_deviation is not None and not self.start_deviation > 0:
            raise DataError(
                f'source {self.name}: the standard deviation of its begin is '
                f'{self.start_deviation} s, expected a positive number'
            )


@dataclass(frozen=True)
class Line:
    """
    Where grid points lie among the samples of a source.

    Parameters
    ----------
    point : int
        A point of the grid.
    place : float
        Its place [samples of the source].
    step : float
        Samples per point.

    """

    point: int
    place: float
    step: float

    def at(self, point: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """
        Places of points.

        Parameters
        ----------
        point : ndarray or float

        Returns
        -------
        ndarray
            [samples of the source].

        """
        return np.asarray(self.place + self.step * (point - self.point))

    def point_of(self, index: float) -> float:
        """
        Find where a sample lies on the grid.

        Parameters
        ----------
        index : float
            [samples of the source].

        Returns
        -------
        float
            [points].

        """
        return self.point + (index - self.place) / self.step

    def moved(self, point: int, samples: float = 0.0, step: float = 0.0) -> 'Line':
        """
        Give the line from a point on, read later and faster.

        Parameters
        ----------
        point : int
        samples : float
            Moved at this point [samples of the source].
        step : float
            Samples per point more than before.

        Returns
        -------
        Line

        """
        return Line(point, float(self.at(point)) + samples, self.step + step)


class SourceStream:
    """
    What has come from a source and is still needed.

    Parameters
    ----------
    source : StreamSource
    grid_rate : float
        [Hz].
    places : list of int
        Columns of the layout that its channels are.

    """

    def __init__(self, source: StreamSource, grid_rate: float, places: list[int]) -> None:
        self.source = source
        self.rate = source.sample_rate
        self.places = places
        self.stretch = max(1.0, self.rate / grid_rate)
        self.line: Line | None = None
        """None: the source is not aligned (yet)."""
        self.silent = False
        self.longest_block = 0.0
        """Of those that have come [s]."""
        self.later: list[Block] = []
        """Blocks that began anew while the ones before are still being given."""
        self.lost = 0
        """Samples that the index told to be lost and nobody has been told of."""
        self._grid_rate = grid_rate
        self.restart()

    def restart(self, keep_from: int | None = None) -> None:
        """
        Forget the clock, and all samples or those before one.

        Parameters
        ----------
        keep_from : int or None
            Index of the sample; None: all.

        """
        self.line = None
        self._fit = ClockFit(self.rate, CRYSTAL_TOLERANCE, CLOCK_WANDER)
        self._own: Clock | None = None
        self._fed: list[int] = []
        self._first = 0, 0
        self._steps = 0
        if keep_from is None:
            self.begin = self.end = 0
            self._parts: list[NDArray[np.float64]] = []
            self.stamps: deque[tuple[int, int]] = deque()
        else:
            self.forget(keep_from)
            self.stamps = deque(one for one in self.stamps if one[0] >= keep_from)

    @property
    def samples(self) -> NDArray[np.float64]:
        """Those that are kept, from `begin` to `end`, shape (n_samples, n_channels)."""
        if len(self._parts) != 1:
            empty = np.empty((0, len(self.places)))
            self._parts = [np.concatenate((empty, *self._parts))]
        return self._parts[0]

    @property
    def began(self) -> bool:
        """Whether there are samples, or have been since it began."""
        return self.end > self.begin or self.line is not None

    def add(self, first_index: int, stamp_ns: int, samples: NDArray[np.float64]) -> bool:
        """
        Take a block.

        Parameters
        ----------
        first_index, stamp_ns, samples
            As `StreamAlignment.add` has them.

        Returns
        -------
        bool
            Whether it goes on where the last one ended, but for samples that were lost; else
            it is in `later`.

        """
        if self.later:
            self.later.append((first_index, stamp_ns, samples))
            return True
        if self.began:
            lost = first_index - self.end
            if lost < 0 or lost > LONGEST_GAP * self.rate:
                self.later.append((first_index, stamp_ns, samples))
                return False
            self.lost += lost
            if lost:
                self._parts.append(np.full((lost, len(self.places)), np.nan))
        else:
            self.begin = first_index
        self._parts.append(np.array(samples, dtype=np.float64))
        self.end = first_index + len(samples)
        self.stamps.append((first_index, stamp_ns))
        self.longest_block = max(self.longest_block, len(samples) / self.rate)
        excess = self.end - self.begin - int(LONGEST_BUFFER * self.rate)
        if excess > 0 and self.line is None:
            self.forget(self.begin + excess)
        return True

    def begin_anew(self) -> None:
        """Let the blocks that came later take the place of all."""
        blocks, self.later = self.later, []
        self.restart()
        for block in blocks:
            self.add(*block)

    def forget(self, before: int) -> None:
        """
        Let go of old samples.

        Parameters
        ----------
        before : int
            Index of the first one that is needed.

        """
        drop = int(np.clip(before - self.begin, 0, self.end - self.begin))
        if drop:
            self._parts = [self.samples[drop:]]
            self.begin += drop

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
            if self.source.start_deviation is None:
                self._fit.add(index, stamp)
                taken.append((index, stamp))
            elif self._own is None:
                deviations = np.array([self.source.start_deviation, CRYSTAL_TOLERANCE])
                # About the begin: offset and skew are told apart.
                shift = np.array([[1.0, -index / self.rate], [0.0, 1.0]])
                covariance = shift @ np.diag(deviations**2) @ shift.T
                self._own = Clock(self.rate, stamp, -index / self.rate, 0.0, covariance, 0.0)
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
        return (self._fed[-1] - self._fed[0]) / self.rate

    @property
    def clock(self) -> Clock:
        """What is known of the clock; without stamps enough, that of the first one alone."""
        if self._own is None and not self._fit.ready:
            index, stamp = self._first
            wide = np.diag([1.0, CRYSTAL_TOLERANCE**2])
            return Clock(self.rate, stamp, -index / self.rate, 0.0, wide, 0.0)
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
        clock = self.clock
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
        clock = self.clock
        time = (host_ns - clock.origin_ns) / NANOSECONDS
        return (time - clock.offset) * self.rate / (1 + clock.skew)

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
        shift = np.array([[1.0, place / self.rate], [0.0, 1.0]])
        return np.asarray(shift @ self.clock.covariance @ shift.T)

    def read(
        self, points: NDArray[np.float64], line: Line, stretch: float | None = None
    ) -> NDArray[np.float64]:
        """
        Give the readings at points of the grid.

        Parameters
        ----------
        points : ndarray, shape (n_points,)
        line : Line
        stretch : float or None
            Samples of the source per point, if the points are coarser than the grid.

        Returns
        -------
        ndarray, shape (n_points, n_channels)
            NaN where there is nothing; bit for bit the samples where points lie on them.

        """
        place = line.at(points) - self.begin
        if stretch is None and line.step == 1.0 and float(line.place).is_integer():
            rows = place.astype(np.int64)
            result = np.full((len(points), len(self.places)), np.nan)
            known = (rows >= 0) & (rows < len(self.samples))
            result[known] = self.samples[rows[known]]
            return result
        return interpolate(self.samples, place, self.stretch if stretch is None else stretch)

    def needed_after(self, line: Line) -> int:
        """
        Count the samples after a point that its reading is made from.

        Parameters
        ----------
        line : Line

        Returns
        -------
        int

        """
        on_samples = line.step == 1.0 and float(line.place).is_integer()
        return 1 if on_samples else reach_of(self.stretch) + 1


def robust_mean(values: NDArray[np.float64], deviation: float) -> float:
    """
    Estimate a mean that late arrivals hardly move: Huber's, as the clocks are fitted.

    Parameters
    ----------
    values : ndarray
    deviation : float
        Standard deviation of one of them.

    Returns
    -------
    float

    """
    mean = float(np.median(values))
    for _ in range(10):
        away = np.abs(values - mean)
        weights = HUBER * deviation / np.maximum(away, HUBER * deviation)
        mean = float(weights @ values / weights.sum())
    return mean
