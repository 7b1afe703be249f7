# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Tables as Parquet files."""

from typing import BinaryIO

from identnl_ros.storage.formats.writers import Recording
from identnl_ros.storage.optional_library import library
import numpy as np
from numpy.typing import NDArray

VALUES_IN_GROUP = 2**18


def write_parquet(stream: BinaryIO, recording: Recording) -> None:
    """
    Write a recording with a column of time, and units in the metadata of the columns.

    Parameters
    ----------
    stream : binary file
    recording : Recording

    Raises
    ------
    DataError
        If the library for the format is not installed.

    """
    arrow = library('pyarrow', 'pyarrow', 'Parquet files')
    parquet = library('pyarrow.parquet', 'pyarrow', 'Parquet files')
    units = ['s', *(kind.unit for kind in recording.kinds)]
    schema = arrow.schema(
        [
            arrow.field(name, arrow.float64(), metadata={'unit': unit})
            for name, unit in zip(['time', *recording.names], units, strict=True)
        ],
        metadata={
            'stand': recording.stand,
            'sample_rate': repr(recording.sample_rate),
            'stamp_ns': str(recording.stamp_ns),
        },
    )
    with parquet.ParquetWriter(stream, schema) as writer:

        def write(parts: list[NDArray[np.float64]]) -> None:
            if parts:
                table = np.concatenate(parts)
                columns = [arrow.array(column) for column in table.T]
                writer.write_table(arrow.table(columns, schema=schema))

        parts: list[NDArray[np.float64]] = []
        count = 0
        for index, samples in recording.rows():
            parts.append(np.column_stack([recording.times(index, len(samples)), samples]))
            count += parts[-1].size
            if count >= VALUES_IN_GROUP:
                write(parts)
                parts, count = [], 0
        write(parts)
