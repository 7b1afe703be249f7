# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Variables of MATLAB files."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
import subprocess
import sys
from typing import Any
import warnings

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.hdf5_table import Hdf5Table
from identnl_ros.storage.formats.table import (
    as_numbers,
    ChannelTable,
    Column,
    single_digits,
    Spool,
    Table,
    time_digits,
    told_rate,
    understood,
)
import numpy as np
from numpy.typing import NDArray

READ = 'import sys; from scipy.io import loadmat; loadmat(sys.argv[1])'
HDF5_MARK = b'\x89HDF\r\n\x1a\n'
HDF5_OFFSET = 512  # [bytes] of MATLAB's own head in a file of version 7.3


def matlab_table(path: Path) -> Table:
    """
    Open a MATLAB file of any version.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Table

    Raises
    ------
    DataError
        If it cannot be read.

    """
    try:
        with path.open('rb') as stream:
            head = stream.read(HDF5_OFFSET + len(HDF5_MARK))
    except OSError:
        head = b''  # the table says what is wrong
    if head.startswith(HDF5_MARK) or head[HDF5_OFFSET:] == HDF5_MARK:
        return Hdf5Table(path)
    return MatlabTable(path)


class MatlabTable(ChannelTable):
    """
    A MATLAB file up to version 7.

    Vectors are columns by their names. Of a matrix the longer side is time, and its columns are
    ``name.1``, ``name.2`` ...; fields of structures are ``structure.field``. A scalar ``fs`` or
    ``dt`` and the like tells the sample rate. Times may stand in texts, but not in objects of
    MATLAB's own (``datetime``), which nobody else reads. One variable at a time is in memory, for
    MATLAB compresses variables as a whole.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If the file cannot be read or has no columns.

    """

    format_name = 'MATLAB file'

    def __init__(self, path: Path) -> None:
        """Read all variables into temporary files."""
        super().__init__(path)
        from scipy.io import loadmat, whosmat

        _require_sound(path)
        self._values: list[Spool | None] = []
        self._digits: list[tuple[int, int] | None] = []
        scalars: list[tuple[str, object]] = []
        columns: list[Column] = []
        try:
            with self.told_errors(), warnings.catch_warnings():
                warnings.simplefilter('ignore')  # about objects that nobody but MATLAB reads
                for variable, _, _ in whosmat(path):
                    content = loadmat(path, variable_names=[variable], simplify_cells=True)
                    for name, values in _numbers(variable, content.get(variable)):
                        if values.size == 1:
                            scalars.append((name.rpartition('.')[2], values))
                        else:
                            columns += self._add(name, values)
            if not any(column.text == '' for column in columns):
                raise DataError(f'{path} has no columns: expected vectors or matrices of numbers')
        except BaseException:
            self.close()
            raise
        rate = told_rate(scalars)
        lasts = [column.name.partition('.')[2] for column in columns]
        self.columns = tuple(
            replace(column, sample_rate=rate, aliases=(last,) if last else ())
            for column, last in zip(columns, lasts, strict=True)
        )

    def length(self, column: int) -> int:
        """Count the values of a column."""
        return self._spool(column).length

    def read(self, column: int, begin: int, end: int) -> NDArray[Any]:
        """Read a part of a column."""
        return self._spool(column).read(begin, end)

    def digits(self, column: int, count: int) -> tuple[int, int] | None:
        """Tell how exact a column is; see `Table.digits`."""
        return self._digits[column]

    def close(self) -> None:
        """Remove the temporary files."""
        for one in self._values:
            if one is not None:
                one.close()
        self._values = []

    def _spool(self, column: int) -> Spool:
        found = self._values[column]
        if found is None:
            raise DataError(
                f'{self.path}: column {self.columns[column].name!r} holds texts '
                f'({self.columns[column].text[:40]!r}), expected numbers'
            )
        return found

    def _add(self, name: str, values: NDArray[Any]) -> list[Column]:
        """Lay the columns of a variable down and return them."""
        if values.dtype.kind in 'UO':
            column = understood(Column(name), values[:1])
            is_time = column.origin_ns is not None
            seconds = as_numbers(column, values) if is_time else np.empty(0)
            self._values.append(Spool([seconds], seconds.dtype) if is_time else None)
            self._digits.append(time_digits(values))
            return [column]
        parts = values if values.ndim == 2 else values[None]
        parts = parts.T if parts.shape[0] > parts.shape[1] else parts
        self._values += [Spool([part], part.dtype) for part in parts]
        self._digits += [single_digits(part.dtype) for part in parts]
        if len(parts) == 1:
            return [Column(name)]
        return [Column(f'{name}.{i + 1}') for i in range(len(parts))]


def _require_sound(path: Path) -> None:
    """Let another process read the file first: a damaged one can end the process that reads it."""
    done = subprocess.run([sys.executable, '-c', READ, str(path)], capture_output=True)
    if done.returncode < 0:
        raise DataError(
            f'{path} is damaged: reading it ends with signal {-done.returncode}; expected a '
            'MATLAB file, save it again, with -v7.3 if it is large'
        )


def _numbers(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Find the arrays of numbers in a variable, down into structures."""
    if isinstance(value, dict):
        for field, inner in value.items():
            yield from _numbers(f'{name}.{field}', inner)
        return
    values = np.asarray(value)
    is_text = values.ndim == 1 and values.size > 1 and isinstance(values[0], str)
    if is_text or (values.dtype.kind in 'fiu' and values.size and values.ndim <= 2):
        yield name, values
