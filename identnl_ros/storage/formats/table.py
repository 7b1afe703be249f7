# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What all formats have in common: columns by name, rows a piece at a time."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
import stat
import tempfile
from types import TracebackType
from typing import Any

from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.storage.formats.date_times import (
    first_instant,
    first_text,
    FRACTION_DIGITS,
    instants,
    NOT_A_TIME,
    seconds_since,
)
import numpy as np
from numpy.typing import NDArray

MOST_NAMES_SHOWN = 40
VALUES_AT_ONCE = 2**19  # that are in memory
MOST_DIGITS = 17
SINGLE_DIGITS = 7  # of a number in single precision
TIME_DIGITS = 19  # of nanoseconds since 1970
NO_UNITS = {'EU', '-'}  # engineering unit; else an exa-u, a mass

# As files of other programs call them, without blanks, underscores and capitals.
_RATE_NAMES = {'fs', 'samplerate', 'samplingrate', 'samplefrequency', 'samplingfrequency'}
_INTERVAL_NAMES = {
    'dt', 'sampleinterval', 'samplinginterval', 'sampleperiod', 'samplingperiod',
}  # fmt: skip

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Column:
    """
    A column of a table.

    Parameters
    ----------
    name : str
    unit : str
        As the file tells it; empty: it does not.
    sample_rate : float or None
        As the file tells it [Hz]; None: it does not.
    rate_tolerance : float
        To which the file tells the rate [-].
    aliases : tuple of str
        Other names, which count where no column has them for its name.
    origin_ns : int or None
        The column holds dates or times of day; its numbers are seconds since this instant
        [ns since 1970, or midnight where there is no date]. None: it holds numbers.
    text : str
        Its first value where it holds texts that are no times; empty: it does not.

    """

    name: str
    unit: str = ''
    sample_rate: float | None = None
    rate_tolerance: float = 1e-9
    aliases: tuple[str, ...] = ()
    origin_ns: int | None = None
    text: str = ''


class Spool:
    """
    Numbers in a temporary file, where they cost no memory.

    Parameters
    ----------
    parts : iterable of ndarray, shape (n,)
    dtype : dtype

    """

    def __init__(self, parts: Iterable[NDArray[Any]], dtype: np.dtype[Any]) -> None:
        """Write the file."""
        self.dtype = dtype.newbyteorder('=')
        self._stream = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `close`
        try:
            for part in parts:
                self._stream.write(np.ascontiguousarray(part, self.dtype).data)
            self._stream.flush()
            self.length = self._stream.tell() // self.dtype.itemsize
        except BaseException:
            self._stream.close()
            raise

    def read(self, begin: int, end: int) -> NDArray[Any]:
        """
        Read some of the numbers.

        Parameters
        ----------
        begin, end : int
            From 0; without `end`.

        Returns
        -------
        ndarray, shape (end - begin,)

        """
        self._stream.seek(begin * self.dtype.itemsize)
        return np.fromfile(self._stream, self.dtype, end - begin)

    def close(self) -> None:
        """Remove the file."""
        self._stream.close()


