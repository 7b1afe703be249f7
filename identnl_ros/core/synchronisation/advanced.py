# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A record whose late readings stand where they belong."""

from dataclasses import replace

from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.synchronisation.resampling import Grid, resample
import numpy as np
from numpy.typing import NDArray


def advanced(record: MeasuredRecord, delays: NDArray[np.float64]) -> MeasuredRecord:
    """
    Move late readings to where they belong.

    Parameters
    ----------
    record : MeasuredRecord
    delays : ndarray, shape (n_channels,)
        [s].

    Returns
    -------
    MeasuredRecord
        NaN where an edge or an invalid sample is within reach of the interpolation.

    """
    samples = record.samples.copy()
    for channel in np.flatnonzero(delays):
        grid = Grid(float(delays[channel]) * record.sample_rate, 1.0)
        samples[:, [channel]] = resample(samples[:, [channel]], grid, len(samples))
    return replace(record, samples=samples)
