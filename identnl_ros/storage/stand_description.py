# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a bag tells about the stand whose samples it holds."""

from dataclasses import dataclass

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout
import numpy as np


@dataclass(frozen=True)
class StandDescription:
    """
    Everything needed to understand the sample blocks of one stream.

    Parameters
    ----------
    stand : str
        Name of the stand.
    stream_id : int
        The same in every block of the stream.
    sample_rate : float
        [Hz].
    layout : Layout
        Channels in the order of the columns; gains and offsets are already applied to
        the samples and kept for information.
    machine_text : str
        Text of the machine file; empty: not known.
    layout_text : str
        Text of the layout file; empty: not known.
    stamp_ns : int
        When the stream was opened, acquisition clock [ns].

    Raises
    ------
    DataError
        If the sample rate is not positive or the identifier is not a 64-bit number.

    """

    stand: str
    stream_id: int
    sample_rate: float
    layout: Layout
    machine_text: str = ''
    layout_text: str = ''
    stamp_ns: int = 0

    def __post_init__(self) -> None:
        """Check what every consumer relies on."""
        if not (np.isfinite(self.sample_rate) and self.sample_rate > 0):
            raise DataError(
                f'stand {self.stand}: the sample rate is {self.sample_rate} Hz, '
                'expected a positive number'
            )
        if not 0 <= self.stream_id < 2**64:
            raise DataError(
                f'stand {self.stand}: the stream identifier is {self.stream_id}, '
                'expected 0 to 2^64 - 1'
            )
