# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Which format a file has, and who reads it."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TypeVar

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.csv_table import CsvTable
from identnl_ros.storage.formats.hdf5_table import Hdf5Table
from identnl_ros.storage.formats.matlab_table import matlab_table
from identnl_ros.storage.formats.parquet_table import ParquetTable
from identnl_ros.storage.formats.table import Table
from identnl_ros.storage.formats.tdms_table import TdmsTable
from identnl_ros.storage.formats.uff58_table import Uff58Table

Entry = TypeVar('Entry')

READERS: dict[str, Callable[[Path], Table]] = {
    'csv': CsvTable,
    'uff58': Uff58Table,
    'mat': matlab_table,
    'tdms': TdmsTable,
    'hdf5': Hdf5Table,
    'parquet': ParquetTable,
}
ENDINGS = {
    '.csv': 'csv',
    '.txt': 'csv',
    '.tsv': 'csv',
    '.dat': 'csv',
    '.asc': 'csv',
    '.uff': 'uff58',
    '.unv': 'uff58',
    '.uf': 'uff58',
    '.mat': 'mat',
    '.tdms': 'tdms',
    '.h5': 'hdf5',
    '.hdf5': 'hdf5',
    '.hdf': 'hdf5',
    '.parquet': 'parquet',
    '.pq': 'parquet',
}


def open_table(path: Path, format_name: str | None = None, wanted: Collection[str] = ()) -> Table:
    """
    Open a recorded file.

    Parameters
    ----------
    path : Path
    format_name : str or None
        One of `READERS`; None: by the end of the file's name, CSV where that tells nothing.
    wanted : collection of str
        Names of columns, by which a format without a fixed head finds it.

    Returns
    -------
    Table
        A context manager.

    Raises
    ------
    DataError
        If it cannot be read.

    """
    read = chosen(READERS, path, format_name or ENDINGS.get(path.suffix.lower(), 'csv'))
    return CsvTable(path, wanted) if read is CsvTable else read(path)


def chosen(entries: Mapping[str, Entry], path: Path, format_name: str | None) -> Entry:
    """
    Find what belongs to a format.

    Parameters
    ----------
    entries : mapping
        By the name of the format.
    path : Path
    format_name : str or None
        None: by the end of the file's name.

    Returns
    -------
    object
        The entry.

    Raises
    ------
    DataError
        If there is none.

    """
    name = format_name or ENDINGS.get(path.suffix.lower(), '')
    if name not in entries:
        raise DataError(
            f'{path}: the format {name or path.suffix!r} is none of {", ".join(entries)}; '
            'name one with --format'
        )
    return entries[name]
