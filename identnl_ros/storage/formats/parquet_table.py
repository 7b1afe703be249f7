# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Columns of Parquet files."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.table import (
    Column,
    foreign_errors,
    Progress,
    single_digits,
    Table,
    told_rate,
    VALUES_AT_ONCE,
)
from identnl_ros.storage.optional_library import library
import numpy as np
from numpy.typing import NDArray

BUFFER = 2**20  # [bytes] of every column


class ParquetTable(Table):
    """
    A Parquet file.

    The metadata of a column may tell its ``unit``, that of the file the ``sample_rate``.

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
            self._fields = [
                field
                for field in schema
                if types.is_floating(field.type) or types.is_integer(field.type)
            ]
            rate = told_rate(_numbers(schema.metadata))
            self.columns = tuple(
                Column(field.name, _text((field.metadata or {}).get(b'unit', b'')), rate)
                for field in self._fields
            )
        if not self.columns or not self._file.metadata.num_rows:
            self.close()
            raise DataError(f'{path} has no rows of numbers; expected columns of numbers')

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
                        batch.column(name).to_numpy(zero_copy_only=False).astype(np.float64)
                        for name in names
                    ]
                )
            for first in range(0, len(values), count):
                yield begin + first + 1, values[first : first + count]
            begin += len(values)
            if progress:
                progress(begin, size)

    def digits(self, column: int, count: int) -> tuple[int, int] | None:
        """Tell how exact a column is; see `Table.digits`."""
        return single_digits(np.dtype(self._fields[column].type.to_pandas_dtype()))


def _text(value: bytes) -> str:
    return value.decode('utf-8', 'replace')


def _numbers(metadata: dict[bytes, bytes] | None) -> Iterator[tuple[str, Any]]:
    for name, value in (metadata or {}).items():
        try:
            yield _text(name), float(value)
        except ValueError:
            continue
