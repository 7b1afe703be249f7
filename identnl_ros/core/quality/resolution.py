# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The steps of an analogue-to-digital converter: stated, or found in the samples."""

from identnl_ros.core.measurement.layout import Layout
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

# Smaller changes, relative to the value, are rounding.
ROUNDING = 1e-14
# Of so many changes of a converter's steps some are equal, of finer samples none; equal to this
# share of the samples' size.
MANY_CHANGES = 1000
EQUAL = 1e-12
# Of a value of which a drifting offset was taken out.
DRIFT_ROUNDING = 1e-10


class FoundResolution:
    """
    Smallest change between neighbouring samples so far, or the resolution stated.

    The smallest change counts as a step, unless the first thousand changes within stretches
    were all different: there are more than a hundred thousand steps between them then.

    Parameters
    ----------
    layout : Layout

    """

    def __init__(self, layout: Layout) -> None:
        self._stated = np.array([sensor.resolution for sensor in layout.sensors])
        drifts = np.array([sensor.drift != 0 for sensor in layout.sensors])
        self._rounding = np.where(drifts, DRIFT_ROUNDING, ROUNDING)
        self._exact = not drifts.any()
        self._found = np.full(len(self._stated), np.inf)
        self._equal = np.zeros(len(self._stated), dtype=np.intp)
        self._changes = np.zeros(len(self._stated), dtype=np.intp)

    @property
    def step(self) -> NDArray[np.float64]:
        """Of every channel [SI unit], shape (n_channels,); 0: none found yet."""
        credible = (self._equal > 0) | (self._changes < MANY_CHANGES)
        found = np.where(np.isfinite(self._found) & credible, self._found, 0.0)
        return np.asarray(np.maximum(self._stated, found))

    def add(self, change: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.bool_]:
        """
        Take absolute changes between neighbouring samples.

        Parameters
        ----------
        change : ndarray, shape (n_samples, n_channels)
            NaN where a sample is missing.
        size : ndarray, shape (n_channels,)
            Of the samples.

        Returns
        -------
        ndarray, shape (n_samples, n_channels)
            Where the value has not changed.

        """
        least = self._rounding * np.nan_to_num(size)
        changes = np.where(change > least, change, np.inf)
        smallest = changes.min(axis=0, initial=np.inf)
        self._found = np.minimum(self._found, smallest)
        if (self._changes < MANY_CHANGES).any():
            ordered = np.sort(changes, axis=0)
            with np.errstate(invalid='ignore'):
                equal = np.diff(ordered, axis=0) <= EQUAL * np.nan_to_num(size)
            self._equal += equal.sum(axis=0)
            self._changes += np.isfinite(changes).sum(axis=0)
        return change == 0 if self._exact else change <= least


def most_likely_value(
    step: NDArray[np.float64], noise: NDArray[np.float64]
) -> NDArray[np.float64]:
    """
    Probability that Gaussian noise around the middle of a converter step stays in it.

    Parameters
    ----------
    step, noise : ndarray, shape (n_channels,)
        Noise: standard deviation; NaN gives NaN.

    Returns
    -------
    ndarray, shape (n_channels,)
        1 without noise.

    """
    with np.errstate(divide='ignore', invalid='ignore'):
        ratio = np.where(
            noise > 0, step / (np.sqrt(8.0) * noise), np.where(noise == 0, np.inf, noise)
        )
    # Also the finest samples have a last bit.
    return np.asarray(np.maximum(erf(ratio), np.where(np.isnan(ratio), np.nan, 1e-12)))
