# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Tables as universal files: a binary data set 58 for each channel."""

from typing import BinaryIO

from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.storage.formats.uff58_table import (
    DOUBLE,
    EVEN,
    HEAD_LINES,
    IEEE_754,
    LITTLE_ENDIAN,
    NONE,
    TIME,
    TIME_RESPONSE,
)
from identnl_ros.storage.formats.writers import Recording
import numpy as np

_QUANTITIES = {
    SensorKind.FORCE: (13, 'Excitation force'),
    SensorKind.DISPLACEMENT: (8, 'Displacement'),
    SensorKind.VELOCITY: (11, 'Velocity'),
    SensorKind.ACCELERATION: (12, 'Acceleration'),
}
_END = b'    -1\n'
_NUMBERS = np.dtype('<f8')
ROWS_AT_ONCE = 2**12


def write_uff58(stream: BinaryIO, recording: Recording) -> None:
    """
    Write a recording; lost samples are NaN, as the format knows no gaps.

    Parameters
    ----------
    stream : binary file
        That can be positioned: channels stand one after another.
    recording : Recording

    """
    places = []
    lost = np.full(ROWS_AT_ONCE, np.nan).astype(_NUMBERS).tobytes()
    for number in range(len(recording.names)):
        stream.write(_head(recording, number))
        places.append(stream.tell())
        for first in range(0, recording.length, ROWS_AT_ONCE):
            stream.write(lost[: (recording.length - first) * _NUMBERS.itemsize])
        stream.write(_END)
    end = stream.tell()
    for index, samples in recording.rows():
        for place, values in zip(places, samples.T, strict=True):
            stream.seek(place + index * _NUMBERS.itemsize)
            stream.write(values.astype(_NUMBERS).tobytes())
    stream.seek(end)


def _head(recording: Recording, number: int) -> bytes:
    """Return what stands before the numbers of a channel."""
    kind = recording.kinds[number]
    quantity, label = _QUANTITIES[kind]
    size = recording.length * _NUMBERS.itemsize
    lines = [
        '    -1',
        f'    58b{LITTLE_ENDIAN:6d}{IEEE_754:6d}{HEAD_LINES:12d}{size:12d}'
        f'{0:6d}{0:6d}{0:12d}{0:12d}',
        f'{recording.names[number]:80.80s}',
        f'{recording.stand:80.80s}',
        *[f'{NONE:80s}'] * 3,
        f'{TIME_RESPONSE:5d}{number + 1:10d}{0:5d}{0:10d} {NONE:10s}{number + 1:10d}{0:4d} '
        f'{NONE:10s}{0:10d}{0:4d}',
        f'{DOUBLE:10d}{recording.length:10d}{EVEN:10d}{0:13.5e}{1 / recording.sample_rate:13.5e}'
        f'{0:13.5e}',
        _axis(TIME, 'Time', 's'),
        _axis(quantity, label, kind.unit),
        _axis(0, NONE, NONE),
        _axis(0, NONE, NONE),
    ]
    return ('\n'.join(lines) + '\n').encode()


def _axis(quantity: int, label: str, unit: str) -> str:
    return f'{quantity:10d}{0:5d}{0:5d}{0:5d} {label:20s} {unit:20s}'
