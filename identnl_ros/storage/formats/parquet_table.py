# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Columns of Parquet files."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.table import (
    as_numbers,
    Column,
    foreign_errors,
    Progress,
    single_digits,
    Table,
    time_digits,
    told_rate,
    understood,
    VALUES_AT_ONCE,
)
from identnl_ros.storage.optional_library import library
import numpy as np
from numpy.typing import NDArray

BUFFER = 2**20  # [bytes] of every column


class ParquetTable(Table):
    """
    A Parquet file.

    The metadata of a column may tell its ``unit``, that of the file the ``sample_rate``. Times
    stand in columns of numbers, timestamps or texts.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If the file cannot be read or has no columns of numbers.

    """

    def __init__(self, path: Path) -> None:
        """List the columns."""
        super().__init__(path)
        parquet = library('pyarrow.parquet', 'pyarrow', 'Parquet files')
        with foreign_errors(path, 'Parquet'):
            self._file = parquet.ParquetFile(path, pre_buffer=False, buffer_size=BUFFER)
            types = library('pyarrow.types', 'pyarrow', 'Parquet files')
            schema = self._file.schema_arrow
            self._fields = [field for field in schema if not types.is_nested(field.type)]
            self._numeric = [
                types.is_floating(field.type) or types.is_integer(field.type)
                for field in self._fields
            ]
            rate = told_rate(_numbers(schema.metadata))
            self.columns = tuple(
                Column(field.name, _text((field.metadata or {}).get(b'unit', b'')), rate)
                for field in self._fields
            )
        if not any(self._numeric) or not self._file.metadata.num_rows:
            self.close()
            raise DataError(f'{path} has no rows of numbers; expected columns of numbers')
        with foreign_errors(path, 'Parquet'):
            self.columns = tuple(
                column if is_number else understood(column, self._first(column.name))
                for column, is_number in zip(self.columns, self._numeric, strict=True)
            )

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def rows(
        self, columns: Sequence[int], count: int, progress: Progress | None = None
    ) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Read the numbers of some columns; see `Table.rows`."""
        names = [self.columns[column].name for column in columns]
        at_once = max(1, VALUES_AT_ONCE // (len(names) * count)) * count
        size = self._file.metadata.num_rows
        begin = 0
        # A group of rows after the other: over several, pages read ahead pile up.
        batches = (
            batch
            for group in range(self._file.metadata.num_row_groups)
            for batch in self._file.iter_batches(
                at_once, row_groups=[group], columns=names, use_threads=False
            )
        )
        while True:
            with foreign_errors(self.path, 'Parquet'):
                batch = next(batches, None)
                if batch is None:
                    return
                # Columns come in the order of the file.
                values = np.column_stack(
                    [
                        as_numbers(self.columns[column], _array(batch.column(name)))
                        for column, name in zip(columns, names, strict=True)
                    ]
                )
            for first in range(0, len(values), count):
                yield begin + first + 1, values[first : first + count]
            begin += len(values)
            if progress:
                progress(begin, size)

    def digits(self, column: int, count: int) -> tuple[int, int] | None:
        """Tell how exact a column is; see `Table.digits`."""
        if not self._numeric[column]:
            with foreign_errors(self.path, 'Parquet'):
                return time_digits(self._first(self.columns[column].name, count))
        return single_digits(np.dtype(self._fields[column].type.to_pandas_dtype()))

    def _first(self, name: str, count: int = 1) -> NDArray[Any]:
        """Read the first values of a column of any type."""
        batch = next(self._file.iter_batches(count, columns=[name], use_threads=False), None)
        return np.empty(0) if batch is None else _array(batch.column(name))


def _array(values: Any) -> NDArray[Any]:
    array: NDArray[Any] = values.to_numpy(zero_copy_only=False)
    return array


def _text(value: bytes) -> str:
    return value.decode('utf-8', 'replace')


def _numbers(metadata: dict[bytes, bytes] | None) -> Iterator[tuple[str, Any]]:
    for name, value in (metadata or {}).items():
        try:
            yield _text(name), float(value)
        except ValueError:
            continue
