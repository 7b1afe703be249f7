# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Band-limited interpolation of a uniformly sampled source on another grid, streaming."""

from dataclasses import dataclass
from functools import lru_cache

from identnl_ros.core.errors import DataError
import numpy as np
from numpy.typing import NDArray

# Zero crossings of the sinc on either side.
HALF_WIDTH = 64
# What the stop band leaves, and how far the pass band is off 1 [dB].
STOP_BAND = 120.0
# Grid points computed at once.
CHUNK = 256
# Of the polynomials that give the weights between two samples: off by 1e-15 of the largest one,
# 1e-10 where the grid is coarser than the samples (there the window ends between samples).
DEGREE = 15


@dataclass(frozen=True)
class Grid:
    """
    Where the points of a grid lie among the samples of a source.

    Parameters
    ----------
    start : float
        Place of point 0 in samples of the source.
    step : float
        Samples of the source per point; 1 and a little for clocks that differ.

    Raises
    ------
    DataError
        If the step is not positive or a number is not finite.

    """

    start: float
    step: float

    def __post_init__(self) -> None:
        """Check ranges."""
        if not (np.isfinite([self.start, self.step]).all() and self.step > 0):
            raise DataError(
                f'grid: start {self.start} and step {self.step} must be finite, the step positive'
            )

    def place(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Places of points among the samples.

        Parameters
        ----------
        point : ndarray
            Running index of the points.

        Returns
        -------
        ndarray
            [samples of the source].

        """
        return np.asarray(self.start + self.step * point)


class Resampler:
    """
    Interpolate all channels of a source on a grid, chunk by chunk.

    A sinc under Kaiser's window (Kaiser and Schafer 1980), evaluated exactly at every point.
    Good to `STOP_BAND` up to `passband` of the lower of the two Nyquist frequencies; where the
    grid is coarser than the samples, what lies above its Nyquist frequency is removed.

    Parameters
    ----------
    grid : Grid
    channels : int

    """

    def __init__(self, grid: Grid, channels: int) -> None:
        self._grid = grid
        self._stretch = max(1.0, grid.step)
        self._reach = reach_of(self._stretch)
        self._buffer = np.empty((0, channels))
        self._buffer_begin = 0
        self._next_point = 0

    @property
    def passband(self) -> float:
        """Share of the lower Nyquist frequency that is interpolated to the stop band [-]."""
        return float(1 - (STOP_BAND - 8) / (2.285 * 2 * HALF_WIDTH) / 2 / np.pi)

    def add(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Take the next samples and give the points that are complete.

        Parameters
        ----------
        samples : ndarray, shape (n_samples, n_channels)
            NaN where there is no valid sample.

        Returns
        -------
        ndarray, shape (n_points, n_channels)
            NaN where an invalid sample, or one before the first, is within reach.

        """
        self._buffer = np.concatenate((self._buffer, samples))
        end = self._buffer_begin + len(self._buffer)
        # Complete as long as floor(place) + reach < end; rounding is left to the comparison.
        count = int(np.floor((end - self._reach - self._grid.start) / self._grid.step)) + 2
        points = np.arange(self._next_point, max(count, self._next_point))
        base = np.floor(self._grid.place(points.astype(np.float64))).astype(np.int64)
        points = points[base + self._reach < end]
        place = self._grid.place(points.astype(np.float64)) - self._buffer_begin
        result = interpolate(self._buffer, place, self._stretch)
        self._next_point += len(points)
        needed = int(np.floor(self._grid.place(np.array(float(self._next_point))))) - self._reach
        drop = int(np.clip(needed - self._buffer_begin, 0, len(self._buffer)))
        self._buffer = self._buffer[drop:]
        self._buffer_begin += drop
        return result


def reach_of(stretch: float) -> int:
    """
    Count the samples on either side that a point is made from.

    Parameters
    ----------
    stretch : float
        Samples per point, at least 1.

    Returns
    -------
    int

    """
    return int(np.ceil(HALF_WIDTH * stretch))


def interpolate(
    samples: NDArray[np.float64], place: NDArray[np.float64], stretch: float = 1.0
) -> NDArray[np.float64]:
    """
    Evaluate all channels of a source at places between its samples.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n_channels)
    place : ndarray, shape (n_points,)
        [samples of the source].
    stretch : float
        Samples per point where the points are coarser, else 1.

    Returns
    -------
    ndarray, shape (n_points, n_channels)
        NaN where an invalid sample, or one beyond the ends, is within reach.

    """
    result = np.full((len(place), samples.shape[1]), np.nan)
    half = reach_of(stretch)
    reach = np.arange(-half + 1, half + 1)
    polynomials = _polynomials(float(stretch))
    whole = np.floor(place).astype(np.int64)
    inside = np.flatnonzero((whole - half + 1 >= 0) & (whole + half < len(samples)))
    for begin in range(0, len(inside), CHUNK):
        own = inside[begin : begin + CHUNK]
        between = 2 * (place[own] - whole[own])[:, np.newaxis] - 1
        weights = np.repeat(polynomials[-1:], len(own), axis=0)
        for coefficients in polynomials[-2::-1]:
            weights *= between
            weights += coefficients
        values = samples[whole[own][:, np.newaxis] + reach]
        result[own] = np.matmul(weights[:, np.newaxis, :], values)[:, 0]
    return result


def weights_at(place: NDArray[np.float64], stretch: float) -> NDArray[np.float64]:
    """
    Evaluate the windowed sinc.

    Parameters
    ----------
    place : ndarray, shape (n_points,)
        Behind the sample before, from 0 to 1 [samples].
    stretch : float
        Samples per point where the points are coarser, else 1.

    Returns
    -------
    ndarray, shape (n_points, 2 * `reach_of` (stretch))
        Weights of the samples around.

    """
    half = reach_of(stretch)
    shape = 0.1102 * (STOP_BAND - 8.7)
    distance = (place[:, np.newaxis] - np.arange(-half + 1, half + 1)) / stretch
    window = np.sqrt(np.maximum(0.0, 1 - (distance / HALF_WIDTH) ** 2))
    return np.asarray(np.sinc(distance) * np.i0(shape * window) / np.i0(shape) / stretch)


@lru_cache(maxsize=8)
def _polynomials(stretch: float) -> NDArray[np.float64]:
    """Coefficients of the weights, by powers of a place that runs from -1 to 1."""
    nodes = np.cos((np.arange(DEGREE + 1) + 0.5) * np.pi / (DEGREE + 1))
    values = weights_at((nodes + 1) / 2, stretch)
    return np.asarray(np.linalg.solve(np.vander(nodes, increasing=True), values))


def resample(samples: NDArray[np.float64], grid: Grid, count: int) -> NDArray[np.float64]:
    """
    Interpolate a whole record.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n_channels)
    grid : Grid
    count : int
        Number of points.

    Returns
    -------
    ndarray, shape (count, n_channels)
        NaN where the record does not reach.

    """
    result = np.full((count, samples.shape[1]), np.nan)
    known = Resampler(grid, samples.shape[1]).add(samples)[:count]
    result[: len(known)] = known
    return result
