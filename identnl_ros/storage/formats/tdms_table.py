# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Channels of TDMS files, as LabVIEW writes them."""

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

_UNIT_NAMES = ('unit_string', 'NI_UnitDescription', 'unit', 'units')


class TdmsTable(ChannelTable):
    """
    A TDMS file.

    Channels are columns ``group/channel`` and, where that is unique, ``channel``. Units come
    from the property ``unit_string``, the sample rate from ``wf_increment``; times may also stand
    in channels of timestamps or texts.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If the file cannot be read or has no channels of numbers.

    """

    format_name = 'TDMS'

    def __init__(self, path: Path) -> None:
        """List the channels."""
        super().__init__(path)
        nptdms = library('nptdms', 'npTDMS', 'TDMS files')
        with self.told_errors():
            self._stream = path.open('rb')
        try:
            with self.told_errors():
                self._file = nptdms.TdmsFile.open(self._stream)
                self._channels = [
                    channel
                    for group in self._file.groups()
                    for channel in group.channels()
                    if channel.dtype.kind in 'fiuMO' and len(channel)
                ]
                rate = told_rate(self._file.properties.items())
                self.columns = tuple(
                    understood(_column(channel, rate), channel.read_data(0, 1))
                    for channel in self._channels
                )
                self.start_ns = _start(self._channels)
            if not self.columns:
                raise DataError(f'{path} has no columns: expected channels of numbers')
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def length(self, column: int) -> int:
        """Count the values of a channel."""
        return len(self._channels[column])

    def read(self, column: int, begin: int, end: int) -> NDArray[Any]:
        """Read a part of a channel."""
        values: NDArray[Any] = self._channels[column].read_data(begin, end - begin)
        return values

    def digits(self, column: int, count: int) -> tuple[int, int] | None:
        """Tell how exact a channel is; see `Table.digits`."""
        if self.columns[column].origin_ns is not None:
            return time_digits(self.read(column, 0, count))
        return single_digits(self._channels[column].dtype)


def _start(channels: list[Any]) -> int | None:
    """Find when all waveforms began; None: at different times, or not told."""
    told = {
        (str(one.properties.get('wf_start_time')), float(one.properties.get('wf_start_offset', 0)))
        for one in channels
        if one.properties.get('wf_start_time') is not None
    }
    if len(told) != 1:
        return None
    text, offset = next(iter(told))
    start = int(np.datetime64(text.removesuffix('Z'), 'ns').astype(np.int64))
    # Waveforms without a time have that of the year 1904.
    return start + round(offset * 1e9) if start > 0 else None


def _column(channel: Any, file_rate: float | None) -> Column:
    properties = channel.properties
    unit = next((properties[name] for name in _UNIT_NAMES if name in properties), '')
    increment = properties.get('wf_increment', 0)
    rate = _from_increment(float(increment)) if increment else None
    return Column(
        f'{channel.group_name}/{channel.name}',
        unit if isinstance(unit, str) else '',
        rate or told_rate(properties.items()) or file_rate,
        aliases=(channel.name,),
    )


def _from_increment(increment: float) -> float | None:
    if not (np.isfinite(increment) and increment > 0):
        return None
    rate = 1 / increment
    return float(round(rate)) if abs(round(rate) / rate - 1) < 1e-12 else rate
