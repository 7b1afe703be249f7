# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of other programs made into bags."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
import re
import secrets

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.blocks import (
    ChannelStatus,
    NANOSECONDS,
    SampleBlock,
    samples_per_block,
    stamp_after,
)
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.formats.formats import open_table
from identnl_ros.storage.formats.table import Column, Progress, Table
from identnl_ros.storage.quantities import convert, is_unit, same_dimension, UnitError
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

TIME_TOLERANCE = 1e-6  # of the sample interval [-]
ROWS_FOR_RATE = 1000
LARGEST_READING = 1e100  # SI; more is no measurement, and its square would overflow
EARLIEST_DATE = 1e8  # later times count from 1970 [s]

_TIME_NAME = re.compile(r'(time|t)\s*([\[(]s[\])]|_s)?', re.IGNORECASE)
_NO_UNITS = {'EU', '-'}  # engineering unit; else an exa-u, a mass
_POWER_WITHOUT_SIGN = re.compile(r'(?<=[^\W\d])(\d)')

Note = Callable[[str], None]
Piece = tuple[int, NDArray[np.float64]]


@dataclass(frozen=True)
class Imported:
    """
    Size of an imported record.

    Parameters
    ----------
    samples : int
    lost_samples : int
        By the time column, missing between the rows.
    notes : tuple of str
        Sentences about what was not understood.

    """

    samples: int
    lost_samples: int
    notes: tuple[str, ...] = ()


def import_table(
    path: str | PathLike[str],
    layout: Layout,
    bag_path: str | PathLike[str],
    *,
    format_name: str | None = None,
    ignore_units: bool = False,
    layout_text: str = '',
    machine_text: str = '',
    stream_id: int | None = None,
    start_ns: int = 0,
    compress: bool = False,
    progress: Progress | None = None,
) -> Imported:
    """
    Make a bag from a recorded file.

    Parameters
    ----------
    path : path
    layout : Layout
        Which columns are which sensors.
    bag_path : path
        Of the bag to be made; see `BagWriter`.
    format_name : str or None
        One of `READERS`; None: by the end of the file's name.
    ignore_units : bool
        Take the numbers to be in the units of the layout, whatever the file says.
    layout_text, machine_text : str
        Texts of the files, to be kept in the bag.
    stream_id : int or None
        None: a random one.
    start_ns : int
        Stamp of the first sample [ns].
    compress : bool
    progress : callable or None
        Called with what is done and what there is to do.

    Returns
    -------
    Imported

    Raises
    ------
    DataError
        If the file does not fit the layout, is not sound, or the bag cannot be written.
    LayoutError
        If two sensors read the same column.

    """
    with open_table(Path(path), format_name) as table:
        notes: list[str] = []
        note = None if ignore_units else notes.append
        sample_rate, pieces = read_table(table, layout, note, progress)
        description = StandDescription(
            stand=layout.stand,
            stream_id=secrets.randbits(63) if stream_id is None else stream_id,
            sample_rate=sample_rate,
            layout=layout,
            machine_text=machine_text,
            layout_text=layout_text,
            stamp_ns=start_ns,
        )
        count = end = 0
        with BagWriter(bag_path, compress=compress) as writer:
            writer.write_description(description)
            for (index, samples), last in _with_last(pieces):
                block = block_of(description, index, samples, last)
                writer.write_block(block)
                count += len(samples)
                end = block.next_index
    return Imported(count, end - count, tuple(notes))


