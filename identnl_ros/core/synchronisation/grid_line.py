# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Where the points of a stream's grid lie among the samples of a source."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Line:
    """
    Where grid points lie among the samples of a source.

    Parameters
    ----------
    point : int
        A point of the grid.
    place : float
        Its place [samples of the source].
    step : float
        Samples per point.

    """

    point: int
    place: float
    step: float

    def at(self, point: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """
        Places of points.

        Parameters
        ----------
        point : ndarray or float

        Returns
        -------
        ndarray
            [samples of the source].

        """
        return np.asarray(self.place + self.step * (point - self.point))

    def point_of(self, index: float) -> float:
        """
        Find where a sample lies on the grid.

        Parameters
        ----------
        index : float
            [samples of the source].

        Returns
        -------
        float
            [points].

        """
        return self.point + (index - self.place) / self.step

    def moved(self, point: int, samples: float = 0.0, step: float = 0.0) -> 'Line':
        """
        Give the line from a point on, read later and faster.

        Parameters
        ----------
        point : int
        samples : float
            Moved at this point [samples of the source].
        step : float
            Samples per point more than before.

        Returns
        -------
        Line

        """
        return Line(point, float(self.at(point)) + samples, self.step + step)
