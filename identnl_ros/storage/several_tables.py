# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Files of one run, recorded by devices with clocks of their own, made into one bag."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
import secrets

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS, samples_per_block
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.source_alignment import SourceAlignment
from identnl_ros.core.synchronisation.stream_alignment import AlignedSamples, StreamAlignment
from identnl_ros.core.synchronisation.stream_source import StreamSource
from identnl_ros.storage.alignment_record import AlignedSource, write_alignment
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.formats.formats import open_table
from identnl_ros.storage.formats.table import Progress, Table
from identnl_ros.storage.stand_description import StandDescription
from identnl_ros.storage.table_import import block_of, Note, read_table, Reading, start_of
import numpy as np

# Of the begin of a recording, as its file states it [s].
START_DEVIATION = 5e-3
# What a file has before the last one begins is not needed, but for so much [s].
BEFORE = 0.2


@dataclass(frozen=True)
class ImportedTables:
    """
    What became of several files.

    Parameters
    ----------
    samples, lost_samples : int
        On the grid, and missing there between the samples.
    sample_rate : float
        Of the grid [Hz].
    sources : tuple of SourceAlignment
        How every file was aligned at the end.
    rates : tuple of float
        Of the files [Hz].
    notes : tuple of str
        About what was not understood.
    warnings : tuple of str
        About the alignment.
    time_columns, unused_columns : tuple of tuple of str
        Of each file: by which the time was checked, and what is neither that nor a sensor.

    """

    samples: int
    lost_samples: int
    sample_rate: float
    sources: tuple[SourceAlignment, ...]
    rates: tuple[float, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    time_columns: tuple[tuple[str, ...], ...]
    unused_columns: tuple[tuple[str, ...], ...]


@dataclass
class _File:
    """A file that is being read."""

    name: str
    layout: Layout
    start_ns: int
    reading: Reading
    time: float = 0.0  # read up to, since the earliest begin [s]


def import_tables(
    paths: Sequence[str | PathLike[str]],
    layout: Layout,
    bag_path: str | PathLike[str],
    *,
    model: Model | None = None,
    starts: Mapping[str, int] | None = None,
    same_start: bool = False,
    start_deviation: float = START_DEVIATION,
    format_name: str | None = None,
    ignore_units: bool = False,
    layout_text: str = '',
    machine_text: str = '',
    stream_id: int | None = None,
    progress: Progress | None = None,
    ignored: Collection[str] = (),
) -> ImportedTables:
    """
    Make one bag from the files of one run, on the grid of the first.

    Parameters
    ----------
    paths : sequence of path
        The first one gives the grid, with its rate, unless the layout states another.
    layout : Layout
        A sensor's column is ``file/column``, with the file's name without its ending, or the
        column alone where one file alone has it.
    bag_path : path
    model : Model or None
        None: what the files state of their begin decides alone.
    starts : mapping of str to int or None
        Host times of the first samples by file name, with or without its ending [ns].
    same_start : bool
        The times of all files count from the same instant.
    start_deviation : float
        Standard deviation of the stated begin of a file [s].
    format_name, ignore_units, layout_text, machine_text, stream_id, progress
        As `import_table` has them.
    ignored : collection of str
        Columns that are no times, as a sensor's column is given.

    Returns
    -------
    ImportedTables

    Raises
    ------
    DataError
        If a file does not fit, its begin is not known, the files do not overlap or have not seen
        the same motion, or the bag cannot be written.
    LayoutError
        If two sensors read the same column.

    """
    if len(paths) < 2:
        raise DataError('import: one file alone needs no alignment; give several')
    with ExitStack() as stack:
        wanted = [
            name for one in layout.sensors for name in (one.column, one.column.partition('/')[2])
        ]
        tables = [stack.enter_context(open_table(Path(one), format_name, wanted)) for one in paths]
        notes = [note for table in tables for note in table.notes]
        note = None if ignore_units else notes.append
        files = _files(
            tables,
            layout,
            note,
            _known_starts(tables, starts or {}),
            same_start,
            progress,
            _ignored(tables, ignored),
        )
        grid_rate = layout.sample_rate or files[0].reading.sample_rate
        sources = [
            StreamSource(
                one.name,
                tuple(sensor.name for sensor in one.layout.sensors),
                one.reading.sample_rate,
                start_deviation,
            )
            for one in files
        ]
        alignment = StreamAlignment(layout, sources, grid_rate, model)
        aligned = _aligned(files, alignment)
        first = next(aligned, None)
        if first is None:
            raise DataError('import: the files have no samples')
        _require_one_motion(alignment, start_deviation)
        description = StandDescription(
            stand=layout.stand,
            stream_id=secrets.randbits(63) if stream_id is None else stream_id,
            sample_rate=grid_rate,
            layout=alignment.layout,
            machine_text=machine_text,
            layout_text=layout_text,
            stamp_ns=max(0, first.stamp_ns),
        )
        count, end = _written(bag_path, description, first, aligned, alignment)
    return ImportedTables(
        count,
        end - count,
        grid_rate,
        alignment.state,
        tuple(one.reading.sample_rate for one in files),
        tuple(notes),
        alignment.remarks(),
        tuple(one.reading.time_columns for one in files),
        tuple(one.reading.unused_columns for one in files),
    )


def _require_one_motion(alignment: StreamAlignment, start_deviation: float) -> None:
    """Refuse files that have not seen the same at the same time."""
    for one in alignment.state:
        if one.contradiction:
            raise DataError(
                f'{one.name}: {one.contradiction}. Is its begin right (--start FILE=TIME; '
                f'--start-deviation: {start_deviation:g} s), and is it of the same run? Else a '
                'polarity, a gain or the order of its columns in the layout is wrong'
            )


def _written(
    bag_path: str | PathLike[str],
    description: StandDescription,
    first: AlignedSamples,
    aligned: Iterator[AlignedSamples],
    alignment: StreamAlignment,
) -> tuple[int, int]:
    """Write the bag; count samples, and what the grid had."""
    size = samples_per_block(description.sample_rate)
    count = end = 0
    with BagWriter(bag_path) as writer:
        writer.write_description(description)
        part: AlignedSamples | None = first
        while part is not None:
            following = next(aligned, None)
            for begin in range(0, len(part.samples), size):
                samples = part.samples[begin : begin + size]
                last = following is None and begin + size >= len(part.samples)
                block = block_of(description, part.first_index + begin, samples, last)
                writer.write_block(block)
                count, end = count + len(samples), block.next_index
            part = following
        write_alignment(
            writer,
            [
                AlignedSource(one.name, one.channels, one.deviation, one.by_motion)
                for one in alignment.state
            ],
        )
    return count, end


def _aligned(files: list[_File], alignment: StreamAlignment) -> Iterator[AlignedSamples]:
    """Read all files side by side, the one that is behind first."""
    waiting = dict(enumerate(files))
    origin = min(one.start_ns for one in files)
    common = (max(one.start_ns for one in files) - origin) / NANOSECONDS
    for one in files:
        one.time = (one.start_ns - origin) / NANOSECONDS
    empty = set(waiting)
    while waiting:
        number = min(waiting, key=lambda each: waiting[each].time)
        file = waiting[number]
        piece = next(file.reading.pieces, None)
        if piece is None:
            if number in empty:
                raise DataError(
                    f'{file.name}: ends before {max(files, key=lambda one: one.start_ns).name} '
                    'begins; the files are not of one run, or a start is wrong (--start FILE=TIME)'
                )
            del waiting[number]
            continue
        index, samples = piece
        begin = (file.start_ns - origin) / NANOSECONDS + index / file.reading.sample_rate
        file.time = begin + len(samples) / file.reading.sample_rate
        if file.time < common - BEFORE:
            continue
        empty.discard(number)
        stamp = file.start_ns + round(index / file.reading.sample_rate * NANOSECONDS)
        alignment.add(number, index, stamp, np.where(np.isfinite(samples), samples, np.nan))
        yield from alignment.take()
    yield from alignment.end()


def _files(
    tables: list[Table],
    layout: Layout,
    note: Note | None,
    starts: list[int | None],
    same_start: bool,
    progress: Progress | None,
    ignored: list[list[str]],
) -> list[_File]:
    owners = [_owner(sensor, tables) for sensor in layout.sensors]
    files = []
    for number, (table, start) in enumerate(zip(tables, starts, strict=True)):
        own = tuple(sensor for at, sensor in owners if at == number)
        if not own:
            raise DataError(
                f'{table.path}: no sensor of the layout has a column in it; leave the file out, '
                'or correct the key column in the layout'
            )
        part = replace(layout, sensors=own, sample_rate=None)
        shown = None if number else progress
        try:
            reading = read_table(table, part, note, shown, ignored[number])
        except DataError:
            if layout.sample_rate is None:
                raise
            part = replace(part, sample_rate=layout.sample_rate)
            reading = read_table(table, part, note, shown, ignored[number])
        begin = start if start is not None else start_of(table, reading, same_start)
        files.append(_File(table.path.stem, part, begin, reading))
    names = [one.name for one in files]
    if len(set(names)) < len(names):
        files = [
            replace(one, name=table.path.name) for one, table in zip(files, tables, strict=True)
        ]
    return files


def _owner(sensor: Sensor, tables: list[Table]) -> tuple[int, Sensor]:
    """Find the file that has the column of a sensor."""
    stem, slash, rest = sensor.column.partition('/')
    for number, table in enumerate(tables):
        if slash and stem in (table.path.stem, table.path.name):
            table.column(rest, f'sensor {sensor.name}')
            return number, replace(sensor, column=rest)
    found = [number for number, table in enumerate(tables) if _has(table, sensor.column)]
    if len(found) == 1:
        return found[0], sensor
    if found:
        where = ' and '.join(str(tables[number].path) for number in found)
        raise DataError(
            f'sensor {sensor.name}: {where} both have a column {sensor.column!r}; write '
            f'"column: {tables[found[0]].path.stem}/{sensor.column}" in the layout'
        )
    names = ', '.join(str(table.path) for table in tables)
    raise DataError(
        f'sensor {sensor.name}: none of {names} has a column {sensor.column!r}; correct the key '
        'column in the layout'
    )


def _ignored(tables: list[Table], ignored: Collection[str]) -> list[list[str]]:
    """Share out the columns that are no times."""
    shares: list[list[str]] = [[] for _ in tables]
    for name in ignored:
        stem, slash, rest = name.partition('/')
        found = [
            (number, rest)
            for number, table in enumerate(tables)
            if slash and stem in (table.path.stem, table.path.name)
        ] or [(number, name) for number, table in enumerate(tables) if _has(table, name)]
        if not found:
            paths = ', '.join(str(table.path) for table in tables)
            raise DataError(f'--ignore-column {name}: none of {paths} has such a column')
        for number, own in found:
            shares[number].append(own)
    return shares


def _has(table: Table, name: str) -> bool:
    return any(name == column.name or name in column.aliases for column in table.columns)


def _known_starts(tables: list[Table], starts: Mapping[str, int]) -> list[int | None]:
    unknown = set(starts)
    result: list[int | None] = []
    for table in tables:
        names = (str(table.path), table.path.name, table.path.stem)
        named = next((one for one in names if one in starts), None)
        unknown.discard(named or '')
        result.append(starts[named] if named else None)
    if unknown:
        raise DataError(
            f'import: a start is given for {", ".join(sorted(unknown))}, which is none of the '
            f'files; they are {", ".join(table.path.name for table in tables)}'
        )
    return result
