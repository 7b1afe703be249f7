# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of other programs, in text files, made into bags."""

from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
import re
import secrets

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.blocks import (
    ChannelStatus,
    SampleBlock,
    samples_per_block,
    stamp_after,
)
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.csv_table import CsvTable, Progress
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

TIME_TOLERANCE = 1e-6  # of the sample interval [-]
ROWS_FOR_RATE = 1000
LARGEST_READING = 1e100  # SI; more is no measurement, and its square would overflow

_TIME_NAME = re.compile(r'(time|t)\s*([\[(]s[\])]|_s)?', re.IGNORECASE)

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

    """

    samples: int
    lost_samples: int


def import_csv(
    csv_path: str | PathLike[str],
    layout: Layout,
    bag_path: str | PathLike[str],
    *,
    layout_text: str = '',
    machine_text: str = '',
    stream_id: int | None = None,
    start_ns: int = 0,
    compress: bool = False,
    progress: Progress | None = None,
) -> Imported:
    """
    Make a bag from a CSV file.

    Parameters
    ----------
    csv_path : path
    layout : Layout
        Which columns are which sensors.
    bag_path : path
        Of the bag to be made; see `BagWriter`.
    layout_text, machine_text : str
        Texts of the files, to be kept in the bag.
    stream_id : int or None
        None: a random one.
    start_ns : int
        Stamp of the first sample [ns].
    compress : bool
    progress : callable or None
        Called with the bytes read and the size of the CSV file.

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
    sample_rate, pieces = read_csv(csv_path, layout, progress)
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
            missing, saturated = np.isnan(samples), np.abs(samples) > LARGEST_READING
            samples[saturated] = np.nan
            status = np.where(missing.any(axis=0), int(ChannelStatus.MISSING_SAMPLES), 0)
            status |= np.where(saturated.any(axis=0), int(ChannelStatus.SATURATED), 0)
            block = SampleBlock(
                stream_id=description.stream_id,
                stamp_ns=stamp_after(start_ns, index, sample_rate),
                first_index=index,
                sample_rate=sample_rate,
                samples=samples,
                channel_status=np.asarray(status, np.uint8),
                last=last,
            )
            writer.write_block(block)
            count += len(samples)
            end = block.next_index
    return Imported(count, end - count)


def read_csv(
    path: str | PathLike[str], layout: Layout, progress: Progress | None = None
) -> tuple[float, Iterator[Piece]]:
    """
    Read the samples of all sensors from a CSV file.

    Parameters
    ----------
    path : path
    layout : Layout
        If it states no sample rate, a column ``time`` or ``t`` [s] must tell it; if both do,
        they must agree as far as the digits of the times go.
    progress : callable or None
        Called with the bytes read and the size of the file.

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
    table = CsvTable(Path(path))
    columns = [table.column(sensor.column, f'sensor {sensor.name}') for sensor in layout.sensors]
    for i, column in enumerate(columns):
        if column in columns[:i]:
            raise LayoutError(
                f'{table.path}: sensors {layout.sensors[columns.index(column)].name} and '
                f'{layout.sensors[i].name} read the same column '
                f'{layout.sensors[i].column!r}; correct the key column in the layout'
            )
    clock = _clock(table, layout.sample_rate)
    rate = clock.rate if clock else layout.sample_rate
    if rate is None:
        raise DataError(
            f'{table.path}: the sample rate is not known: the layout has no sample_rate and the '
            'file no column "time" in seconds; give sample_rate [Hz] in the layout'
        )
    return rate, _pieces(table, layout, columns, rate, clock, progress)


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

    """

    column: int
    rate: float
    decimals: int | None = None
    significant: int | None = None

    def rounding(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far the difference of two times may be off [s]."""
        exact: NDArray[np.float64] = 4 * np.finfo(float).eps * np.abs(times)
        if self.decimals is None or self.significant is None:
            return exact
        with np.errstate(divide='ignore', invalid='ignore'):
            decade = np.floor(np.log10(np.abs(times)))
        printed = np.maximum(10.0**-self.decimals, 10.0 ** (decade + 1 - self.significant))
        return exact + printed

    def steps(
        self, path: Path, line: int, times: NDArray[np.float64], rate: float | None = None
    ) -> NDArray[np.int64]:
        """
        Count the sample intervals from each row to the next.

        Parameters
        ----------
        path : Path
        line : int
            Of the first row.
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
                f'{path}: time is not uniform: near line {line + at + 1} it steps by '
                f'{found[at]:.9g} s, expected {interval:.9g} s within {TIME_TOLERANCE:g} of it; '
                'resample the recording, or give sample_rate [Hz] in the layout if the times are '
                'only rounded'
            )
        return np.asarray(counts, np.int64)


