# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of other programs, in text files, made into bags."""

from collections.abc import Iterator
from os import PathLike
from pathlib import Path
import re
import secrets

from identnl_ros.core.blocks import ChannelStatus, SampleBlock, samples_per_block, stamp_after
from identnl_ros.core.errors import DataError
from identnl_ros.core.layout import Layout
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.csv_table import CsvTable, Progress
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

TIME_TOLERANCE = 1e-6  # of the sample interval [-]
ROWS_FOR_RATE = 1000

_TIME_NAME = re.compile(r'(time|t)\s*([\[(]s[\])]|_s)?', re.IGNORECASE)


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
) -> int:
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
    int
        Number of samples.

    Raises
    ------
    DataError
        If the file does not fit the layout, is not sound, or the bag cannot be written.

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
    index = 0
    with BagWriter(bag_path, compress=compress) as writer:
        writer.write_description(description)
        for samples, last in _with_last(pieces):
            missing, saturated = np.isnan(samples), np.isinf(samples)
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
            index = block.next_index
    return index


def read_csv(
    path: str | PathLike[str], layout: Layout, progress: Progress | None = None
) -> tuple[float, Iterator[NDArray[np.float64]]]:
    """
    Read the samples of all sensors from a CSV file.

    Parameters
    ----------
    path : path
    layout : Layout
        If it states no sample rate, a column ``time`` or ``t`` [s] must tell it.
    progress : callable or None
        Called with the bytes read and the size of the file.

    Returns
    -------
    sample_rate : float
        [Hz].
    blocks : iterator of ndarray, shape (n_samples, n_channels)
        SI units; NaN for empty cells, infinite where the file says so.

    Raises
    ------
    DataError
        If the file does not fit the layout or is not sound; also while iterating.

    """
    table = CsvTable(Path(path))
    columns = [table.column(sensor.column, f'sensor {sensor.name}') for sensor in layout.sensors]
    rate = layout.sample_rate
    time = None
    if rate is None:
        time = _time_column(table)
        rate = _sample_rate(table, time)
    return rate, _blocks(table, layout, columns, rate, time, progress)


def _blocks(
    table: CsvTable,
    layout: Layout,
    columns: list[int],
    rate: float,
    time: int | None,
    progress: Progress | None,
) -> Iterator[NDArray[np.float64]]:
    size = samples_per_block(rate)
    wanted = columns if time is None else [*columns, time]
    before: NDArray[np.float64] = np.empty(0)
    for line, rows in table.rows(wanted, size, progress):
        if time is not None:
            times = np.concatenate([before, rows[:, -1]])
            _check_uniform(table.path, line - len(before), times, 1 / rate)
            before = times[-1:]
        recorded = rows[:, : len(columns)]
        yield np.column_stack(
            [sensor.to_si(recorded[:, i]) for i, sensor in enumerate(layout.sensors)]
        )


def _with_last(
    pieces: Iterator[NDArray[np.float64]],
) -> Iterator[tuple[NDArray[np.float64], bool]]:
    """Tell of each piece whether it is the last."""
    piece = next(pieces)
    for following in pieces:
        yield piece, False
        piece = following
    yield piece, True


def _time_column(table: CsvTable) -> int:
    for index, name in enumerate(table.names):
        if _TIME_NAME.fullmatch(name):
            return index
    raise DataError(
        f'{table.path}: the sample rate is not known: the layout has no sample_rate and the file '
        'no column "time" in seconds; give sample_rate [Hz] in the layout'
    )


def _sample_rate(table: CsvTable, time: int) -> float:
    """Mean rate of the first rows; of two nearly equal numbers the rounder one."""
    line, rows = next(table.rows([time], ROWS_FOR_RATE))
    times = rows[:, 0]
    if len(times) < 2 or not times[-1] > times[0]:
        raise DataError(
            f'{table.path}:{line}: the time does not increase, so the sample rate is not known; '
            'give sample_rate [Hz] in the layout'
        )
    rate = (len(times) - 1) / float(times[-1] - times[0])
    rounder = float(f'{rate:.9g}')
    return rounder if abs(rounder - rate) < 1e-9 * rate else rate


def _check_uniform(path: Path, line: int, times: NDArray[np.float64], interval: float) -> None:
    steps = np.diff(times)
    rounding = 4 * np.finfo(float).eps * np.abs(times[1:])
    wrong = ~(np.abs(steps - interval) <= TIME_TOLERANCE * interval + rounding)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise DataError(
            f'{path}: time is not uniform: near line {line + at + 1} it steps by '
            f'{steps[at]:.9g} s, expected {interval:.9g} s within {TIME_TOLERANCE:g} of it; '
            'resample the recording, or give sample_rate [Hz] in the layout if the times are '
            'only rounded'
        )
