# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a weak-form identifier has learned, to be saved, restored or merged."""

from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.estimation.force_noise import ForceNoise
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class WeakState:
    """
    What has been learned, without the samples it was learned from.

    Parameters
    ----------
    information : Information
        On the differences of the unknowns from `values`, initial states eliminated.
    tested : Information or None
        On these and on the alternatives to the model, see `alternatives`.
    values : ndarray, shape (n_unknowns,)
        At which the machine was simulated [SI].
    statistics : ndarray, shape (2, 5, n_channels)
        Of the residuals, see `ResidualStatistics.tables`.
    average : int
        Samples over which they are averaged.
    fitted : int
        Numbers that were fitted.
    force_noise : ForceNoise
        What noise of the measured force adds to the errors.
    perfect : bool
        The sensors were stated to be without noise.
    changing : bool
        The latest samples contradicted what had been learned before.
    samples, rejected : int
        Instants used and left out.
    unknowns : tuple of str
        Names of the unknown parameters.
    noise_estimated : bool
        Some sensor's noise was estimated from its samples.
    stream_id : int or None
        Of the stream followed last.
    next_index : int
        First sample of it not seen yet.

    """

    information: Information
    tested: Information | None
    values: NDArray[np.float64]
    statistics: NDArray[np.float64]
    average: int
    fitted: int
    force_noise: ForceNoise
    perfect: bool
    changing: bool
    samples: int
    rejected: int
    unknowns: tuple[str, ...]
    noise_estimated: bool
    stream_id: int | None
    next_index: int
