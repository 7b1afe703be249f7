# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Sensors in units of their noise, turned so that motion shows in as few channels as possible.

Of each kind there are usually more sensors than coordinates. An orthogonal transformation of the
readings of a kind puts all that any motion can do into as many channels as there are coordinates;
the others hold noise and faults of sensors only. White noise stays white.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Tilt this little outside the channels of motion is in them.
ROUNDING = 1e-9


class MotionChannels:
    """
    An orthogonal transformation of the readings.

    Parameters
    ----------
    rows : sequence of (int, list of int, ndarray)
        Of every kind of sensor: order of derivative, places of its sensors among all, and what
        they read per unit of every coordinate, shape (n_sensors_of_kind, n_coordinates).
    noise : ndarray, shape (n_sensors,)
        Standard deviation of a reading [SI].
    tilt : ndarray, shape (n_sensors, n_coordinates)
        What the sensors read of gravity per unit of every coordinate.

    Attributes
    ----------
    count : int
        Channels in which motion shows; they come first.
    turn : ndarray, shape (n_sensors, n_sensors)
        Orthogonal: channels are readings over noise, times this.

    """

    def __init__(
        self, rows: Sequence[tuple[int, list[int], Reals]], noise: Reals, tilt: Reals
    ) -> None:
        self._noise = noise
        self._triangles: list[tuple[int, slice, Reals]] = []
        moved: list[Reals] = []
        still: list[Reals] = []
        first = 0
        for order, places, matrix in rows:
            scale = noise[places, np.newaxis]
            white, tilted = matrix / scale, tilt[places] / scale
            left, right = np.linalg.qr(white, mode='complete')
            count = min(white.shape)
            outside = np.abs(left[:, count:].T @ tilted).max(initial=0.0)
            if outside > ROUNDING * np.abs(tilted).max(initial=0.0):
                both = np.hstack((white, tilted))
                left, right = np.linalg.qr(both, mode='complete')
                count, right = min(both.shape), right[:, : white.shape[1]]
            channels = slice(first, first + count)
            self._triangles.append((order, channels, right[:count]))
            if tilted.any():
                self._triangles.append((0, channels, left[:, :count].T @ tilted))
            whole = np.zeros((len(noise), len(places)))
            whole[places] = left
            moved.append(whole[:, :count])
            still.append(whole[:, count:])
            first += count
        self.count = first
        self.turn = np.hstack((*moved, *still))

    def of_readings(self, readings: Reals) -> Reals:
        """
        Transform readings.

        Parameters
        ----------
        readings : ndarray, shape (n_samples, n_sensors)
            [SI].

        Returns
        -------
        ndarray, shape (n_sensors, n_samples)
            By channel.

        """
        return np.asarray(self.turn.T @ (readings / self._noise).T)

    @property
    def per_motion(self) -> Reals:
        """Channels per unit of displacement, velocity, acceleration, (3, count, n_coordinates)."""
        result = np.zeros((3, self.count, self._triangles[0][2].shape[1]))
        for order, channels, triangle in self._triangles:
            result[order, channels] = triangle
        return result

    def of_motion(self, motion: Reals, dtype: type = np.float64) -> NDArray[Any]:
        """
        Transform what the sensors read of a motion.

        Parameters
        ----------
        motion : ndarray, shape (n_samples, 3, n_coordinates, n_columns)
            Displacement, velocity, acceleration.
        dtype : type
            Of the result.

        Returns
        -------
        ndarray, shape (n_columns, count, n_samples)

        """
        result: NDArray[Any] = np.zeros((motion.shape[3], self.count, len(motion)), dtype)
        for order, channels, triangle in self._triangles:
            result[:, channels] += (triangle @ motion[:, order]).transpose(2, 1, 0)
        return result
