# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Where the grid of a stream lies in each of its sources, and how well that is known."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.alignment import ENOUGH, MOST_ROUNDS, SEARCH
from identnl_ros.core.synchronisation.damping_cost import damped_modes, delay_warning
from identnl_ros.core.synchronisation.delay_tracking import DELAY, DelayTracker, SKEW
from identnl_ros.core.synchronisation.grid_line import Line
from identnl_ros.core.synchronisation.motion_delay import motion_delays
from identnl_ros.core.synchronisation.robust_mean import robust_mean
from identnl_ros.core.synchronisation.source_stream import SourceStream
import numpy as np

# A delay that has become known is taken out within about so long [s].
SLEWING = 0.5
# Most by which that changes the rate [-].
MOST_SLEW = 1e-3
# From one look at the motion to the next [s].
UPDATE = 4.0
# Most samples of the time since the last look that are compared.
WINDOW = 8192
# Stamps of a host are no better than this [s].
LEAST_JITTER = 1e-7


@dataclass(frozen=True)
class SourceAlignment:
    """
    How a source is aligned.

    Parameters
    ----------
    name : str
    aligned : bool
        False: it has no readings on the grid.
    offset : float
        By which its readings were late beyond what the stamps said, when it was aligned [s].
    skew : float
        Of its clock against that of the reference; positive: it is slow [-].
    deviation : float
        Standard deviation of the delay that remains until the next look at the motion [s].

    """

    name: str
    aligned: bool
    offset: float
    skew: float
    deviation: float


