# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What an identifier has learned, to be saved, restored or looked at."""

from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.pointwise.noise_bias import NoiseCovariances, SlopeSums
from identnl_ros.core.pointwise.overidentification import Moments
from identnl_ros.core.pointwise.scatter import Scatter
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class IdentifierState:
    """
    Everything an identifier has learned.

    Parameters
    ----------
    information : Information
        Of all complete batches.
    scatter : Scatter
        Of the residuals of all complete batches.
    slopes : SlopeSums
        What the effect of sensor noise needs of all complete batches.
    noise : NoiseCovariances or None
        Of the latest block; None before the first.
    earlier_noise : ndarray, shape (n_unknowns + 1, n_unknowns + 1)
        Effect of sensor noise in the streams before the present one.
    pending : ndarray, shape (n_pending, 4, n_coordinates)
        Displacement, velocity, acceleration, force of instants not yet factored.
    samples, rejected : int
        Instants used and left out.
    unknowns : tuple of str
        Names of the unknown parameters.
    derived : frozenset of str
        Quantities that were differentiated rather than measured.
    noise_estimated : bool
        Some sensor's noise was estimated from its samples.
    stream_id : int or None
        Of the stream followed last.
    next_index : int
        First sample of it not seen yet.
    moments : Moments or None
        Of the test whether equations of motion and sensors contradict each other; None: not kept.

    """

    information: Information
    scatter: Scatter
    slopes: SlopeSums
    noise: NoiseCovariances | None
    earlier_noise: NDArray[np.float64]
    pending: NDArray[np.float64]
    samples: int
    rejected: int
    unknowns: tuple[str, ...]
    derived: frozenset[str]
    noise_estimated: bool
    stream_id: int | None
    next_index: int
    moments: Moments | None = None
