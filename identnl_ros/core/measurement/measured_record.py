# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A measured record and the noise in it."""

from dataclasses import dataclass, replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.noise import NoiseEstimate, REACH
import numpy as np
from numpy.typing import NDArray

# Samples left out at the ends, where splines through a force are less exact.
MARGIN = 16


@dataclass(frozen=True)
class MeasuredRecord:
    """
    Samples of all channels of a stand over an uninterrupted time.

    Parameters
    ----------
    layout : Layout
    sample_rate : float
        [Hz].
    samples : ndarray, shape (n_samples, n_channels)
        SI; NaN where there is no valid sample.
    first_index : int
        Index of the first sample in its stream, which begins with index 0.

    Raises
    ------
    DataError
        If the shape does not fit the layout, or there are too few samples.

    """

    layout: Layout
    sample_rate: float
    samples: NDArray[np.float64]
    first_index: int = 0

    def __post_init__(self) -> None:
        """Check what the fit relies on."""
        if self.samples.ndim != 2 or self.samples.shape[1] != len(self.layout.sensors):
            raise DataError(
                f'record: samples have the shape {self.samples.shape}, expected one column for '
                f'each of the {len(self.layout.sensors)} sensors of the layout'
            )
        if len(self.samples) < 4 * MARGIN:
            raise DataError(
                f'record: {len(self.samples)} samples are too few for a fit, '
                f'expected at least {4 * MARGIN}'
            )

    @property
    def origin(self) -> float:
        """Time of the first sample since the begin of the stream [s]."""
        return self.first_index / self.sample_rate

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of the samples since the begin of the stream [s], shape (n_samples,)."""
        return np.asarray((self.first_index + np.arange(len(self.samples))) / self.sample_rate)

    def part(self, begin: int, end: int) -> 'MeasuredRecord':
        """
        Cut out consecutive samples.

        Parameters
        ----------
        begin, end : int
            From the first up to, not including, the end.

        Returns
        -------
        MeasuredRecord

        """
        samples = self.samples[begin:end]
        return replace(self, samples=samples, first_index=self.first_index + begin)


def standard_deviations(record: MeasuredRecord) -> NDArray[np.float64]:
    """
    Find the noise of every channel, as far as it is stated or can be estimated.

    Parameters
    ----------
    record : MeasuredRecord

    Returns
    -------
    ndarray, shape (n_channels,)
        Of one sample, with that of a coarse resolution [SI]; 0: no noise.

    """
    stated = np.array([sensor.noise for sensor in record.layout.sensors])
    step = np.array([sensor.resolution for sensor in record.layout.sensors])
    if np.isnan(stated).any() and len(record.samples) > REACH:
        estimate = NoiseEstimate(len(stated))
        estimate.add(record.samples)
        found = estimate.standard_deviation
        return np.where(np.isnan(stated), found, np.sqrt(stated**2 + step**2 / 12))
    return np.asarray(np.sqrt(stated**2 + step**2 / 12))
