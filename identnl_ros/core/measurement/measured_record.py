# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A measured record and the noise in it."""

from dataclasses import dataclass

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.noise import DIFFERENCE_ORDER, NoiseEstimate
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

    Raises
    ------
    DataError
        If the shape does not fit the layout, or there are too few samples.

    """

    layout: Layout
    sample_rate: float
    samples: NDArray[np.float64]

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
    if np.isnan(stated).any() and len(record.samples) > DIFFERENCE_ORDER:
        estimate = NoiseEstimate(len(stated))
        estimate.add(record.samples)
        found = estimate.standard_deviation
        return np.where(np.isnan(stated), found, np.sqrt(stated**2 + step**2 / 12))
    return np.asarray(np.sqrt(stated**2 + step**2 / 12))
