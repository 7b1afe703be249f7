# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the writers of tables have in common."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

from identnl_ros.core.measurement.layout import SensorKind
import numpy as np
from numpy.typing import NDArray

Rows = Callable[[], Iterator[tuple[int, NDArray[np.float64]]]]


@dataclass(frozen=True)
class Recording:
    """
    The samples of a stream, to be written as a table.

    Parameters
    ----------
    stand : str
    names : tuple of str
        Of the channels.
    kinds : tuple of SensorKind
    sample_rate : float
        [Hz].
    stamp_ns : int
        Of the first sample [ns].
    length : int
        Sample intervals from the first to after the last, with the lost ones.
    rows : callable
        Yields running index, from 0, and samples [SI].

    """

    stand: str
    names: tuple[str, ...]
    kinds: tuple[SensorKind, ...]
    sample_rate: float
    stamp_ns: int
    length: int
    rows: Rows

    def times(self, index: int, count: int) -> NDArray[np.float64]:
        """
        Tell the time of some samples since the first.

        Parameters
        ----------
        index, count : int

        Returns
        -------
        ndarray, shape (count,)
            [s].

        """
        return np.arange(index, index + count) / self.sample_rate


Writer = Callable[[BinaryIO, Recording], None]