def read_table(
    table: Table, layout: Layout, note: Note | None = None, progress: Progress | None = None
) -> tuple[float, Iterator[Piece]]:
    """
    Read the samples of all sensors from a table.

    Parameters
    ----------
    table : Table
    layout : Layout
        If neither it nor the file states a sample rate, a column ``time`` or ``t`` must tell it;
        what is told several times must agree as far as its digits go.
    note : callable or None
        Called with sentences about units that are not known; None: the file's units do not
        count.
    progress : callable or None
        Called with what is done and what there is to do.

    Returns
    -------
    sample_rate : float
        [Hz].
    pieces : iterator of tuple of int and ndarray, shape (n_samples, n_channels)
        Running index of the first sample, which jumps where times are missing, and samples in
        SI units; NaN for empty cells, infinite where the file says so.

    Raises
    ------
    DataError
        If the file does not fit the layout or is not sound; also while iterating.
    LayoutError
        If two sensors read the same column.

    """
    columns = [table.column(sensor.column, f'sensor {sensor.name}') for sensor in layout.sensors]
    for i, column in enumerate(columns):
        if column in columns[:i]:
            raise LayoutError(
                f'{table.path}: sensors {layout.sensors[columns.index(column)].name} and '
                f'{layout.sensors[i].name} read the same column '
                f'{layout.sensors[i].column!r}; correct the key column in the layout'
            )
    factors = np.ones(len(columns))
    if note is not None:
        for i, (column, sensor) in enumerate(zip(columns, layout.sensors, strict=True)):
            factors[i] = _factor(table, table.columns[column], sensor, note)
    told = _told_rate(table, columns, layout.sample_rate)
    stated = layout.sample_rate or (told.sample_rate if told else None)
    source = 'the layout states' if layout.sample_rate else 'the file states'
    clock = _clock(table, stated, source)
    rate = clock.rate if clock else stated
    if rate is None:
        raise DataError(
            f'{table.path}: the sample rate is not known: the layout has no sample_rate and the '
            'file no column "time" in seconds; give sample_rate [Hz] in the layout'
        )
    return rate, _pieces(table, layout, columns, factors, rate, clock, progress)


def start_of(table: Table, same_start: bool) -> int:
    """
    Find when a recording began.

    Parameters
    ----------
    table : Table
    same_start : bool
        Times count from an instant that other files share.

    Returns
    -------
    int
        Host time of the first sample [ns].

    Raises
    ------
    DataError
        If the file does not tell.

    """
    found = _time_column(table)
    first = 0.0
    if found is not None:
        column, unit = found
        _, rows = next(table.rows([column], 1))
        first = float(rows[0, 0]) * unit
    if same_start or first >= EARLIEST_DATE:
        return round(first * NANOSECONDS)
    if table.start_ns is not None:
        return table.start_ns
    raise DataError(
        f'{table.path}: it does not tell when it began, and times of several files may count '
        'from different instants; give --start FILE=TIME for each, or --same-start if they count '
        'from the same one'
    )


def block_of(
    description: StandDescription, index: int, samples: NDArray[np.float64], last: bool
) -> SampleBlock:
    """
    Make a block of a bag.

    Parameters
    ----------
    description : StandDescription
    index : int
        Of the first sample.
    samples : ndarray, shape (n_samples, n_channels)
        SI; those that are beyond all measure become NaN.
    last : bool
        Nothing follows.

    Returns
    -------
    SampleBlock

    """
    missing, saturated = np.isnan(samples), np.abs(samples) > LARGEST_READING
    samples[saturated] = np.nan
    status = np.where(missing.any(axis=0), int(ChannelStatus.MISSING_SAMPLES), 0)
    status |= np.where(saturated.any(axis=0), int(ChannelStatus.SATURATED), 0)
    return SampleBlock(
        stream_id=description.stream_id,
        stamp_ns=stamp_after(description.stamp_ns, index, description.sample_rate),
        first_index=index,
        sample_rate=description.sample_rate,
        samples=samples,
        channel_status=np.asarray(status, np.uint8),
        last=last,
    )


def _factor(table: Table, column: Column, sensor: Sensor, note: Note) -> float:
    """Find what makes the file's numbers those that the layout expects."""
    unit = _POWER_WITHOUT_SIGN.sub(r'^\1', column.unit.strip())
    if unit in ('g', 'G') and sensor.kind is SensorKind.ACCELERATION:
        unit = 'g_0'  # nobody measures an acceleration in grams
    if not unit or unit == sensor.recorded_unit:
        return 1.0
    where = f'{table.path}: column {column.name!r} (sensor {sensor.name})'
    if unit in _NO_UNITS or not is_unit(unit):
        note(
            f'{where} has the unit {column.unit!r}, which is not known; '
            f'its numbers are taken to be in {sensor.recorded_unit}, as the layout says'
        )
        return 1.0
    try:
        return convert(1.0, unit, sensor.recorded_unit)
    except UnitError:
        pass
    fits = same_dimension(unit, sensor.kind.unit)
    remedy = (
        f'write "unit: {unit}" without a gain in the layout'
        if fits
        else 'correct column, kind or unit in the layout'
    )
    raise DataError(
        f'{where} is in {column.unit}, but the layout expects {sensor.recorded_unit} from a '
        f'sensor of {sensor.kind.value}; {remedy}, or give --ignore-units if the file is wrong'
    )


