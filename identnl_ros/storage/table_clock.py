# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A column of times as a clock: its rate, and which rows are missing by it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.storage.formats.table import Table
import numpy as np
from numpy.typing import NDArray

TIME_TOLERANCE = 1e-6  # of the sample interval [-]
ROWS_FOR_RATE = 1000
TELLING = 10.0  # times its rounding a clock must advance to tell anything
SAME = 1e-9  # [-]
MOST_DIGITS = 9  # of a sample rate that times tell
LONGEST_GAP = 1e15  # [samples]
FEW_GAPS = 2e-3  # of the rows [-]


@dataclass(frozen=True)
class Clock:
    """
    A column of times.

    Parameters
    ----------
    column : int
    name : str
        For errors.
    rate : float or None
        Of the samples [Hz]; None: the clock itself has to tell it.
    unit : float
        Of the times [s].
    decimals, significant : int or None
        To which the times are printed; None: exact.
    origin_ns : int or None
        From which the times count; None: not told [ns since 1970 or midnight].
    first : float
        Time of the first row [s].
    coarseness : float
        How far a difference of two times may be off [s].
    rate_tolerance : float
        To which the clock itself tells the rate [-].
    is_named : bool
        A time by name, unit or dates, not by its numbers alone.
    is_counter : bool
        A last digit of one sample interval is no rounding: it counts the samples.

    """

    column: int
    name: str
    rate: float | None
    unit: float = 1.0
    decimals: int | None = None
    significant: int | None = None
    origin_ns: int | None = None
    first: float = 0.0
    coarseness: float = 0.0
    rate_tolerance: float = 0.0
    is_named: bool = True
    is_counter: bool = True

    @property
    def begin_ns(self) -> int:
        """Time of the first row since the origin of dates, or of the column [ns]."""
        return (self.origin_ns or 0) + round(self.first * NANOSECONDS)

    def printed(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Tell the last printed digit of times.

        Parameters
        ----------
        times : ndarray
            [s].

        Returns
        -------
        ndarray
            [s]; 0: they are exact.

        """
        if self.decimals is None or self.significant is None:
            return np.zeros(len(times))
        with np.errstate(divide='ignore', invalid='ignore'):
            decade = np.floor(np.log10(np.abs(times) / self.unit))
        last: NDArray[np.float64] = np.maximum(
            10.0**-self.decimals, 10.0 ** (decade + 1 - self.significant)
        )
        return last * self.unit

    def rounding(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Tell how far the difference of two times may be off.

        Parameters
        ----------
        times : ndarray
            [s].

        Returns
        -------
        ndarray
            [s].

        """
        exact: NDArray[np.float64] = 4 * np.finfo(float).eps * np.abs(times)
        printed = self.printed(times)
        if self.rate and self.is_counter:
            printed[np.abs(printed * self.rate - 1) < SAME] = 0
        return exact + printed

    def tells(self, times: NDArray[np.float64]) -> bool:
        """
        Tell whether times advance by more than their rounding.

        Parameters
        ----------
        times : ndarray, shape (n,)
            [s].

        Returns
        -------
        bool

        """
        return len(times) > 1 and bool(
            times[-1] - times[0] > TELLING * float(self.rounding(times[-1:])[0])
        )

    def checked(
        self, table: Table, row: int, times: NDArray[np.float64], source: str, remedy: str
    ) -> 'Clock':
        """
        Check the first times against the sample rate, or find it.

        Parameters
        ----------
        table : Table
        row : int
            The first one.
        times : ndarray, shape (n,)
            [s].
        source : str
            Who states the sample rate, for errors.
        remedy : str
            What to do if this is no time, for errors.

        Returns
        -------
        Clock
            With its rate.

        Raises
        ------
        DataError
            If the times are no times, uneven, or contradict the sample rate.

        """
        self.require_finite(table, row, times)
        rounding = float(np.median(self.rounding(times)))
        clock = replace(self, first=float(times[0]), coarseness=rounding)
        passed = float(times[-1] - times[0])
        if self.rate and (
            len(times) < 2 or abs(passed - (len(times) - 1) / self.rate) <= rounding > passed
        ):
            return clock  # it cannot tell yet
        if len(times) < 2 or not passed > 0:
            wanted = remedy if self.rate else 'give sample_rate [Hz] in the layout'
            raise DataError(
                f'{table.place(row)}: {self.name}: the time does not increase, so the sample rate '
                f'is not known; {wanted}'
            )
        usual = float(np.median(np.diff(times)))
        if not self.rate:
            if not usual > 0:
                raise DataError(
                    f'{table.place(row)}: {self.name}: most times are the same, so the sample '
                    'rate is not known; give sample_rate [Hz] in the layout'
                )
            mean = replace(clock, rate=_mean_rate(times, usual))
            tolerance = float(self.rounding(times[-1:])[0]) / passed
            rate = _rounder(_refined(mean.steps(table, row, times), times), tolerance)
            return replace(clock, rate=rate, rate_tolerance=tolerance)
        measured = replace(clock, is_counter=False)._measured(table, row, times)
        printed = replace(self, is_counter=False).rounding(times[-1:])
        allowed = TIME_TOLERANCE + float(printed[0]) / passed
        if abs(self.rate / measured - 1) > allowed and not clock._counts_samples(
            table, row, times
        ):
            raise DataError(
                f'{table.path}: {source} a sample_rate of {self.rate:.9g} Hz, but by {self.name} '
                f'it is {measured:.9g} Hz; correct sample_rate in the layout, or {remedy} if it '
                'is not the time'
            )
        return clock

    def require_finite(self, table: Table, row: int, times: NDArray[np.float64]) -> None:
        """
        Refuse times that are none.

        Parameters
        ----------
        table : Table
        row : int
            The first one.
        times : ndarray, shape (n,)

        Raises
        ------
        DataError

        """
        missing = ~np.isfinite(times)
        if missing.any():
            raise DataError(
                f'{table.path}: near {table.row_name} {row + int(np.argmax(missing))} there is no '
                f'time ({self.name}); fill it in, or remove the row'
            )

    def _measured(self, table: Table, row: int, times: NDArray[np.float64]) -> float:
        """Find the rate by the times alone, as far as they tell it [Hz]."""
        assert self.rate is not None
        usual = float(np.median(np.diff(times)))
        rounding = float(np.median(self.rounding(times)))
        if abs(usual - 1 / self.rate) <= rounding + TIME_TOLERANCE / self.rate:
            return _refined(self.steps(table, row, times), times)
        return _mean_rate(times, usual, rounding) if usual > rounding else _refined(None, times)

    def _counts_samples(self, table: Table, row: int, times: NDArray[np.float64]) -> bool:
        """Tell whether the last digit counts samples, of which a few are missing."""
        assert self.rate is not None
        try:
            few = float((self.steps(table, row, times) > 1).mean()) <= FEW_GAPS
            return few and abs(self.rate / self._measured(table, row, times) - 1) <= TIME_TOLERANCE
        except DataError:
            return False

    def steps(self, table: Table, row: int, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """
        Count the sample intervals from each row to the next.

        Parameters
        ----------
        table : Table
        row : int
            The first one.
        times : ndarray, shape (n,)
            [s].

        Returns
        -------
        ndarray, shape (n - 1,)
            1, or more where rows are missing.

        Raises
        ------
        DataError
            If a step is not a whole number of intervals.

        """
        interval = 1 / (self.rate or 1.0)
        found = np.diff(times)
        # Where the times are printed too coarsely to tell, nothing is missing.
        single = np.abs(found - interval) <= self.rounding(times[1:]) + TIME_TOLERANCE * interval
        if single.all():
            return np.ones(len(found), np.int64)
        counts = np.where(single, 1, np.clip(np.rint(found / interval), 1, LONGEST_GAP))
        self.require(table, row, times, counts)
        return np.asarray(counts, np.int64)

    def require(
        self, table: Table, row: int, times: NDArray[np.float64], counts: NDArray[np.int64]
    ) -> None:
        """
        Refuse times that do not step by so many intervals.

        Parameters
        ----------
        table : Table
        row : int
            The first one.
        times : ndarray, shape (n,)
            [s].
        counts : ndarray, shape (n - 1,)

        Raises
        ------
        DataError

        """
        interval = 1 / (self.rate or 1.0)
        found = np.diff(times)
        deviation = np.abs(found - counts * interval)
        allowed = self.rounding(times[1:]) + TIME_TOLERANCE * counts * interval
        wrong = deviation > allowed
        if wrong.any():
            at = int(np.argmax(np.where(wrong, deviation, 0)))
            raise DataError(
                f'{table.path}: time is not uniform: near {table.row_name} {row + at + 1} it '
                f'steps by {found[at]:.9g} s, expected {interval:.9g} s within {TIME_TOLERANCE:g} '
                f'of it ({self.name}); resample the recording, or give sample_rate [Hz] in '
                'the layout if the times are only rounded'
            )


class Timeline:
    """
    Which rows of a table are missing, by all its clocks.

    Parameters
    ----------
    table : Table
    clocks : sequence of Clock
        The finest one first; it counts, and the others must agree.
    rate : float
        Of the samples [Hz].

    """

    def __init__(self, table: Table, clocks: Sequence[Clock], rate: float) -> None:
        """Begin before the first row."""
        self._table = table
        self._clocks = [replace(one, rate=rate) for one in clocks]
        self._before = np.empty((0, len(clocks)))
        self._passed = self._gaps = 0
        self._tolerance = TIME_TOLERANCE + max((one.rate_tolerance for one in clocks), default=0)

    def skipped(self, row: int, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """
        Count the samples that are missing before each row.

        Parameters
        ----------
        row : int
            The first one.
        times : ndarray, shape (n_rows, n_clocks)
            As the columns have them.

        Returns
        -------
        ndarray, shape (n_rows,)

        Raises
        ------
        DataError
            If a step is not a whole number of intervals, or the clocks disagree.

        """
        skipped = np.zeros(len(times), np.int64)
        if not self._clocks:
            return skipped
        known = np.concatenate([self._before, times])
        row -= len(self._before)
        counts = np.ones(len(known) - 1, np.int64)
        for number, clock in enumerate(self._clocks):
            seconds = known[:, number] * clock.unit
            clock.require_finite(self._table, row, seconds)
            if number:
                clock.require(self._table, row, seconds, counts)
            else:
                counts = clock.steps(self._table, row, seconds)
        self._passed += int(counts.sum())
        self._gaps += int((counts > 1).sum())
        self._require_together(row + len(known) - 1, known[-1])
        skipped[len(times) - len(counts) :] = counts - 1
        self._before = times[-1:]
        return skipped

    def _require_together(self, row: int, times: NDArray[np.float64]) -> None:
        """Refuse clocks that ran away from the samples, too slowly to be seen in any step."""
        for clock, time in zip(self._clocks, times.tolist(), strict=True):
            assert clock.rate is not None
            found = time * clock.unit - clock.first
            expected = self._passed / clock.rate
            if abs(found - expected) <= self._tolerance * expected:
                continue
            # Rounded is the difference of the ends, and what is missing in every gap.
            ends = (1 + self._gaps) * float(clock.rounding(np.array([time * clock.unit]))[0])
            if not abs(found - expected) <= ends + self._tolerance * expected:
                raise DataError(
                    f'{self._table.path}: by {clock.name}, {found:.9g} s pass to '
                    f'{self._table.row_name} {row}, but its samples take {expected:.9g} s at '
                    f'{clock.rate:.9g} Hz; rows are missing, or sample_rate in the layout is wrong'
                )


def _mean_rate(times: NDArray[np.float64], usual: float, rounding: float = 0.0) -> float:
    """Rate of the steps near the usual one [Hz]; of all if the times are too rounded to tell."""
    steps = np.diff(times)
    near = steps[np.abs(steps - usual) <= max(TIME_TOLERANCE * usual, rounding)]
    return _rounder(1 / float(near.mean() if len(near) > 1 else usual))


def _refined(counts: NDArray[np.int64] | None, times: NDArray[np.float64]) -> float:
    count = len(times) - 1 if counts is None else int(counts.sum())
    return _rounder(count / float(times[-1] - times[0]))


def _rounder(rate: float, tolerance: float = 0.0) -> float:
    """Of nearly equal numbers the roundest one."""
    short = (float(f'{rate:.{digits}g}') for digits in range(1, MOST_DIGITS + 1))
    return next((one for one in short if abs(one - rate) < max(SAME, tolerance) * rate), rate)