def _clock(table: CsvTable, stated: float | None) -> _Clock | None:
    """Find the time column and its rate; if the layout states a rate, they must agree."""
    column = next((i for i, name in enumerate(table.names) if _TIME_NAME.fullmatch(name)), None)
    if column is None:
        return None
    try:
        line, rows = next(table.rows([column], ROWS_FOR_RATE))
    except DataError:
        if stated is None:
            raise
        return None  # times of day; the layout knows better
    times = rows[:, 0]
    if stated is not None and len(times) < 2:
        return None
    if len(times) < 2 or not times[-1] > times[0]:
        remedy = 'remove the column' if stated else 'give sample_rate [Hz] in the layout'
        raise DataError(
            f'{table.path}:{line}: the time does not increase, so the sample rate is not known; '
            f'{remedy}'
        )
    digits = (None, None) if stated is None else table.digits(column, ROWS_FOR_RATE)
    clock = _Clock(column, stated or 1.0, *digits)
    usual = float(np.nanmedian(np.diff(times)))
    if stated is None:
        if not usual > 0:
            raise DataError(
                f'{table.path}:{line}: most times are the same, so the sample rate is not known; '
                'give sample_rate [Hz] in the layout'
            )
        rate = _refined(clock.steps(table.path, line, times, _mean_rate(times, usual)), times)
        return _Clock(column, rate)
    rounding = float(np.median(clock.rounding(times)))
    if abs(usual - 1 / stated) <= rounding + TIME_TOLERANCE / stated:
        measured = _refined(clock.steps(table.path, line, times), times)
    else:
        measured = _mean_rate(times, usual) if usual > rounding else _refined(None, times)
    allowed = TIME_TOLERANCE + float(clock.rounding(times[-1:])[0]) / (times[-1] - times[0])
    if abs(stated / measured - 1) > allowed:
        raise DataError(
            f'{table.path}: the layout states a sample_rate of {stated:.9g} Hz, but by column '
            f'{table.names[column]!r} it is {measured:.9g} Hz; correct sample_rate in the layout, '
            'or rename the column if it is not the time in seconds'
        )
    return clock


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
    table: CsvTable,
    layout: Layout,
    columns: list[int],
    rate: float,
    clock: _Clock | None,
    progress: Progress | None,
) -> Iterator[Piece]:
    wanted = columns if clock is None else [*columns, clock.column]
    before: NDArray[np.float64] = np.empty(0)
    index = 0
    for line, rows in table.rows(wanted, samples_per_block(rate), progress):
        starts = np.zeros(1, np.int64)
        skipped = np.zeros(len(rows), np.int64)
        if clock is not None:
            times = np.concatenate([before, rows[:, -1]])
            steps = clock.steps(table.path, line - len(before), times)
            skipped[len(rows) - len(steps) :] = steps - 1
            starts = np.union1d(starts, np.flatnonzero(skipped))
            before = times[-1:]
        lost = np.cumsum(skipped)
        time = (index + np.arange(len(rows)) + lost) / rate
        samples = np.column_stack(
            [sensor.to_si(rows[:, i], time) for i, sensor in enumerate(layout.sensors)]
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
