# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Tables of numbers in text files, read a piece at a time, with line numbers in all errors."""

from codecs import getincrementaldecoder
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from io import BufferedReader, StringIO, TextIOWrapper
from itertools import islice
from operator import itemgetter
from pathlib import Path
import re

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.csv_cells import (
    COMMA,
    decimal_mark,
    is_number,
    POINT,
    RowReader,
    UNDECIDED,
)
from identnl_ros.storage.formats.date_times import decimals as date_decimals, nanoseconds
from identnl_ros.storage.formats.table import (
    Column,
    MOST_DIGITS,
    NO_UNITS,
    Progress,
    Table,
    TIME_DIGITS,
)
from identnl_ros.storage.quantities import is_unit
import numpy as np
from numpy.typing import NDArray

HEAD_SIZE = 2**20  # [bytes] in which the first row must end
HEAD_LINES = 200  # in which the names must stand
ROWS_TO_UNDERSTAND = 1000
TAIL_SIZE = 2**14  # [bytes]
OTHER_ENCODING = 'cp1252'  # of western data acquisition programs

_NAME_AND_UNIT = re.compile(r'(.*\S)\s*(?:\[([^][]+)\]|\(([^()]+)\))')


@dataclass(frozen=True)
class _Line:
    """A line of the head, with what follows a # apart."""

    number: int
    content: str
    remark: str


