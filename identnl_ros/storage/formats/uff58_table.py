# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Time records in universal files: data sets 58, in text or binary (58b).

Read here, a piece at a time, because the libraries for this format hold the whole file in
memory.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
import math
from pathlib import Path
from typing import Any, BinaryIO

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.table import ChannelTable, Column, Progress, single_digits, Spool
from identnl_ros.storage.quantities import convert, UnitError
import numpy as np
from numpy.typing import NDArray

NONE = 'NONE'
DELIMITER = b'-1'
HEAD_LINES = 11
PRINTED_DIGITS = 6  # of the increment of time
LINES_AT_ONCE = 2**14
LONGEST_LINE = 2**10  # [bytes]

# Codes of the format.
TIME_RESPONSE = 1
TIME = 17
EVEN = 1
SINGLE, DOUBLE = 2, 4
LITTLE_ENDIAN, IEEE_754 = 1, 2

_DIRECTIONS = {
    0: '', 1: '+x', -1: '-x', 2: '+y', -2: '-y', 3: '+z', -3: '-z',
    4: '+rx', -4: '-rx', 5: '+ry', -5: '-ry', 6: '+rz', -6: '-rz',
}  # fmt: skip


@dataclass
class _Set:
    """
    Where the numbers of a data set are.

    Parameters
    ----------
    column : Column
    begin : int
        Of the numbers in the file [bytes].
    count : int
    dtype : dtype
    is_text : bool
    is_even : bool
        One instant follows another at the same distance.
    start : float
        First abscissa [s].
    spool : Spool or None
        The numbers of a text, once they were asked for.

    """

    column: Column
    begin: int
    count: int
    dtype: np.dtype[Any]
    is_text: bool
    is_even: bool
    start: float
    spool: Spool | None = None


