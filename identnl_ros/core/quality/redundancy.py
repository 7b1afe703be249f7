# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the sensors of a layout have in common: which channel can be checked against which."""

from dataclasses import dataclass
from functools import cached_property

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.quality.leave_one_out import Flags, leave_one_out, Reals
from identnl_ros.core.simulation.stand import MOTION_KINDS
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

# Of a prediction, on one footing; less is rounding.
LINKED = 1e-6
# Evidence against one of two channels within this share is no reason to prefer one: directions
# of their effects on the readings that differ by 6 degrees are those of an inexact layout.
EQUAL_SHARE = 0.01


@dataclass(frozen=True)
class Redundancy:
    """
    Readings of all channels as accelerations of the bodies and forces of the exciters.

    Parameters
    ----------
    rows : ndarray, shape (n_channels, n_unknowns)
        Readings per unit of every coordinate's acceleration, then of every exciter's force.
    nearby : ndarray, shape (3, n_channels, n_unknowns)
        Readings along the sensor's direction and two others at right angles to it.
    orders : ndarray of int, shape (n_channels,)
        Derivatives that make an acceleration of the reading; 0 for forces.
    kinds : ndarray of int, shape (n_channels,)
        Equal for channels of one kind.

    """

    rows: Reals
    nearby: Reals
    orders: NDArray[np.int64]
    kinds: NDArray[np.int64]

    @cached_property
    def sets(self) -> NDArray[np.int64]:
        """Sets of channels that check each other, as `groups` numbers them."""
        return self.groups(self.rows)

    def groups(self, rows: Reals) -> NDArray[np.int64]:
        """
        Give each set of channels that check each other a number.

        Parameters
        ----------
        rows : ndarray, shape (n_channels, n_unknowns)

        Returns
        -------
        ndarray of int, shape (n_channels,)
            Equal for channels of one set; a channel that nothing checks is a set of its own.

        """
        return np.asarray(connected_components(self.links(rows), directed=False)[1])

    def links(self, rows: Reals) -> Flags:
        """
        Tell which channels take part in the prediction of which.

        Parameters
        ----------
        rows : ndarray, shape (n_channels, n_unknowns)

        Returns
        -------
        ndarray of bool, shape (n_channels, n_channels)

        """
        ones = np.ones((1, len(rows)))
        found = leave_one_out(rows, ones, np.ones(len(rows), dtype=np.bool_))
        linked = np.abs(found.errors[0]) > LINKED
        np.fill_diagonal(linked, False)
        return np.asarray(linked & found.told & found.told[:, np.newaxis])

    def by_kind(self, rows: Reals) -> Reals:
        """
        Give every kind unknowns of its own, so that kinds do not check each other.

        Parameters
        ----------
        rows : ndarray, shape (n_channels, n_unknowns)

        Returns
        -------
        ndarray, shape (n_channels, n_kinds * n_unknowns)

        """
        kinds = np.unique(self.kinds)
        blocks = [np.where((self.kinds == one)[:, np.newaxis], rows, 0.0) for one in kinds]
        return np.concatenate(blocks, axis=1)


@dataclass(frozen=True)
class Suspect:
    """
    A channel that has something the others do not.

    Parameters
    ----------
    size : float
    rivals : tuple of int
        Channels that it could be in as well.

    """

    size: float
    rivals: tuple[int, ...]


def redundancy(model: Model, layout: Layout) -> Redundancy:
    """
    Work out the readings of a layout.

    Parameters
    ----------
    model : Model
    layout : Layout

    Returns
    -------
    Redundancy

    Raises
    ------
    LayoutError
        If a sensor does not fit the machine.

    """
    sensors = layout.sensors
    count = len(model.coordinates)
    points = {point.name: point for point in model.machine.excitations}
    nearby = np.zeros((3, len(sensors), count + len(points)))
    for i, sensor in enumerate(sensors):
        if sensor.kind is not SensorKind.FORCE:
            for k, direction in enumerate(_three(sensor.direction)):
                turned = Sensor('', sensor.kind, sensor.body, sensor.point, direction,
                                sensor.reference_body)  # fmt: skip
                nearby[k, i, :count] = sensor_matrix(model, (sensor if k == 0 else turned,))[0]
            continue
        if sensor.excitation not in points:
            raise LayoutError(
                f'sensor {sensor.name}: measures excitation "{sensor.excitation}", which machine '
                f'{model.machine.name} does not have; it has {", ".join(points) or "none"}'
            )
        point = points[sensor.excitation]
        nearby[0, i, count + list(points).index(sensor.excitation)] = 1.0
        if sensor.front_mass:
            # The cell also accelerates what is in front of it.
            row = model.motion_of_point(point.body, point.point, point.direction)
            nearby[0, i, :count] = sensor.front_mass * row
    kinds = np.array([list(SensorKind).index(one.kind) for one in sensors])
    orders = np.array(
        [2 - MOTION_KINDS.index(one.kind) if one.kind in MOTION_KINDS else 0 for one in sensors]
    )
    return Redundancy(nearby[0], nearby, orders, kinds)


def _three(direction: Reals) -> Reals:
    """Complete a direction to three at right angles."""
    _, _, right = np.linalg.svd(direction[np.newaxis])
    return np.stack((direction, right[1], right[2]))


def most_suspect(
    weight: Reals, shown: Flags, groups: NDArray[np.int64]
) -> dict[int, tuple[int, ...]]:
    """
    Find the channel of every group with the largest evidence, and those that have nearly as much.

    Parameters
    ----------
    weight : ndarray, shape (n_channels,)
        Drop of the misfit if the channel is left out.
    shown : ndarray of bool, shape (n_channels,)
        Channels to choose from; rivals need not be among them.
    groups : ndarray of int, shape (n_channels,)

    Returns
    -------
    dict of int to tuple of int

    """
    result = {}
    for group in np.unique(groups[shown]):
        best = int(np.argmax(np.where((groups == group) & shown, weight, -np.inf)))
        near = np.flatnonzero((groups == group) & (weight > (1 - EQUAL_SHARE) * weight[best]))
        result[best] = tuple(int(one) for one in near if one != best)
    return result