class Table(ABC):
    """
    A file with a column for each channel and a row for each sample; a context manager.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If the path is not a file.

    """

    row_name = 'row'
    tells_instants = False
    """The format itself says at which instants all columns were recorded."""
    aliases_are_names = False
    """An alias is as good as a name, and not to be found beside one."""

    def __init__(self, path: Path) -> None:
        """Check that there is a file."""
        self.path = path
        self.columns: tuple[Column, ...] = ()
        self.start_ns: int | None = None
        """When the recording began, as the file tells it; None: it does not [ns since 1970]."""
        self.notes: list[str] = []
        """Sentences about what was guessed."""
        try:
            if not stat.S_ISREG(path.stat().st_mode):
                raise DataError(f'{path} is not a file; give the path of a recorded file')
        except FileNotFoundError:
            raise DataError(f'{path} does not exist; give the path of a recorded file') from None
        except OSError as error:
            raise DataError(f'{path} cannot be read: {error.strerror or error}') from None

    def __enter__(self) -> 'Table':
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:  # noqa: B027 - most have nothing to close
        """Close the file."""

    def place(self, row: int) -> str:
        """
        Name a row for an error.

        Parameters
        ----------
        row : int
            As `rows` counts.

        Returns
        -------
        str

        """
        return f'{self.path}, {self.row_name} {row}'

    def column(self, name: str, wanted_by: str) -> int:
        """
        Find a column.

        Parameters
        ----------
        name : str
            Its name, or its number from 1.
        wanted_by : str
            For the error.

        Returns
        -------
        int
            Index from 0.

        Raises
        ------
        DataError
            If there is none or there are several of the name.

        """
        names = [column.name for column in self.columns]
        exact = [i for i, one in enumerate(names) if one == name and name]
        aliased = [i for i, column in enumerate(self.columns) if name in column.aliases]
        found = exact + aliased if self.aliases_are_names else exact or aliased
        if len(found) == 1:
            return found[0]
        if found:
            raise DataError(
                f'{self.path}: {len(found)} columns are called {name!r} ({wanted_by}); '
                'give the number of the column in the layout'
            )
        if name.isdecimal() and 1 <= int(name) <= len(self.columns):
            return int(name) - 1
        close = get_close_matches(name, names, 1)
        suggestion = f', did you mean {close[0]!r}?' if close else ''
        raise DataError(
            f'{self.path}: no column {name!r} ({wanted_by}){suggestion}; '
            f'the file has {self._shown_names(names)}; correct the key column in the layout'
        )

    @abstractmethod
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
            Called with what is done and what there is to do.

        Yields
        ------
        tuple of int and ndarray, shape (n_rows, n_columns)
            Number of the piece's first row (from 1) or line, and its rows, NaN where there is
            no number.

        Raises
        ------
        DataError
            If the file is damaged or its columns do not fit together.

        """

    def digits(self, column: int, count: int) -> tuple[int, int] | None:
        """
        Tell how exactly the numbers of a column are printed.

        Parameters
        ----------
        column : int
            Index from 0.
        count : int
            Rows to look at.

        Returns
        -------
        tuple of int or None
            Most decimals, negative: so many zeros before the point; most significant digits.
            None: they are exact.

        """
        return None

    def is_beside(self, column: int, other: int) -> bool:
        """
        Tell whether two columns have values in the same rows.

        Parameters
        ----------
        column, other : int

        Returns
        -------
        bool

        """
        return True

    def _shown_names(self, names: list[str]) -> str:
        if not any(names):
            return f'no names but the columns 1 to {len(names)}'
        shown = ', '.join(names[:MOST_NAMES_SHOWN])
        return f'{shown}{" and more" if len(names) > MOST_NAMES_SHOWN else ""}'


class ChannelTable(Table):
    """A table that reads any part of any column."""

    format_name = ''

    @abstractmethod
    def length(self, column: int) -> int:
        """
        Count the values of a column.

        Parameters
        ----------
        column : int

        Returns
        -------
        int

        """

    @abstractmethod
    def read(self, column: int, begin: int, end: int) -> NDArray[Any]:
        """
        Read a part of a column.

        Parameters
        ----------
        column, begin, end : int
            From 0; without `end`.

        Returns
        -------
        ndarray, shape (end - begin,)

        """

    def rows(
        self, columns: Sequence[int], count: int, progress: Progress | None = None
    ) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Read the numbers of some columns; see `Table.rows`."""
        with self.told_errors():
            lengths = [self.length(column) for column in columns]
        longest = lengths[0]
        for column, length in zip(columns, lengths, strict=True):
            if length != longest:
                raise DataError(
                    f'{self.path}: column {self.columns[column].name!r} has {length} values, '
                    f'but {self.columns[columns[0]].name!r} has {longest}; expected as many, '
                    'recorded at the same instants'
                )
        if not longest:
            raise DataError(f'{self.path}: the columns that the layout names have no values')
        at_once = max(1, VALUES_AT_ONCE // (len(self.columns) * count)) * count
        for begin in range(0, longest, at_once):
            end = min(begin + at_once, longest)
            with self.told_errors():
                values = np.column_stack([self._numbers(column, begin, end) for column in columns])
            if len(values) != end - begin:
                raise DataError(f'{self.path} ends before row {end}; it is damaged or cut off')
            for first in range(0, len(values), count):
                yield begin + first + 1, values[first : first + count]
            if progress:
                progress(end, longest)

    def is_beside(self, column: int, other: int) -> bool:
        """Tell whether two columns are of the same length; see `Table.is_beside`."""
        with self.told_errors():
            return self.length(column) == self.length(other)

    def _numbers(self, column: int, begin: int, end: int) -> NDArray[np.float64]:
        """Read a part of a column as numbers; times as seconds since their origin."""
        return as_numbers(self.columns[column], self.read(column, begin, end))

    @contextmanager
    def told_errors(self) -> Iterator[None]:
        """Turn whatever a foreign library raises into an error for the user."""
        with foreign_errors(self.path, self.format_name):
            yield


@contextmanager
def foreign_errors(path: Path, format_name: str) -> Iterator[None]:
    """
    Turn whatever a foreign library raises into an error for the user.

    Parameters
    ----------
    path : Path
    format_name : str

    Yields
    ------
    None

    Raises
    ------
    DataError

    """
    try:
        yield
    except (IdentnlError, MemoryError):
        raise
    except Exception as error:
        said = ' '.join(str(error).split()) or type(error).__name__
        raise DataError(
            f'{path} cannot be read as {format_name}: {said[:200]}; check the file, or name its '
            'format with --format'
        ) from None


def told_rate(named: Iterable[tuple[str, object]]) -> float | None:
    """
    Find the sample rate among numbers with names.

    Parameters
    ----------
    named : iterable of tuple
        E.g. attributes of a file; values of any kind.

    Returns
    -------
    float or None
        [Hz].

    """
    for name, value in named:
        plain = ''.join(one for one in name.lower() if one.isalnum())
        if plain not in _RATE_NAMES | _INTERVAL_NAMES:
            continue
        number = np.asarray(value)
        if number.size != 1 or number.dtype.kind not in 'fiu':
            continue
        rate = float(number.reshape(()))
        if np.isfinite(rate) and rate > 0:
            return rate if plain in _RATE_NAMES else 1 / rate
    return None


def understood(column: Column, values: NDArray[Any]) -> Column:
    """
    Say of a column whether it holds times or other texts.

    Parameters
    ----------
    column : Column
    values : ndarray, shape (n,)
        Its first ones, of any type.

    Returns
    -------
    Column

    """
    if values.dtype.kind in 'fiu':
        return column
    origin = first_instant(values)
    if origin is None:
        return replace(column, text=first_text(values) or 'no numbers')
    return replace(column, unit='', origin_ns=origin)


def as_numbers(column: Column, values: NDArray[Any]) -> NDArray[np.float64]:
    """
    Turn values of a column into numbers.

    Parameters
    ----------
    column : Column
    values : ndarray, shape (n,)
        Numbers, or the times that the column holds.

    Returns
    -------
    ndarray, shape (n,)
        Times in seconds since the origin of the column.

    Raises
    ------
    ValueError
        If they are neither.

    """
    if column.origin_ns is None or values.dtype.kind in 'fiu':
        return np.asarray(values, np.float64)
    return seconds_since(values, column.origin_ns)


def time_digits(values: NDArray[Any]) -> tuple[int, int] | None:
    """
    Tell how exact times are that are no numbers; see `Table.digits`.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Texts or numpy's own times.

    Returns
    -------
    tuple of int or None
        By the zeros at the end of all of them.

    """
    found = instants(values)
    if found is None:
        return None
    step, zeros = int(np.gcd.reduce(found[found != NOT_A_TIME], initial=0)), 0
    while step and step % 10 == 0:
        step, zeros = step // 10, zeros + 1
    return FRACTION_DIGITS - zeros, TIME_DIGITS


def single_digits(dtype: np.dtype[Any]) -> tuple[int, int] | None:
    """
    Tell how exact numbers of a type are; see `Table.digits`.

    Parameters
    ----------
    dtype : dtype

    Returns
    -------
    tuple of int or None

    """
    return (MOST_DIGITS, SINGLE_DIGITS) if dtype.kind == 'f' and dtype.itemsize <= 4 else None
