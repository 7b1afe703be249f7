# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Tables in HDF5 files: data sets of one or two dimensions, or of records with fields."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.table import (
    ChannelTable,
    Column,
    single_digits,
    time_digits,
    told_rate,
    understood,
)
from identnl_ros.storage.optional_library import library
import numpy as np
from numpy.typing import NDArray

CACHE = 2**20  # [bytes] of every data set
_NUMBERS = 'fiu'
_UNIT_NAMES = ('unit', 'units')


class Hdf5Table(ChannelTable):
    """
    An HDF5 file; MATLAB 7.3 files are such.

    Every data set of one dimension is a column, called by its path and, where that is unique,
    by its last name. Of a data set of two dimensions the longer one is time, and its columns are
    ``name/1``, ``name/2`` ... Fields of records are columns ``name/field``.
    Attributes ``unit`` or ``units`` of a data set tell units; the sample rate stands in an
    attribute of the data set, of a group it is in, or of the file, or in a data set of one
    number. Times may stand in texts.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If the file cannot be read or has no columns.

    """

    format_name = 'HDF5'

    def __init__(self, path: Path) -> None:
        """List the columns."""
        super().__init__(path)
        h5py = library('h5py', 'h5py', 'HDF5 and MATLAB 7.3 files')
        self._slab: tuple[object, NDArray[Any]] = (None, np.empty(0))
        # Data set, and which of its columns or fields; None: it has one only.
        self._places: list[tuple[Any, int | str | None]] = []
        with self.told_errors():
            self._file = h5py.File(path, 'r', rdcc_nbytes=CACHE)
        try:
            with self.told_errors():
                found: list[Any] = []
                self._file.visititems(
                    lambda _, item: found.append(item) if isinstance(item, h5py.Dataset) else None
                )
                sets = [one for one in found if _is_table(one)]
                self._rate = told_rate(
                    (one.name.rpartition('/')[2], one[()])
                    for one in found
                    if one.size == 1 and one.dtype.kind in _NUMBERS
                )
                last_names = [one.name.rpartition('/')[2] for one in sets]
                columns: list[Column] = []
                for one in sets:
                    last = one.name.rpartition('/')[2]
                    self._add(one, last if last_names.count(last) == 1 else '', columns)
                self.columns = tuple(
                    understood(column, self.read(i, 0, 1)) for i, column in enumerate(columns)
                )
            if not columns:
                raise DataError(
                    f'{path} has no columns: expected data sets of numbers in one or two '
                    'dimensions'
                )
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._slab = (None, np.empty(0))
        self._file.close()

    def length(self, column: int) -> int:
        """Count the values of a column."""
        return int(max(self._places[column][0].shape))

    def read(self, column: int, begin: int, end: int) -> NDArray[Any]:
        """Read a part of a column."""
        dataset, part = self._places[column]
        if part is None and dataset.ndim == 1:
            values: NDArray[Any] = dataset[begin:end]
            return values
        # All columns of a data set lie side by side: read them once.
        key = (dataset.name, begin, end)
        if self._slab[0] != key:
            if dataset.ndim == 1:
                slab = dataset[begin:end]
            elif _is_wide(dataset):
                slab = dataset[:, begin:end].T
            else:
                slab = dataset[begin:end]
            self._slab = (key, slab)
        slab = self._slab[1]
        return slab[part] if isinstance(part, str) else slab[:, part or 0]

    def digits(self, column: int, count: int) -> tuple[int, int] | None:
        """Tell how exact a column is; see `Table.digits`."""
        dataset, part = self._places[column]
        if self.columns[column].origin_ns is not None:
            return time_digits(self.read(column, 0, count))
        return single_digits(dataset.dtype[part] if isinstance(part, str) else dataset.dtype)

    def _add(self, dataset: Any, last: str, columns: list[Column]) -> None:
        path = dataset.name.strip('/')
        unit = _text(dataset.attrs)
        rate = _rate(dataset) or self._rate
        parts: list[int | str | None]
        if dataset.dtype.names:
            parts = [
                one for one in dataset.dtype.names if dataset.dtype[one].kind in _NUMBERS + 'S'
            ]
        else:
            parts = [None] if min(dataset.shape) == 1 or dataset.ndim == 1 else []
            parts = parts or list(range(min(dataset.shape)))
        for part in parts:
            names = [
                name if part is None else f'{name}/{part + 1 if isinstance(part, int) else part}'
                for name in (path, last)
                if name
            ]
            if isinstance(part, str):
                names.append(part)
            self._places.append((dataset, part))
            columns.append(Column(names[0], unit, rate, aliases=tuple(dict.fromkeys(names[1:]))))


def _is_table(dataset: Any) -> bool:
    if dataset.attrs.get('MATLAB_class') in (b'char', b'cell', b'function_handle', b'struct'):
        return False
    if dataset.shape is None or dataset.ndim not in (1, 2) or dataset.size < 2:
        return False
    if dataset.name.startswith('/#'):
        return False
    return bool(
        dataset.dtype.kind in _NUMBERS
        or (dataset.ndim == 1 and (_is_text(dataset) or dataset.dtype.names is not None))
    )


def _is_text(dataset: Any) -> bool:
    h5py = library('h5py', 'h5py', 'HDF5 and MATLAB 7.3 files')
    return h5py.check_string_dtype(dataset.dtype) is not None


def _is_wide(dataset: Any) -> bool:
    return bool(dataset.shape[1] > dataset.shape[0])


def _text(attributes: Mapping[str, Any]) -> str:
    for name, value in attributes.items():
        if name.lower() in _UNIT_NAMES and isinstance(value, str | bytes):
            return value.decode('utf-8', 'replace') if isinstance(value, bytes) else value
    return ''


def _rate(dataset: Any) -> float | None:
    """Look for the sample rate at a data set and at all groups that it is in."""
    place = dataset
    while True:
        rate = told_rate(place.attrs.items())
        if rate is not None or place.name == '/':
            return rate
        place = place.parent