class CsvTable(Table):
    """
    A text file with a column for each channel and a row for each sample.

    Cells are separated by tabs, semicolons, commas or blanks; what the first row has decides.
    Between tabs and semicolons numbers may have a decimal comma. Empty lines and what follows a
    ``#`` are skipped. The names stand in the first row or in the comment before it, units with
    them or in the row after them; without names columns go by number.

    Parameters
    ----------
    path : Path
    wanted : collection of str
        Names of columns. Lines before the one that has most of them are skipped.

    Raises
    ------
    DataError
        If the file cannot be read or has no rows.

    """

    row_name = 'line'
    # What remains of a name without its unit.
    aliases_are_names = True

    def __init__(self, path: Path, wanted: Collection[str] = ()) -> None:
        """Read the names of the columns."""
        super().__init__(path)
        self._encoding = 'utf-8-sig'
        self._separator: str | None = None
        self._first_line = 1
        self._width = 0
        lines = self._head()
        names, units = self._names(lines, frozenset(wanted))
        rows = list(self._first_rows(lines))
        self._marks = [
            {decimal_mark(row[i], self._separator) for row in rows} - {UNDECIDED}
            for i in range(self._width)
        ]
        self.columns = tuple(
            self._understood(_column(name, unit), [row[i] for row in rows])
            for i, (name, unit) in enumerate(zip(names, units, strict=True))
        )

    def place(self, row: int) -> str:
        """Name a line for an error."""
        return f'{self.path}:{row}'

    def rows(
        self, columns: Sequence[int], count: int, progress: Progress | None = None
    ) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """
        Read the numbers of some columns.

        Parameters
        ----------
        columns : sequence of int
            Indices from 0.
        count : int
            Rows in a piece.
        progress : callable or None
            Called with the bytes read and the size of the file after every piece.

        Yields
        ------
        tuple of int and ndarray
            Number of the piece's first line and its rows; empty cells are NaN.

        Raises
        ------
        DataError
            If a row is too short or too long, or a cell holds something else than a number.

        """
        origins = [self.columns[column].origin_ns for column in columns]
        mark = self._mark(columns)
        read_row = RowReader(self.path, columns, self._separator, mark, origins)
        is_plain = mark == POINT and not any(origin is not None for origin in origins)
        pick = itemgetter(*columns) if len(columns) > 1 else lambda cells: (cells[columns[0]],)
        size = self.path.stat().st_size
        with self.path.open('rb') as binary, self._as_text(binary) as text:
            values: list[list[float]] = []
            first = self._first_line
            for number, line in enumerate(text, 1):
                if number < self._first_line:
                    continue
                cells = self._cells(line)
                if len(cells) != self._width:
                    if not any(cell.strip() for cell in cells):
                        continue
                    if len(cells) != self._width + 1 or cells[-1].strip():
                        raise DataError(
                            f'{self.path}:{number}: {len(cells)} cells, expected {self._width} as '
                            f'in line {self._first_line}; repair or remove the row'
                        )
                if not values:
                    first = number
                try:
                    # What most files need, as fast as it gets.
                    plain = is_plain and '_' not in line
                    row = list(map(float, pick(cells))) if plain else read_row(cells, number)
                except ValueError:
                    row = read_row(cells, number)
                values.append(row)
                if len(values) == count:
                    yield first, np.array(values)
                    values = []
                    if progress:
                        progress(binary.tell(), size)
            if values:
                yield first, np.array(values)
            if progress:
                progress(size, size)

    def digits(self, column: int, count: int) -> tuple[int, int]:
        """
        Tell how exactly the numbers of a column are printed.

        Parameters
        ----------
        column : int
            Index from 0.
        count : int
            Rows to look at; besides them the end of the file, where numbers are longer.

        Returns
        -------
        decimals : int
            Most places after the point; negative: so many zeros before it.
        significant : int
            Most significant digits.

        """
        decimals, significant = -MOST_DIGITS, 1
        with self.path.open('rb') as binary, self._as_text(binary) as text:
            lines = list(islice(text, self._first_line - 1, self._first_line - 1 + count))
        with self.path.open('rb') as binary:
            binary.seek(max(0, self.path.stat().st_size - TAIL_SIZE))
            lines += binary.read().decode('utf-8', 'replace').splitlines()[1:]
        is_dated = self.columns[column].origin_ns is not None
        for line in lines:
            cells = self._cells(line)
            if column >= len(cells):
                continue
            if is_dated:
                if nanoseconds(cells[column]) is not None:
                    decimals = max(decimals, date_decimals(cells[column]))
                significant = TIME_DIGITS
                continue
            mantissa, _, exponent = cells[column].strip().lower().partition('e')
            before, _, after = mantissa.lstrip('+-').replace(COMMA, POINT).partition(POINT)
            if (before + after).isdecimal() and (exponent or '0').lstrip('+-').isdecimal():
                decimals = max(decimals, len(after) - int(exponent or 0))
                significant = max(significant, len((before + after).lstrip('0')))
        return decimals, significant

    def _head(self) -> list[_Line]:
        """Read the first lines and find the encoding."""
        try:
            with self.path.open('rb') as binary:
                head = binary.read(HEAD_SIZE)
        except OSError as error:
            raise DataError(f'{self.path} cannot be read: {error.strerror or error}') from None
        if b'\0' in head or (len(head) == HEAD_SIZE and b'\n' not in head.replace(b'\r', b'\n')):
            raise DataError(
                f'{self.path} is not a text file in UTF-8 or ASCII; export it as CSV from the '
                'program that made it'
            )
        try:
            text = getincrementaldecoder('utf-8-sig')().decode(head, len(head) < HEAD_SIZE)
        except UnicodeDecodeError:
            self._encoding = OTHER_ENCODING
            self.notes.append(f'{self.path} is not in UTF-8; it is read as Windows-1252')
            text = head.decode(self._encoding, 'replace')
        lines = []
        for number, line in enumerate(StringIO(text, newline=None), 1):
            content, _, remark = line.partition('#')
            lines.append(_Line(number, content, remark))
        if len(head) == HEAD_SIZE and len(lines) > 1:
            lines.pop()  # it may be cut
        return lines

    def _names(
        self, lines: list[_Line], wanted: frozenset[str]
    ) -> tuple[Sequence[str], Sequence[str]]:
        """Find the separator, the first line of numbers, names and units."""
        filled = [line for line in lines if line.content.strip()]
        if not filled:
            raise self._without_rows()
        head = self._line_of_names(filled, wanted)
        self._separator = _separator(filled[head].content)
        cells = _without_empty_end(self._cells(filled[head].content))
        if all(self._is_value(cell) for cell in cells):
            self._first_line, self._width = filled[head].number, len(cells)
            comments = [line.remark for line in lines[: filled[head].number - 1]]
            comment = next((one for one in reversed(comments) if one.strip()), '')
            remarked = [cell.strip() for cell in self._cells(comment)]
            if len(remarked) != self._width:
                remarked = [''] * self._width
            return remarked, [''] * self._width
        names = [cell.strip() for cell in cells]
        self._width = len(names)
        if head:
            self.notes.append(
                f'{self.path}: the {head} lines before the names of the columns in line '
                f'{filled[head].number} are skipped'
            )
        following = filled[head + 1 :]
        units = [''] * self._width
        if following and self._is_row_of_units(following[0].content):
            units = [_bare(cell) for cell in self._cells(following[0].content)][: self._width]
            following = following[1:]
        if not following:
            raise self._without_rows()
        first = following[0]
        row = self._cells(first.content)
        count = len(row)
        if count != self._width and (count != self._width + 1 or row[-1].strip()):
            raise DataError(
                f'{self.path}:{first.number}: {count} cells, but line {filled[head].number}, '
                f'where the names of the columns should stand, has {self._width}; lines before '
                'the names must begin with #'
            )
        self._first_line = first.number
        return names, units

    def _without_rows(self) -> DataError:
        return DataError(
            f'{self.path} has no rows of numbers; expected a row of names and a row of numbers '
            'for each sample'
        )

    def _line_of_names(self, filled: list[_Line], wanted: frozenset[str]) -> int:
        """Find the line that has most of the wanted names; the first one if none has any."""
        found = []
        for line in filled[:HEAD_LINES]:
            self._separator = _separator(line.content)
            columns = [_column(cell.strip()) for cell in self._cells(line.content)]
            names = {name for one in columns for name in (one.name, *one.aliases)}
            found.append(len(names & wanted))
        return found.index(max(found))

    def _first_rows(self, lines: list[_Line]) -> Iterator[list[str]]:
        for line in lines[self._first_line - 1 : self._first_line - 1 + ROWS_TO_UNDERSTAND]:
            cells = self._cells(line.content)
            if line.content.strip() and len(cells) >= self._width:
                yield cells

    def _understood(self, column: Column, cells: list[str]) -> Column:
        """Say of a column whether it holds times or other texts."""
        filled = [cell.strip() for cell in cells if cell.strip()]
        if not filled or self._is_number(filled[0]):
            return column
        origin = nanoseconds(filled[0])
        if origin is None:
            return replace(column, text=filled[0])
        return replace(column, unit='', origin_ns=origin)

    def _is_number(self, cell: str) -> bool:
        return is_number(cell) or decimal_mark(cell, self._separator) != UNDECIDED

    def _is_value(self, cell: str) -> bool:
        return self._is_number(cell) or nanoseconds(cell) is not None

    def _is_row_of_units(self, content: str) -> bool:
        cells = [_bare(cell) for cell in self._cells(content)]
        filled = [cell for cell in cells if cell]
        if len(cells) not in (self._width, self._width + 1) or not filled:
            return False
        known = sum(cell in NO_UNITS or is_unit(cell) for cell in filled)
        return 2 * known > len(filled) and not any(self._is_value(cell) for cell in filled)

    def _mark(self, columns: Sequence[int]) -> str:
        """Find the decimal mark of some columns."""
        marks = {mark for column in columns for mark in self._marks[column]}
        if len(marks) > 1:
            comma = next(one for one in columns if COMMA in self._marks[one])
            point = next(one for one in columns if POINT in self._marks[one])
            raise DataError(
                f'{self.path}: there are numbers with a decimal comma (column {comma + 1} '
                f'{self.columns[comma].name!r}) and with a decimal point (column {point + 1} '
                f'{self.columns[point].name!r}); write all numbers of the file alike'
            )
        undecided = UNDECIDED if self._separator in (';', '\t') else POINT
        return next(iter(marks), undecided)

    def _as_text(self, binary: BufferedReader) -> TextIOWrapper:
        return TextIOWrapper(binary, self._encoding, 'replace')

    def _cells(self, line: str) -> list[str]:
        if '#' in line:
            line = line.split('#')[0]
        if '"' in line:
            line = line.replace('"', '')
        return line.split(self._separator)


def _column(name: str, unit: str = '') -> Column:
    """Take ``force [N]`` or ``force (N)`` apart, where it is a unit that stands there."""
    match = _NAME_AND_UNIT.fullmatch(name)
    stated = (match[2] or match[3]).strip() if match else ''
    if match is None or not is_unit(stated):
        return Column(name, unit)
    return Column(name, stated, aliases=(match[1],))


def _bare(cell: str) -> str:
    """Take brackets off a unit."""
    text = cell.strip()
    return text[1:-1].strip() if text[:1] + text[-1:] in ('[]', '()') else text


def _separator(content: str) -> str | None:
    return next((mark for mark in '\t;,' if mark in content), None)


def _without_empty_end(cells: list[str]) -> list[str]:
    return cells[:-1] if len(cells) > 1 and not cells[-1].strip() else cells
