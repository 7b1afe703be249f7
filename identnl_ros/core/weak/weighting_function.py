# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Test functions of the weak form: smooth, zero outside a short time, as long as the data allow.

Multiplied with the equation of motion and integrated by parts, they move derivatives from the
measured motion to themselves (Messenger and Bortz 2021, Multiscale Modeling and Simulation 19,
1474-1497).
"""

from dataclasses import dataclass

from identnl_ros.core.measurement.stencils import stencil
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# (1 - t^2)^p: smooth enough for two integrations by parts and the differences that make them.
POWER = 8
HALF_WIDTH = 8
# Share of the motion's power that the test functions must let pass.
POWER_SHARE = 0.99
# A spectral line stands out when it exceeds the noise by this factor.
STANDING_OUT = 6.0
SHORTEST, LONGEST = 8, 512  # samples either side


@dataclass(frozen=True)
class WeightingFunction:
    """
    One test function, sampled, with its derivatives.

    Parameters
    ----------
    half_length : int
        Samples from the centre to where it vanishes.
    sample_rate : float
        [Hz].

    """

    half_length: int
    sample_rate: float

    @property
    def duration(self) -> float:
        """From where it begins to where it vanishes [s]."""
        return 2 * (self.half_length + 1) / self.sample_rate

    @property
    def stride(self) -> int:
        """Samples from one window to the next: neighbours overlap."""
        return max(1, self.half_length * 2 // 5)

    @property
    def values(self) -> Reals:
        """Samples, shape (2 * (half_length + HALF_WIDTH) + 1,)."""
        time = np.arange(-self.half_length, self.half_length + 1) / (self.half_length + 1.0)
        return np.pad((1 - time**2) ** POWER, HALF_WIDTH)

    def derivative(self, order: int) -> Reals:
        """
        Differentiate as the samples do: exact summation by parts.

        Parameters
        ----------
        order : int

        Returns
        -------
        ndarray
            As long as `values` [1/s^order].

        """
        weights = stencil(order, 0.0, HALF_WIDTH) * self.sample_rate**order
        return np.convolve(self.values[HALF_WIDTH:-HALF_WIDTH], weights[::-1], 'full')

    def windows(self, table: Reals, weights: Reals) -> Reals:
        """
        Sum over every window.

        Parameters
        ----------
        table : ndarray, shape (n_samples, ...)
        weights : ndarray, shape (n_window,)
            `values` or a `derivative`.

        Returns
        -------
        ndarray, shape (n_windows, ...)

        """
        starts = range(0, len(table) - len(weights) + 1, self.stride)
        flat = table.reshape(len(table), -1)
        sums = np.array([weights @ flat[start : start + len(weights)] for start in starts])
        return sums.reshape(len(starts), *table.shape[1:])


def bandwidth(white: Reals, sample_rate: float, order: int) -> float:
    """
    Find the frequency up to which measured motion stands out of its noise.

    Parameters
    ----------
    white : ndarray, shape (n_samples, n_channels)
        Motion in units of its noise; NaN: no valid sample.
    sample_rate : float
        [Hz].
    order : int
        0: displacement, 1: velocity, 2: acceleration.

    Returns
    -------
    float
        Below which nearly all power of the velocity lies [Hz].

    """
    valid = white[np.isfinite(white).all(axis=1)]
    window = np.hanning(len(valid))[:, np.newaxis]
    lines = np.fft.rfft((valid - valid.mean(axis=0)) * window, axis=0)
    power = (np.abs(lines) ** 2).sum(axis=1) / (window**2).sum()
    power[power < STANDING_OUT * white.shape[1]] = 0.0
    frequencies = np.fft.rfftfreq(len(valid), 1 / sample_rate)
    power[1:] *= frequencies[1:] ** (2.0 - 2.0 * order)
    power[0] = 0.0
    if not power.any():
        return float(frequencies[-1])
    share = np.cumsum(power) / power.sum()
    return float(frequencies[np.searchsorted(share, POWER_SHARE)])


def weighting_function_for(frequency: float, sample_rate: float) -> WeightingFunction:
    """
    Choose the length: half the power of motion at a frequency passes.

    Parameters
    ----------
    frequency : float
        [Hz].
    sample_rate : float
        [Hz].

    Returns
    -------
    WeightingFunction

    """
    # Close to a Gaussian of standard deviation half_length / sqrt(2 p).
    deviation = np.sqrt(np.log(2)) / (2 * np.pi * max(frequency, 1e-9)) * sample_rate
    half_length = int(np.clip(round(deviation * np.sqrt(2 * POWER)), SHORTEST, LONGEST))
    return WeightingFunction(half_length, sample_rate)
