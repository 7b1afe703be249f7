# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Tables as CSV files, every number to its last bit."""

import csv
from io import StringIO
from typing import BinaryIO

from identnl_ros.storage.formats.writers import Recording
import numpy as np


def write_csv(stream: BinaryIO, recording: Recording) -> None:
    """
    Write a recording with a column of time and units in the first row.

    Parameters
    ----------
    stream : binary file
    recording : Recording

    """
    head = StringIO()
    channels = zip(recording.names, recording.kinds, strict=True)
    csv.writer(head, lineterminator='\n').writerow(
        ['time [s]', *(f'{name} [{kind.unit}]' for name, kind in channels)]
    )
    stream.write(head.getvalue().encode())
    for index, samples in recording.rows():
        table = np.column_stack([recording.times(index, len(samples)), samples])
        lines = [','.join(map(repr, row)) for row in table.tolist()]
        stream.write(('\n'.join(lines) + '\n').encode())
