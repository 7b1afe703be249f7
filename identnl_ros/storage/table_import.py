# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of other programs made into bags."""

from collections.abc import Callable, Collection, Iterator
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
from identnl_ros.storage.formats.table import Column, NO_UNITS, Progress, Table
from identnl_ros.storage.quantities import convert, is_unit, same_dimension, UnitError
from identnl_ros.storage.stand_description import StandDescription
from identnl_ros.storage.table_clock import Clock, TIME_TOLERANCE, Timeline
from identnl_ros.storage.table_time import find_clocks
import numpy as np
from numpy.typing import NDArray

LARGEST_READING = 1e100  # SI; more is no measurement, and its square would overflow
EARLIEST_DATE = 1e8  # later times count from 1970 [s]

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
    time_columns : tuple of str
        By which the time was checked.
    unused_columns : tuple of str
        That are neither sensors nor times.

    """

    samples: int
    lost_samples: int
    notes: tuple[str, ...] = ()
    time_columns: tuple[str, ...] = ()
    unused_columns: tuple[str, ...] = ()


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
    start_ns: int | None = None,
    compress: bool = False,
    progress: Progress | None = None,
    ignored: Collection[str] = (),
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
    start_ns : int or None
        Stamp of the first sample [ns]; None: as the file tells it, or 0.
    compress : bool
    progress : callable or None
        Called with what is done and what there is to do.
    ignored : collection of str
        Columns that are no times, whatever they look like.

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
    wanted = [sensor.column for sensor in layout.sensors]
    with open_table(Path(path), format_name, wanted) as table:
        notes = list(table.notes)
        note = None if ignore_units else notes.append
        reading = read_table(table, layout, note, progress, ignored)
        if start_ns is None:
            start_ns = reading.begin_ns or 0
        description = StandDescription(
            stand=layout.stand,
            stream_id=secrets.randbits(63) if stream_id is None else stream_id,
            sample_rate=reading.sample_rate,
            layout=layout,
            machine_text=machine_text,
            layout_text=layout_text,
            stamp_ns=start_ns,
        )
        count = end = 0
        with BagWriter(bag_path, compress=compress) as writer:
            writer.write_description(description)
            for (index, samples), last in _with_last(reading.pieces):
                block = block_of(description, index, samples, last)
                writer.write_block(block)
                count += len(samples)
                end = block.next_index
    return Imported(count, end - count, tuple(notes), reading.time_columns, reading.unused_columns)


@dataclass(frozen=True)
class Reading:
    """
    What is read from a table.

    Parameters
    ----------
    sample_rate : float
        [Hz].
    pieces : iterator of tuple of int and ndarray, shape (n_samples, n_channels)
        Running index of the first sample, which jumps where times are missing, and samples in
        SI units; NaN for empty cells, infinite where the file says so.
    time_columns : tuple of str
        Names of the columns by which the time was checked.
    unused_columns : tuple of str
        Names of the columns that are neither sensors nor times.
    begin_ns : int or None
        Host time of the first sample, as the file tells it [ns]; None: it does not.
    first_ns : int
        Time of the first sample from an instant that is not known [ns].

    """

    sample_rate: float
    pieces: Iterator[Piece]
    time_columns: tuple[str, ...] = ()
    unused_columns: tuple[str, ...] = ()
    begin_ns: int | None = None
    first_ns: int = 0


def read_table(
    table: Table,
    layout: Layout,
    note: Note | None = None,
    progress: Progress | None = None,
    ignored: Collection[str] = (),
) -> Reading:
    """
    Read the samples of all sensors from a table.

    Parameters
    ----------
    table : Table
    layout : Layout
        If neither it nor the file states a sample rate, a column of times must tell it; what is
        told several times must agree as far as its digits go.
    note : callable or None
        Called with sentences about units that are not known; None: the file's units do not
        count.
    progress : callable or None
        Called with what is done and what there is to do.
    ignored : collection of str
        Columns that are no times, whatever they look like.

    Returns
    -------
    Reading

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
    left_out = [table.column(name, '--ignore-column') for name in ignored]
    clocks = find_clocks(table, columns, left_out, stated, source)
    rate = stated or next((clock.rate for clock in clocks), None)
    if rate is None:
        raise DataError(
            f'{table.path}: the sample rate is not known: the layout has no sample_rate and the '
            'file no column "time" in seconds; give sample_rate [Hz] in the layout'
        )
    times = [clock.column for clock in clocks]
    return Reading(
        rate,
        _pieces(table, layout, columns, factors, rate, clocks, progress),
        tuple(_names(table, times)),
        tuple(_names(table, sorted(set(range(len(table.columns))) - {*columns, *times}))),
        _begin(table, clocks),
        next((one.begin_ns for one in sorted(clocks, key=lambda one: not one.is_named)), 0),
    )


def _names(table: Table, columns: list[int]) -> list[str]:
    return [table.columns[column].name or str(column + 1) for column in columns]


def _begin(table: Table, clocks: list[Clock]) -> int | None:
    """Find when a recording began by what the file tells."""
    dated = (
        one.begin_ns
        for one in clocks
        # Days count from the year 0 or 1900.
        if one.unit <= 1 and one.begin_ns >= EARLIEST_DATE * NANOSECONDS
    )
    return next(dated, table.start_ns)


def start_of(table: Table, reading: Reading, same_start: bool) -> int:
    """
    Find when a recording began.

    Parameters
    ----------
    table : Table
    reading : Reading
        Of it.
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
    if same_start:
        return reading.first_ns
    if reading.begin_ns is not None:
        return reading.begin_ns
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
    if unit in NO_UNITS or not is_unit(unit):
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


def _pieces(
    table: Table,
    layout: Layout,
    columns: list[int],
    factors: NDArray[np.float64],
    rate: float,
    clocks: list[Clock],
    progress: Progress | None,
) -> Iterator[Piece]:
    wanted = [*columns, *(clock.column for clock in clocks)]
    timeline = Timeline(table, clocks, rate)
    index = 0
    for row, rows in table.rows(wanted, samples_per_block(rate), progress):
        skipped = timeline.skipped(row, rows[:, len(columns) :])
        starts = np.union1d(np.zeros(1, np.int64), np.flatnonzero(skipped))
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
