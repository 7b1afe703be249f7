# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A device as the alignment of a stream takes it."""

from dataclasses import dataclass

from identnl_ros.core.errors import DataError
import numpy as np


@dataclass(frozen=True)
class StreamSource:
    """
    A device with a sample clock of its own.

    Parameters
    ----------
    name : str
    channels : tuple of str
        Names of the sensors of the layout that the columns are.
    sample_rate : float
        Nominal [Hz].
    start_deviation : float or None
        None: stamps are times of the host, with jitter. Else: stamps count the source's own
        clock, and only their begin is known, with this standard deviation [s].

    Raises
    ------
    DataError
        If a number is out of its range.

    """

    name: str
    channels: tuple[str, ...]
    sample_rate: float
    start_deviation: float | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        if not (np.isfinite(self.sample_rate) and self.sample_rate > 0):
            raise DataError(
                f'source {self.name}: the sample rate is {self.sample_rate} Hz, expected a '
                'positive number'
            )
        if self.start_deviation is not None and not self.start_deviation > 0:
            raise DataError(
                f'source {self.name}: the standard deviation of its begin is '
                f'{self.start_deviation} s, expected a positive number'
            )