def _told_rate(table: Table, columns: list[int], stated: float | None) -> Column | None:
    """Find the column whose rate the file tells best; all that tell one must agree."""
    telling = [table.columns[i] for i in columns if table.columns[i].sample_rate]
    if not telling:
        return None
    best = min(telling, key=lambda column: column.rate_tolerance)
    for column in telling:
        allowed = TIME_TOLERANCE + column.rate_tolerance
        for rate, source, remedy in (
            (best.sample_rate, f'that of {best.name!r} is', 'import them one by one, or resample'),
            (stated, 'the layout states', 'correct sample_rate in the layout'),
        ):
            if rate and column.sample_rate and abs(column.sample_rate / rate - 1) > allowed:
                raise DataError(
                    f'{table.path}: column {column.name!r} has a sample rate of '
                    f'{column.sample_rate:.9g} Hz, but {source} {rate:.9g} Hz; {remedy}'
                )
    return best


@dataclass(frozen=True)
class _Clock:
    """
    The time column.

    Parameters
    ----------
    column : int
    rate : float
        [Hz].
    decimals, significant : int or None
        To which the times are printed; None: exact.
    unit : float
        Of the times [s].

    """

    column: int
    rate: float
    decimals: int | None = None
    significant: int | None = None
    unit: float = 1.0

    def rounding(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far the difference of two times may be off [s]."""
        exact: NDArray[np.float64] = 4 * np.finfo(float).eps * np.abs(times)
        if self.decimals is None or self.significant is None:
            return exact
        with np.errstate(divide='ignore', invalid='ignore'):
            decade = np.floor(np.log10(np.abs(times)))
        printed = np.maximum(
            10.0**-self.decimals * self.unit, 10.0 ** (decade + 1 - self.significant)
        )
        return exact + printed

    def steps(
        self, table: Table, row: int, times: NDArray[np.float64], rate: float | None = None
    ) -> NDArray[np.int64]:
        """
        Count the sample intervals from each row to the next.

        Parameters
        ----------
        table : Table
        row : int
            The first one.
        times : ndarray
            [s].
        rate : float or None
            Another one than that of the clock [Hz].

        Returns
        -------
        ndarray
            1, or more where rows are missing.

        Raises
        ------
        DataError
            If a step is not a whole number of intervals.

        """
        interval = 1 / (rate or self.rate)
        found = np.diff(times)
        with np.errstate(invalid='ignore'):
            counts = np.maximum(1, np.nan_to_num(np.rint(found / interval), posinf=1))
        rounding = self.rounding(times[1:])
        # Where the times are printed too coarsely to tell, nothing is missing.
        counts[np.abs(found - interval) <= rounding + TIME_TOLERANCE * interval] = 1
        deviation = np.abs(found - counts * interval)
        wrong = ~(deviation <= rounding + TIME_TOLERANCE * counts * interval)
        if wrong.any():
            at = int(np.argmax(np.where(wrong, np.nan_to_num(deviation, nan=np.inf), 0)))
            raise DataError(
                f'{table.path}: time is not uniform: near {table.row_name} {row + at + 1} it '
                f'steps by {found[at]:.9g} s, expected {interval:.9g} s within '
                f'{TIME_TOLERANCE:g} of it; resample the recording, or give sample_rate [Hz] in '
                'the layout if the times are only rounded'
            )
        return np.asarray(counts, np.int64)


def _clock(table: Table, stated: float | None, source: str) -> _Clock | None:
    """Find the time column and its rate; if a rate is stated, they must agree."""
    found = _time_column(table)
    if found is None:
        return None
    column, unit = found
    try:
        row, rows = next(table.rows([column], ROWS_FOR_RATE))
    except DataError:
        if stated is None:
            raise
        return None  # times of day; the layout knows better
    times = rows[:, 0] * unit
    if stated is not None and len(times) < 2:
        return None
    if len(times) < 2 or not times[-1] > times[0]:
        remedy = 'remove the column' if stated else 'give sample_rate [Hz] in the layout'
        raise DataError(
            f'{table.place(row)}: the time does not increase, so the sample rate is not known; '
            f'{remedy}'
        )
    decimals, significant = (stated and table.digits(column, ROWS_FOR_RATE)) or (None, None)
    clock = _Clock(column, stated or 1.0, decimals, significant, unit)
    usual = float(np.nanmedian(np.diff(times)))
    if stated is None:
        if not usual > 0:
            raise DataError(
                f'{table.place(row)}: most times are the same, so the sample rate is not known; '
                'give sample_rate [Hz] in the layout'
            )
        rate = _refined(clock.steps(table, row, times, _mean_rate(times, usual)), times)
        return _Clock(column, rate, unit=unit)
    rounding = float(np.median(clock.rounding(times)))
    if abs(usual - 1 / stated) <= rounding + TIME_TOLERANCE / stated:
        measured = _refined(clock.steps(table, row, times), times)
    else:
        measured = _mean_rate(times, usual) if usual > rounding else _refined(None, times)
    allowed = TIME_TOLERANCE + float(clock.rounding(times[-1:])[0]) / (times[-1] - times[0])
    if abs(stated / measured - 1) > allowed:
        raise DataError(
            f'{table.path}: {source} a sample_rate of {stated:.9g} Hz, but by column '
            f'{table.columns[column].name!r} it is {measured:.9g} Hz; correct sample_rate in the '
            'layout, or rename the column if it is not the time in seconds'
        )
    return clock


def _time_column(table: Table) -> tuple[int, float] | None:
    """Find the time column and its unit [s]."""
    for i, column in enumerate(table.columns):
        if any(_TIME_NAME.fullmatch(name) for name in (column.name, *column.aliases)):
            try:
                return i, convert(1.0, column.unit, 's') if column.unit not in ('', 's') else 1.0
            except UnitError:
                continue
    return None


def _mean_rate(times: NDArray[np.float64], usual: float) -> float:
    """Rate of the steps near the usual one [Hz]; of all if the times are too rounded to tell."""
    steps = np.diff(times)
    near = steps[np.abs(steps - usual) <= TIME_TOLERANCE * usual]
    return _rounder(1 / float(near.mean() if len(near) > 1 else usual))


def _refined(counts: NDArray[np.int64] | None, times: NDArray[np.float64]) -> float:
    count = len(times) - 1 if counts is None else int(counts.sum())
    return _rounder(count / float(times[-1] - times[0]))


def _rounder(rate: float) -> float:
    """Of two nearly equal numbers the rounder one."""
    short = float(f'{rate:.9g}')
    return short if abs(short - rate) < 1e-9 * rate else rate


def _pieces(
    table: Table,
    layout: Layout,
    columns: list[int],
    factors: NDArray[np.float64],
    rate: float,
    clock: _Clock | None,
    progress: Progress | None,
) -> Iterator[Piece]:
    wanted = columns if clock is None else [*columns, clock.column]
    before: NDArray[np.float64] = np.empty(0)
    index = 0
    for row, rows in table.rows(wanted, samples_per_block(rate), progress):
        starts = np.zeros(1, np.int64)
        skipped = np.zeros(len(rows), np.int64)
        if clock is not None:
            times = np.concatenate([before, rows[:, -1] * clock.unit])
            steps = clock.steps(table, row - len(before), times)
            skipped[len(rows) - len(steps) :] = steps - 1
            starts = np.union1d(starts, np.flatnonzero(skipped))
            before = times[-1:]
        lost = np.cumsum(skipped)
        time = (index + np.arange(len(rows)) + lost) / rate
        with np.errstate(over='ignore'):  # beyond all measure, and found out as such
            samples = np.column_stack(
                [
                    sensor.to_si(rows[:, i] * factors[i], time)
                    for i, sensor in enumerate(layout.sensors)
                ]
            )
        for first, piece in zip(starts, np.split(samples, starts[1:]), strict=True):
            index += int(skipped[first])
            yield index, piece
            index += len(piece)


def _with_last(pieces: Iterator[Piece]) -> Iterator[tuple[Piece, bool]]:
    """Tell of each piece whether it is the last."""
    piece = next(pieces)
    for following in pieces:
        yield piece, False
        piece = following
    yield piece, True
