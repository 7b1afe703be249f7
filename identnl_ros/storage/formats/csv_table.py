# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Tables of numbers in text files, read a piece at a time, with line numbers in all errors."""

from collections.abc import Iterator, Sequence
from io import BufferedReader, StringIO, TextIOWrapper
from itertools import islice
from operator import itemgetter
from pathlib import Path
import re

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.table import Column, MOST_DIGITS, Progress, Table
from identnl_ros.storage.quantities import is_unit
import numpy as np
from numpy.typing import NDArray

HEAD_SIZE = 2**20  # [bytes] in which the first row must end
TAIL_SIZE = 2**14  # [bytes]

_NAME_AND_UNIT = re.compile(r'(.*\S)\s*(?:\[([^][]+)\]|\(([^()]+)\))')


class CsvTable(Table):
    """
    A text file with a column for each channel and a row for each sample.

    Cells are separated by tabs, semicolons, commas or blanks; what the first row has decides.
    Empty lines and what follows a ``#`` are skipped. The names stand in the first row or in
    the comment before it; without them columns go by number.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If the file cannot be read or has no rows.

    """

    row_name = 'line'
    # What remains of a name without its unit.
    aliases_are_names = True

    def __init__(self, path: Path) -> None:
        """Read the names of the columns."""
        super().__init__(path)
        self._find_head()
        names = self._names or [''] * self._width
        self.columns = tuple(_column(name) for name in names)

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
        pick = itemgetter(*columns) if len(columns) > 1 else lambda cells: (cells[columns[0]],)
        size = self.path.stat().st_size
        with self.path.open('rb') as binary, _as_text(binary) as text:
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
                    # Python takes 1_0 for ten; no program writes numbers so.
                    if '_' in line:
                        raise ValueError
                    values.append(list(map(float, pick(cells))))
                except ValueError:
                    values.append([self._number(cells[column], number) for column in columns])
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
        with self.path.open('rb') as binary, _as_text(binary) as text:
            lines = list(islice(text, self._first_line - 1, self._first_line - 1 + count))
        with self.path.open('rb') as binary:
            binary.seek(max(0, self.path.stat().st_size - TAIL_SIZE))
            lines += binary.read().decode('utf-8', 'replace').splitlines()[1:]
        for line in lines:
            cells = self._cells(line)
            if column >= len(cells):
                continue
            mantissa, _, exponent = cells[column].strip().lower().partition('e')
            before, _, after = mantissa.lstrip('+-').partition('.')
            if (before + after).isdecimal() and (exponent or '0').lstrip('+-').isdecimal():
                decimals = max(decimals, len(after) - int(exponent or 0))
                significant = max(significant, len((before + after).lstrip('0')))
        return decimals, significant

    def _find_head(self) -> None:
        """Find the separator, the names and the first line of numbers."""
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
        comment = ''
        named = False
        self._names: list[str] = []
        for number, line in enumerate(_lines(head), 1):
            content, _, remark = line.partition('#')
            if not content.strip():
                comment = remark if remark.strip() else comment
                continue
            if not named:
                self._separator = next((mark for mark in '\t;,' if mark in content), None)
            cells = _without_empty_end(self._cells(content))
            if not named and not all(_is_number(cell) for cell in cells):
                self._names, named = [cell.strip() for cell in cells], True
                continue
            self._width = len(self._names) if named else len(cells)
            remarked = [cell.strip() for cell in self._cells(comment)]
            if not named and len(remarked) == self._width:
                self._names = remarked
            self._first_line = number
            return
        raise DataError(
            f'{self.path} has no rows of numbers; expected a row of names and a row of numbers '
            'for each sample'
        )

    def _cells(self, line: str) -> list[str]:
        if '#' in line:
            line = line.split('#')[0]
        if '"' in line:
            line = line.replace('"', '')
        return line.split(self._separator)

    def _number(self, cell: str, line: int) -> float:
        """Convert a cell that may be empty or wrong."""
        text = cell.strip()
        if not text:
            return float('nan')
        try:
            return _converted(text)
        except ValueError:
            hint = ', with a decimal point' if ',' in text else ''
            raise DataError(
                f'{self.path}:{line}: {text[:40]!r} is not a number{hint}; '
                'correct it, or start the line with # to skip it'
            ) from None


def _column(name: str) -> Column:
    """Take ``force [N]`` or ``force (N)`` apart, where it is a unit that stands there."""
    match = _NAME_AND_UNIT.fullmatch(name)
    unit = (match[2] or match[3]).strip() if match else ''
    if match is None or not is_unit(unit):
        return Column(name)
    return Column(name, unit, aliases=(match[1],))


def _as_text(binary: BufferedReader) -> TextIOWrapper:
    return TextIOWrapper(binary, 'utf-8-sig', 'replace')


def _lines(head: bytes) -> Iterator[str]:
    return iter(StringIO(head.decode('utf-8-sig', 'replace'), newline=None))


def _without_empty_end(cells: list[str]) -> list[str]:
    return cells[:-1] if len(cells) > 1 and not cells[-1].strip() else cells


def _is_number(cell: str) -> bool:
    try:
        _converted(cell)
    except ValueError:
        return not cell.strip()
    return True


def _converted(cell: str) -> float:
    if '_' in cell:
        raise ValueError('an underscore is no part of a number')
    return float(cell)