class Uff58Table(ChannelTable):
    """
    A universal file.

    A data set is a column by its first identification line and by node and direction of the
    response, e.g. ``12:+z``; its unit is the label of the ordinate. Others than real functions of
    time are left out.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If the file cannot be read or has no time record.

    """

    format_name = 'UFF58'
    tells_instants = True

    def __init__(self, path: Path) -> None:
        """Find the data sets."""
        super().__init__(path)
        self._sets: list[_Set] = []
        with self.told_errors():
            self._stream = path.open('rb')
        try:
            with self.told_errors():
                self._sets = list(self._found_sets())
            self.columns = tuple(one.column for one in self._sets)
            if not self.columns:
                raise DataError(
                    f'{path} has no columns: expected data sets 58 of real functions of time'
                )
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._stream.close()
        for one in self._sets:
            if one.spool is not None:
                one.spool.close()

    def rows(
        self, columns: Sequence[int], count: int, progress: Progress | None = None
    ) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Read the numbers of some columns that begin together; see `Table.rows`."""
        first = self._sets[columns[0]]
        for one in (self._sets[column] for column in columns):
            printed = 10.0 ** (1 - PRINTED_DIGITS) * max(abs(one.start), abs(first.start))
            if abs(one.start - first.start) > printed:
                raise DataError(
                    f'{self.path}: column {one.column.name!r} begins at {one.start:g} s, but '
                    f'{first.column.name!r} at {first.start:g} s; expected channels that were '
                    'recorded at the same instants'
                )
        yield from super().rows(columns, count, progress)

    def length(self, column: int) -> int:
        """Count the values of a data set."""
        found = self._sets[column]
        if not found.is_even:
            raise DataError(
                f'{self.path}: column {found.column.name!r} is recorded at uneven instants '
                '(abscissa spacing 0); resample the recording to even ones'
            )
        return found.count

    def read(self, column: int, begin: int, end: int) -> NDArray[Any]:
        """Read a part of a data set."""
        found = self._sets[column]
        if found.is_text:
            if found.spool is None:
                found.spool = Spool(self._printed(found), found.dtype)
            return found.spool.read(begin, end)
        self._stream.seek(found.begin + begin * found.dtype.itemsize)
        return np.fromfile(self._stream, found.dtype, end - begin)

    def digits(self, column: int, count: int) -> tuple[int, int] | None:
        """Tell how exact a column is; see `Table.digits`."""
        return single_digits(self._sets[column].dtype)

    def _found_sets(self) -> Iterator[_Set]:
        stream = self._stream
        while line := stream.readline(LONGEST_LINE):
            if line.strip() != DELIMITER:
                continue
            kind = stream.readline(LONGEST_LINE).decode('latin1').lower()
            if kind[:6].strip() == '58':
                found = self._one_set(kind)
                if found is not None:
                    yield found
            for line in iter(lambda: stream.readline(LONGEST_LINE), b''):
                if line.strip() == DELIMITER:
                    break

    def _one_set(self, kind: str) -> _Set | None:
        """Read the head of a data set and leave the file behind its numbers."""
        stream = self._stream
        head = [
            stream.readline(LONGEST_LINE).decode('utf-8', 'replace').rstrip('\r\n')
            for _ in range(HEAD_LINES)
        ]
        begin = stream.tell()
        is_text = kind[6:7] != 'b'
        function = int(head[5][:5])
        response = f'{int(head[5][41:51] or 0)}:{_DIRECTIONS.get(int(head[5][51:55] or 0), "")}'
        number_type, count, spacing = (int(head[6][at : at + 10]) for at in (0, 10, 20))
        increment = float(head[6][43:56])
        dtype = np.dtype('f4' if number_type == SINGLE else 'f8')
        if not is_text:
            order, floating = int(kind[7:13]), int(kind[13:19])
            size = int(kind[31:43])
            stream.seek(size, 1)
            dtype = dtype.newbyteorder('<' if order == LITTLE_ENDIAN else '>')
            if floating != IEEE_754:
                raise DataError(
                    f'{self.path}: the floating-point format {floating} of a data set is not '
                    'known, expected 2 (IEEE 754); write the file as text'
                )
        abscissa = int(head[7][:10])
        if (
            number_type not in (SINGLE, DOUBLE)
            or function not in (0, TIME_RESPONSE)
            or abscissa not in (0, TIME)
        ):
            return None
        if not is_text and spacing == EVEN and size != count * dtype.itemsize:
            raise DataError(
                f'{self.path}: a data set of {count} numbers has {size} bytes, expected '
                f'{count * dtype.itemsize}; the file is damaged'
            )
        name = head[0].strip()
        name = response if name in ('', NONE) else name
        unit = _seconds(_label(head[7]))
        rate, tolerance = _rate(increment * unit)
        start = float(head[6][30:43]) * unit
        column = Column(name, _label(head[8]), rate, tolerance, aliases=(response,))
        return _Set(column, begin, count, dtype, is_text, spacing == EVEN, start)

    def _printed(self, found: _Set) -> Iterator[NDArray[np.float64]]:
        """Read the numbers of a data set in text."""
        width = 13 if found.dtype.itemsize == 4 else 20
        stream = self._stream
        stream.seek(found.begin)
        left = found.count
        while left > 0:
            values: list[float] = []
            for line in islice(_lines(stream), LINES_AT_ONCE):
                text = line.rstrip().replace(b'D', b'E')
                values += [float(text[at : at + width]) for at in range(0, len(text), width)]
            if not values:
                raise DataError(
                    f'{self.path}: column {found.column.name!r} has {found.count - left} numbers, '
                    f'expected {found.count}; the file is damaged or cut off'
                )
            yield np.array(values[:left])
            left -= len(values)


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the lines of numbers up to the end of the data set."""
    while True:
        begin = stream.tell()
        line = stream.readline(LONGEST_LINE)
        if not line or line.strip() == DELIMITER:
            stream.seek(begin)
            return
        yield line


def _label(line: str) -> str:
    unit = line[46:67].strip()
    return '' if unit.upper() == NONE else unit


def _seconds(unit: str) -> float:
    if unit in ('', 's'):
        return 1.0
    try:
        return convert(1.0, unit, 's')
    except UnitError:
        return 1.0


def _rate(increment: float) -> tuple[float | None, float]:
    """Find the rate and how exactly the few printed digits tell it."""
    if not (math.isfinite(increment) and increment > 0):
        return None, 1.0
    step = 10.0 ** (math.floor(math.log10(increment)) + 1 - PRINTED_DIGITS)
    tolerance = step / increment
    rate = 1 / increment
    whole = float(round(rate))
    is_whole = whole > 0 and abs(whole / rate - 1) <= tolerance
    return (whole if is_whole else rate), tolerance