class SourceAligner:
    """
    Keep the lines along which sources are read.

    Parameters
    ----------
    layout : Layout
    streams : list of SourceStream
    grid_rate : float
        [Hz].
    model : Model or None
    latency : float
        [s].
    remark : callable
        Called with sentences for the user.

    """

    def __init__(
        self,
        layout: Layout,
        streams: list[SourceStream],
        grid_rate: float,
        model: Model | None,
        latency: float,
        remark: Callable[[str], None],
    ) -> None:
        self._layout, self._streams, self._rate = layout, streams, grid_rate
        self._model, self._latency, self._remark = model, latency, remark
        self._tracker = DelayTracker(len(streams), 0)
        self._offsets = np.zeros(len(streams))
        self._stamps: list[list[tuple[int, int]]] = [[] for _ in streams]
        self._warned = [False] * len(streams)
        self._modes = damped_modes(model)

    @property
    def _reference(self) -> SourceStream:
        return self._streams[self._tracker.reference]

    @property
    def state(self) -> tuple[SourceAlignment, ...]:
        """How every source is aligned now."""
        result = []
        for number, one in enumerate(self._streams):
            skew = 0.0
            if one.line is not None and self._reference.line is not None:
                reference = self._reference.line.step / self._reference.rate
                skew = reference / (one.line.step / one.rate) - 1
            result.append(
                SourceAlignment(
                    one.source.name,
                    one.line is not None and not one.silent,
                    float(self._offsets[number]),
                    skew,
                    self._tracker.deviation(number, UPDATE),
                )
            )
        return tuple(result)

    def lay_grid(self, one: SourceStream, begin_ns: int, alone: bool) -> SourceStream:
        """
        Let a source be the reference of a new grid.

        Parameters
        ----------
        one : SourceStream
        begin_ns : int
            Host time from which on all sources have samples [ns].
        alone : bool
            No other source samples: begin with its first sample.

        Returns
        -------
        SourceStream

        """
        count = len(self._streams)
        self._tracker = DelayTracker(count, self._streams.index(one))
        for own in self._stamps:
            own.clear()
        step = one.rate / self._rate
        place = float(one.begin) if alone else max(float(one.begin), one.clock.place_at(begin_ns))
        place = np.ceil(place)
        if step != 1.0:
            place += one.needed_after(Line(0, 0.5, step))
        one.line = Line(0, float(place), step)
        return one

    def host_time(self, point: float) -> int:
        """
        Tell the time of a point by the stamps of the reference.

        Parameters
        ----------
        point : float

        Returns
        -------
        int
            [ns].

        """
        assert self._reference.line is not None
        return self._reference.clock.host_time(float(self._reference.line.at(point)))

    def join(self, one: SourceStream, now: int, points: tuple[int, int]) -> None:
        """
        Align a source by its stamps, then by the motion that it and the others saw.

        Parameters
        ----------
        one : SourceStream
        now : int
            The point from which on it is read.
        points : tuple of int
            Begin and end of what is compared.

        """
        reference, number = self._reference, self._streams.index(one)
        assert reference.line is not None
        line = reference.line
        interval = line.step / reference.rate * (1 + reference.clock.fitted.skew)
        place = one.clock.place_at(self.host_time(now))
        own = Line(now, place, interval * one.rate / (1 + one.clock.fitted.skew))
        spread = one.clock.uncertainty(place) + reference.clock.uncertainty(float(line.at(now)))
        # Where the begin alone is known, its uncertainty is all there is.
        latency = 0.0 if one.source.start_deviation else self._latency
        self._tracker.begin(number, spread, latency)
        self._stamps[number].clear()
        self._offsets[number] = 0.0
        others = [each for each in self._streams if each.line is not None and not each.silent]
        one.line = own
        if self._model is not None and others:
            self._refine(one, others, now, points)
        self._judge(number, joined=True)

    def _refine(
        self, one: SourceStream, others: list[SourceStream], now: int, points: tuple[int, int]
    ) -> None:
        assert self._model is not None
        number = self._streams.index(one)
        age = (now - (points[0] + points[1] - 1) / 2) / self._rate
        mean, covariance = self._tracker.known([number], age)
        search = SEARCH * float(np.sqrt(covariance[0, 0]))
        total = np.zeros(2)
        found = None
        for _ in range(MOST_ROUNDS):
            estimate = motion_delays(
                self._model, self._layout, (others, [one]), points, self._rate,
                (mean - total, covariance), search,
            )  # fmt: skip
            if estimate is None:
                break
            found, search = estimate, 0.0
            moved = np.array([found.delays[1], found.skews[1]])
            total = total + moved
            delay = float(moved[0] + moved[1] * age)
            assert one.line is not None
            one.line = one.line.moved(
                now, one.rate * delay, one.rate * float(moved[1]) / self._rate
            )
            shift = np.hypot(moved[0], moved[1] * found.duration / np.sqrt(12))
            if shift <= ENOUGH * found.deviation_over_record[1]:
                break
        if found is None:
            return
        told = found.covariance[np.ix_([1, 3], [1, 3])]
        self._tracker.add_motion([number], total, told, age)
        delay = float(total[0] + total[1] * age)
        self._tracker.corrected(number, delay, float(total[1]))
        self._offsets[number] = delay

    def note_stamps(self, one: SourceStream, stamps: list[tuple[int, int]]) -> None:
        """
        Keep stamps for the next update.

        Parameters
        ----------
        one : SourceStream
        stamps : list of tuple of int
            Index and time [ns].

        """
        self._stamps[self._streams.index(one)].extend(stamps)

    def slewed(self, one: SourceStream, begin: int, end: int) -> Line:
        """
        Give the line along which a source is read next, some of its delay taken out.

        Parameters
        ----------
        one : SourceStream
        begin, end : int
            Points.

        Returns
        -------
        Line

        """
        assert one.line is not None
        number = self._streams.index(one)
        duration = (end - begin) / self._rate
        delay = float(self._tracker.mean[self._tracker.place(number, DELAY)])
        if number == self._tracker.reference or delay == 0.0:
            if number != self._tracker.reference:
                one.line = one.line.moved(begin)
            return one.line
        out = np.clip(delay * min(1.0, duration / SLEWING), -MOST_SLEW * duration,
                      MOST_SLEW * duration)  # fmt: skip
        line = one.line.moved(begin, 0.0, one.rate * float(out) / (end - begin))
        one.line = Line(end, float(line.at(end)), one.line.step)
        self._tracker.corrected(number, float(out))
        return line

    def update(self, now: int, last: int, whole: int) -> None:
        """
        Weigh what was expected against the newest stamps and motion.

        Parameters
        ----------
        now : int
            Point up to which samples were given.
        last : int
            The same at the last update.
        whole : int
            Point from which on the same sources have had samples.

        """
        self._tracker.predict((now - last) / self._rate)
        members = [
            number
            for number, one in enumerate(self._streams)
            if one.line is not None and not one.silent and number != self._tracker.reference
        ]
        self._use_stamps(members, now)
        if self._model is not None and members and not self._reference.silent:
            self._use_motion(members, now, max(last, whole))
        for number in members:
            one = self._streams[number]
            skew = float(self._tracker.mean[self._tracker.place(number, SKEW)])
            assert one.line is not None
            one.line = one.line.moved(now, 0.0, one.rate * skew / self._rate)
            self._tracker.corrected(number, 0.0, skew)
            self._judge(number)

    def _use_stamps(self, members: Sequence[int], now: int) -> None:
        own = [self._residuals(number, now) for number in range(len(self._streams))]
        for stamps in self._stamps:
            stamps.clear()
        reference = own[self._tracker.reference]
        for number in members:
            mine = own[number]
            if mine is not None and reference is not None:
                self._tracker.add_stamps(
                    number, mine[0] - reference[0], mine[1] + reference[1], mine[2]
                )

    def _residuals(self, number: int, now: int) -> tuple[float, float, float] | None:
        """Mean of stamps minus times of the grid, its variance, and how old it is."""
        one, stamps = self._streams[number], self._stamps[number]
        if one.line is None or len(stamps) < 3:
            return None
        index, times = np.array(stamps, dtype=np.int64).T
        assert self._reference.line is not None
        interval = self._reference.line.step / self._reference.rate
        interval *= 1 + self._reference.clock.fitted.skew
        points = one.line.point + (index - one.line.place) / one.line.step - now
        late = (times - self.host_time(now)) / NANOSECONDS - points * interval
        jitter = max(one.clock.fitted.jitter, LEAST_JITTER)
        age = -float(points.mean()) / self._rate
        return robust_mean(late, jitter), jitter**2 / len(late), age

    def _use_motion(self, members: list[int], now: int, first: int) -> None:
        assert self._model is not None
        rate = min(self._rate, *(self._streams[number].rate for number in members))
        begin = max(first, now - round(min(UPDATE, WINDOW / rate) * self._rate))
        age = (now - (begin + now - 1) / 2) / self._rate
        groups = [[self._reference], *([self._streams[number]] for number in members)]
        prior = self._tracker.known(members, age)
        found = motion_delays(self._model, self._layout, groups, (begin, now), self._rate, prior)
        if found is None:
            return
        count = len(groups)
        order = [place for i in range(1, count) for place in (i, count + i)]
        mean = np.concatenate((found.delays, found.skews))[order]
        self._tracker.add_motion(members, mean, found.covariance[np.ix_(order, order)], age)

    def dismiss(self, one: SourceStream) -> None:
        """
        Let a source go, whose clock is not followed any more.

        Parameters
        ----------
        one : SourceStream

        """
        self.hand_over(one)
        one.line = None
        self._stamps[self._streams.index(one)].clear()

    def hand_over(self, one: SourceStream) -> None:
        """
        Let another source be the reference, if this one is and there is another.

        Parameters
        ----------
        one : SourceStream

        """
        if one is not self._reference:
            return
        others = [
            number
            for number, other in enumerate(self._streams)
            if other is not one and other.line is not None
        ]
        if others:
            self._tracker.refer_to(min(others, key=lambda number: self._streams[number].silent))

    def _judge(self, number: int, joined: bool = False) -> None:
        """Say when damping suffers, and when it does not any more."""
        name, deviation = (
            self._streams[number].source.name,
            self._tracker.deviation(number, UPDATE),
        )
        text = delay_warning(name, 1.96 * deviation, *self._modes)
        if joined and self._model is None:
            self._remark(
                f'{name}: aligned by its stamps alone; a delay remains, with a standard '
                f'deviation of {deviation * 1e6:.3g} us. A machine file lets the motion align it'
            )
        elif text and not self._warned[number]:
            self._remark(text)
        elif self._warned[number] and not text:
            self._remark(f'{name}: is aligned to {deviation * 1e6:.3g} us (standard deviation)')
        self._warned[number] = bool(text)
