# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Cells of text files as numbers: decimal point or comma, dates, empty ones."""

from collections.abc import Callable, Sequence
from operator import itemgetter
from pathlib import Path
import re

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.date_times import NANOSECONDS, nanoseconds

POINT, COMMA, UNDECIDED = '.', ',', ''

_WITH_COMMA = re.compile(r'[+-]?(\d+,\d*|,\d+)(e[+-]?\d+)?', re.ASCII | re.IGNORECASE)
_NAMES = {POINT: 'a decimal point', COMMA: 'a decimal comma'}


def decimal_mark(cell: str, separator: str | None) -> str:
    """
    Tell which decimal mark a cell has.

    Parameters
    ----------
    cell : str
    separator : str or None
        Of the cells; only with semicolons and tabs a comma can be a decimal one.

    Returns
    -------
    str
        `POINT`, `COMMA`, or `UNDECIDED` if it has none or is no number.

    """
    text = cell.strip()
    if separator in (';', '\t') and _WITH_COMMA.fullmatch(text):
        return COMMA
    return POINT if '.' in text and is_number(text) else UNDECIDED


def is_number(cell: str) -> bool:
    """
    Tell whether a cell is a number with a decimal point, or empty.

    Parameters
    ----------
    cell : str

    Returns
    -------
    bool

    """
    try:
        _value(cell)
    except ValueError:
        return not cell.strip()
    return True


def _value(cell: str) -> float:
    # Python takes 1_0 for ten, which no program writes.
    if '_' in cell:
        raise ValueError('an underscore is no part of a number')
    return float(cell)


class RowReader:
    """
    The chosen cells of row after row as numbers.

    Parameters
    ----------
    path : Path
        For errors.
    columns : sequence of int
        Indices from 0.
    separator : str or None
        Of the cells.
    mark : str
        Decimal mark; `UNDECIDED`: the first one that comes.
    origins : sequence of int or None
        For each column the instant from which its dates are counted [ns]; None: numbers.

    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[int],
        separator: str | None,
        mark: str,
        origins: Sequence[int | None],
    ) -> None:
        """Sort the columns."""
        self._path, self._separator, self._mark = path, separator, mark
        self._dated = [
            (place, column, origin)
            for place, (column, origin) in enumerate(zip(columns, origins, strict=True))
            if origin is not None
        ]
        self._plain = [
            column for column, origin in zip(columns, origins, strict=True) if origin is None
        ]
        self._pick: Callable[[list[str]], tuple[str, ...]] = (
            itemgetter(*self._plain)
            if len(self._plain) > 1
            else lambda cells: tuple(cells[column] for column in self._plain)
        )
        self._is_simple = not self._dated and mark == POINT

    def __call__(self, cells: list[str], line: int) -> list[float]:
        """
        Convert the cells of a row.

        Parameters
        ----------
        cells : list of str
            All of the row.
        line : int

        Returns
        -------
        list of float
            In the order of the columns; NaN for empty cells.

        Raises
        ------
        DataError
            If a cell holds something else.

        """
        picked = self._pick(cells)
        try:
            if self._is_simple:
                return list(map(_value, picked))
            row = list(map(_value, self._pointed(picked)))
        except ValueError:
            row = [self._number(cell, line) for cell in picked]
        for place, column, origin in self._dated:
            row.insert(place, self._seconds(cells[column], origin, line))
        return row

    def _pointed(self, picked: Sequence[str]) -> Sequence[str]:
        """Put points for commas where nothing speaks against it."""
        if self._mark == POINT or not picked:
            return picked
        text = ';'.join(picked)  # the last cell ends with the line
        if self._mark == UNDECIDED and '.' not in text and ',' not in text:
            return picked
        if self._mark == COMMA and '.' not in text:
            return text.replace(',', '.').split(';')
        raise ValueError('one by one')

    def _number(self, cell: str, line: int) -> float:
        """Convert a cell that may be empty or wrong, and let it decide the mark."""
        text = cell.strip()
        if not text:
            return float('nan')
        mark = decimal_mark(text, self._separator)
        if mark:
            self._mark = self._mark or mark
            if mark != self._mark:
                raise DataError(
                    f'{self._path}:{line}: {text[:40]!r} has {_NAMES[mark]}, but numbers before '
                    f'it have {_NAMES[self._mark]}; write all numbers of the file alike'
                )
        try:
            return _value(text.replace(',', '.') if mark == COMMA else text)
        except ValueError:
            hint = ''
            if ',' in text:
                hint = ', with a decimal point'
                if self._separator in (';', '\t'):
                    hint = ', with one decimal point or comma and no mark of thousands'
            raise DataError(
                f'{self._path}:{line}: {text[:40]!r} is not a number{hint}; '
                'correct it, or start the line with # to skip it'
            ) from None

    def _seconds(self, cell: str, origin: int, line: int) -> float:
        """Convert a date."""
        if not cell.strip():
            return float('nan')
        instant = nanoseconds(cell)
        if instant is None:
            raise DataError(
                f'{self._path}:{line}: {cell.strip()[:40]!r} is no time, like those before it '
                '(2026-11-22T18:40:00.000); correct it, or start the line with # to skip it'
            )
        return (instant - origin) / NANOSECONDS
