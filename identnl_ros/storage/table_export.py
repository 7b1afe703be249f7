# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The samples of bags as tables for other programs."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.storage.bag_reader import Bag
from identnl_ros.storage.formats.csv_writer import write_csv
from identnl_ros.storage.formats.formats import chosen
from identnl_ros.storage.formats.parquet_writer import write_parquet
from identnl_ros.storage.formats.table import Progress
from identnl_ros.storage.formats.uff58_writer import write_uff58
from identnl_ros.storage.formats.writers import Recording, Writer
from identnl_ros.storage.replaced_file import replaced, require_folder
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

ROWS_AT_ONCE = 2**12

WRITERS: dict[str, Writer] = {
    'csv': write_csv,
    'uff58': write_uff58,
    'parquet': write_parquet,
}


@dataclass(frozen=True)
class Exported:
    """
    Size of an exported record.

    Parameters
    ----------
    samples : int
    lost_samples : int
        That the bag lacks between its first and its last.
    sample_rate : float
        [Hz].
    layout : Layout
        By which the table is read: columns by the names of the sensors, in SI units.

    """

    samples: int
    lost_samples: int
    sample_rate: float
    layout: Layout


def export_table(
    bag: Bag,
    path: str | PathLike[str],
    *,
    format_name: str | None = None,
    stream_number: int | None = None,
    progress: Progress | None = None,
) -> Exported:
    """
    Write the samples of a bag as a table; the file appears when it is complete.

    Parameters
    ----------
    bag : Bag
    path : path
        Must not exist; its folder must.
    format_name : str or None
        One of `WRITERS`; None: by the end of the file's name.
    stream_number : int or None
        From 1, in the order of recording; None: the only one.
    progress : callable or None
        Called with what is done and what there is to do.

    Returns
    -------
    Exported

    Raises
    ------
    DataError
        If there is more than one stream to choose from, or none of the number, nothing to write,
        no such folder, or the file cannot be written.

    """
    path = Path(path)
    write = chosen(WRITERS, path, format_name)
    if path.exists():
        raise DataError(
            f'{path} exists and is never overwritten; choose another path or remove it'
        )
    require_folder(path)
    stream = _stream(bag, stream_number)
    first = end = samples = 0
    for index, block in _samples(bag, stream):
        first = first if samples else index
        samples += len(block)
        end = index + len(block)
    if not samples:
        raise DataError(
            f'{bag.path}: the stream of stand {stream.stand} has no samples{bag.damage}'
        )
    names = tuple(sensor.name for sensor in stream.layout.sensors)

    def rows() -> Iterator[tuple[int, NDArray[np.float64]]]:
        for index, block in _samples(bag, stream):
            yield index - first, block
            if progress:
                progress(index + len(block) - first, end - first)

    recording = Recording(
        stand=stream.stand,
        names=names,
        kinds=tuple(sensor.kind for sensor in stream.layout.sensors),
        sample_rate=stream.sample_rate,
        stamp_ns=stream.stamp_ns,
        length=end - first,
        rows=rows,
    )
    with replaced(path) as file:
        write(file, recording)
    return Exported(samples, end - first - samples, stream.sample_rate, _layout(stream))


def _stream(bag: Bag, number: int | None) -> StandDescription:
    streams = bag.streams
    if number is None and len(streams) > 1:
        listed = ', '.join(f'{i} ({one.stand})' for i, one in enumerate(streams, 1))
        raise DataError(f'{bag.path} holds several streams: {listed}; choose one with --stream')
    if number is not None and not 1 <= number <= len(streams):
        raise DataError(
            f'{bag.path}: no stream {number}, expected 1 to {len(streams)} (option --stream)'
        )
    return streams[(number or 1) - 1]


def _samples(bag: Bag, stream: StandDescription) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Yield running index and samples without gaps, repeated ones left out."""
    follower = StreamFollower()
    parts: list[NDArray[np.float64]] = []
    first = count = 0
    for block in bag.blocks(stream.stream_id):
        arrival = follower.accept(block.stream_id, block.first_index, block.next_index, block.last)
        if not arrival.usable or not len(block.samples):
            continue
        if parts and (block.first_index != first + count or count >= ROWS_AT_ONCE):
            yield first, np.concatenate(parts)
            parts, count = [], 0
        if not parts:
            first = block.first_index
        parts.append(block.samples)
        count += len(block.samples)
    if parts:
        yield first, np.concatenate(parts)


def _layout(stream: StandDescription) -> Layout:
    """Describe the table: what was recorded is SI now, gains and offsets are taken out."""
    sensors = tuple(
        replace(one, column=one.name, recorded_unit=one.kind.unit, gain=1.0, offset=0.0, drift=0.0)
        for one in stream.layout.sensors
    )
    return replace(stream.layout, sensors=sensors, sample_rate=stream.sample_rate)
