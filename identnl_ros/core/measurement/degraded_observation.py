# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
From those sensors of a kind that have a valid reading to the coordinates, instant by instant.

Sensors have unknown constant offsets. Where all have a reading, the offsets move the coordinates
by a constant. Where some have none, it would be another constant, and the coordinates would step;
so what the fit to all sensors leaves on average is subtracted from the readings first.
"""

from collections.abc import Collection
from dataclasses import dataclass

from identnl_ros.core.measurement.observation import Observation, SEEING_TOLERANCE
from identnl_ros.core.measurement.sensor_offsets import SensorOffsets
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Sets of valid channels whose maps are kept.
MAPS_KEPT = 256
NONE = np.empty(0, np.int_)
# Motions of the coordinates that a smaller set of sensors tells less well than by this share are
# geometry, not rounding.
SAME = 1e-6


@dataclass(frozen=True)
class Accuracy:
    """
    How accurate the coordinates at some instants are on average.

    Parameters
    ----------
    observation : Observation
        At those where all sensors have a reading.
    maps : tuple of (int, ndarray)
        Number of instants and map from the readings, of every set of valid sensors.

    """

    observation: Observation
    maps: tuple[tuple[int, Reals], ...] = ()

    def covariance(self, variance: Reals) -> Reals:
        """
        Propagate the variance of the readings to the coordinates.

        Parameters
        ----------
        variance : ndarray, shape (n_sensors_of_layout,)

        Returns
        -------
        ndarray, shape (n_coordinates, n_coordinates)
            Of one sample, averaged over the instants at which all coordinates are known.

        """
        total = sum(count for count, _ in self.maps)
        if not total:
            return self.observation.covariance(variance)
        own = variance[list(self.observation.channels)]
        return np.asarray(
            sum((count / total * matrix * own) @ matrix.T for count, matrix in self.maps)
        )


class DegradedObservation:
    """
    Coordinates from the sensors of one kind, as far as these have a valid reading.

    Instants at which all have one are mapped as by the observation itself.

    Parameters
    ----------
    observation : Observation
        With all sensors.

    """

    def __init__(self, observation: Observation) -> None:
        self.full = observation
        self._lengths = _lengths(observation)
        self._maps: dict[bytes, Reals] = {}
        self.restart()

    def restart(self) -> None:
        """Forget the offsets: other samples come next."""
        count = len(self.full.channels)
        self._use(np.ones(count, np.bool_))
        self._carried = np.zeros(count)
        self._next = 0
        self._filled_index = np.empty(0, np.int_)
        self._filled = np.empty((0, len(self.full.matrix)))
        self._filled_maps: list[Reals] = []

    def use_without(self, lost: Collection[int]) -> None:
        """
        Go on without some sensors, whether they have readings or not.

        Parameters
        ----------
        lost : collection of int
            Channels of the layout.

        """
        used = np.array([channel not in lost for channel in self.full.channels], np.bool_)
        if np.array_equal(used, self._used):
            return
        # What has been subtracted up to now goes on, so that nothing steps. With all sensors,
        # nothing needs to be subtracted.
        offsets = self._carried + self._offsets.present
        self._carried = np.zeros(len(used)) if used.all() else offsets
        self._use(used)

    def map_of(self, valid: Flags) -> Reals:
        """
        Find the map from the valid sensors alone.

        Parameters
        ----------
        valid : ndarray of bool, shape (n_channels,)

        Returns
        -------
        ndarray, shape (n_coordinates, n_channels)
            Zero columns for the other sensors; NaN in the rows of coordinates about which the
            valid sensors tell less than all do.

        """
        key = valid.tobytes()
        if key not in self._maps:
            if len(self._maps) >= MAPS_KEPT:
                self._maps.pop(next(iter(self._maps)))
            self._maps[key] = _restricted(self.full, self._lengths, valid)
        return self._maps[key]

    def coordinates(self, readings: Reals, first_index: int) -> Reals:
        """
        Map readings at consecutive instants, some of which may have been mapped before.

        Parameters
        ----------
        readings : ndarray, shape (n_samples, n_channels)
            NaN: no valid reading.
        first_index : int
            Index of the first instant, not below that of an earlier call.

        Returns
        -------
        ndarray, shape (n_samples, n_coordinates)

        """
        valid = np.isfinite(readings)
        with np.errstate(invalid='ignore'):
            values = readings @ self.full.matrix.T
        self._forget_before(first_index)
        begin = min(max(self._next - first_index, 0), len(readings))
        self._next = max(self._next, first_index + len(readings))
        self._take(readings[begin:], valid[begin:], first_index + begin)
        places = self._filled_index - first_index
        values[places] = self._filled
        return values

    def accuracy(self, first_index: int, count: int) -> Accuracy:
        """
        Tell how accurate coordinates mapped before are on average.

        Parameters
        ----------
        first_index : int
        count : int
            Instants, all of them in the latest call of `coordinates`.

        Returns
        -------
        Accuracy

        """
        low, high = np.searchsorted(self._filled_index, [first_index, first_index + count])
        if low == high:
            return Accuracy(self.full)
        maps: dict[int, tuple[int, Reals]] = {}
        for matrix in self._filled_maps[low:high]:
            maps[id(matrix)] = (maps.get(id(matrix), (0, matrix))[0] + 1, matrix)
        if count > high - low:
            maps[0] = (int(count - (high - low)), self.full.matrix)
        known = [one for one in maps.values() if np.isfinite(one[1]).all()]
        return Accuracy(self.full, tuple(known))

    def _use(self, used: Flags) -> None:
        self._used, self._offsets = used, SensorOffsets(len(used))
        # What a fit to these sensors leaves of their readings.
        fit = self.full.rows @ _fit(self.full, self._lengths, used)
        self._left = np.where(used, np.eye(len(used)) - fit.T, 0.0)

    def _forget_before(self, first_index: int) -> None:
        kept = int(np.searchsorted(self._filled_index, first_index))
        self._filled_index, self._filled = self._filled_index[kept:], self._filled[kept:]
        self._filled_maps = self._filled_maps[kept:]

    def _take(self, readings: Reals, valid: Flags, first_index: int) -> None:
        """Map those of new instants at which a sensor has no reading, or is not used."""
        if valid.all() and self._used.all():
            self._offsets.follow(readings @ self._left, NONE)
            return
        valid = valid & self._used
        complete = valid[:, self._used].all(axis=1)
        filled = np.flatnonzero(~valid.all(axis=1))
        told = np.where(valid, readings - self._carried, 0.0)
        before = np.concatenate(([0], np.cumsum(complete)))[filled]
        offsets = self._offsets.follow(told[complete] @ self._left, before)
        told = told[filled] - np.where(valid[filled], offsets, 0.0)
        found = np.empty((len(filled), len(self.full.matrix)))
        maps: list[Reals] = [self.full.matrix] * len(filled)
        for places in _alike(valid[filled]):
            matrix = self.map_of(valid[filled[places[0]]])
            found[places] = told[places] @ matrix.T
            for place in places:
                maps[place] = matrix
        self._filled_index = np.concatenate((self._filled_index, first_index + filled))
        self._filled = np.concatenate((self._filled, found))
        self._filled_maps += maps


def _alike(flags: Flags) -> list[NDArray[np.int_]]:
    """Gather the rows that are equal."""
    if not len(flags) or (flags == flags[0]).all():
        return [np.arange(len(flags))] if len(flags) else []
    number, which = np.unique(flags, axis=0, return_inverse=True)
    return [np.flatnonzero(which.reshape(-1) == i) for i in range(len(number))]


def _lengths(observation: Observation) -> Reals:
    """Scale of what is fitted: readings, over their noise, per unit of it."""
    scaled = observation.rows * observation.weights[:, np.newaxis]
    lengths: Reals = np.linalg.norm(scaled, axis=0)
    lengths[lengths == 0] = 1.0
    return lengths


def _fit(observation: Observation, lengths: Reals, valid: Flags) -> Reals:
    """Fit to the valid sensors, shape (n_unknowns, n_channels)."""
    scaled = observation.rows * observation.weights[:, np.newaxis] / lengths
    inverse = np.zeros(observation.rows.T.shape)
    if valid.any():
        solution = np.linalg.pinv(scaled[valid], rcond=SEEING_TOLERANCE)
        inverse[:, valid] = solution / lengths[:, np.newaxis] * observation.weights[valid]
    return inverse


def _restricted(observation: Observation, lengths: Reals, valid: Flags) -> Reals:
    """Map from the valid sensors; NaN in the rows of what they tell less about than all do."""
    inverse = _fit(observation, lengths, valid)
    everything = _fit(observation, lengths, np.ones_like(valid))
    less = (inverse - everything) @ observation.rows * lengths[:, np.newaxis] / lengths
    unknown = (np.abs(less) > SAME).any(axis=1)
    matrix = observation.basis @ inverse
    matrix[(observation.basis[:, unknown] != 0).any(axis=1)] = np.nan
    return np.asarray(matrix)
