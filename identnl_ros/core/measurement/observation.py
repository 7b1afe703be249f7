# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""From the sensors of one kind to the generalised coordinates: what a layout sees, how well."""

from dataclasses import dataclass

from identnl_ros.core.errors import LayoutError, MachineError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.mechanics.joints import GROUND
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

# Singular values of the column-scaled sensor matrix below this are geometry, not rounding.
SEEING_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Observation:
    """
    Weighted least-squares map from one kind of sensor to the coordinates.

    Parameters
    ----------
    channels : tuple of int
        Columns of the sample block that are used.
    matrix : ndarray, shape (n_coordinates, n_channels)
        Coordinates = matrix @ readings; rows of coordinates not seen are meaningless.
    seen : ndarray, shape (n_coordinates, n_coordinates)
        Projector on the motions that these sensors determine.
    unseen : tuple of str
        Coordinates, in words, that these sensors do not determine.
    rows : ndarray, shape (n_channels, n_unknowns)
        Readings per unit of what is fitted to them: coordinates, or forces of the exciters.
    weights : ndarray, shape (n_channels,)
        Of the readings in the fit.
    basis : ndarray, shape (n_coordinates, n_unknowns)
        Coordinates, or generalised force, per unit of what is fitted.

    """

    channels: tuple[int, ...]
    matrix: NDArray[np.float64]
    seen: NDArray[np.float64]
    unseen: tuple[str, ...]
    rows: NDArray[np.float64]
    weights: NDArray[np.float64]
    basis: NDArray[np.float64]

    def covariance(self, variance: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Propagate the variance of the readings to the coordinates.

        Parameters
        ----------
        variance : ndarray, shape (n_sensors_of_layout,)
            Of one reading of every sensor of the layout.

        Returns
        -------
        ndarray, shape (n_coordinates, n_coordinates)
            Of one sample.

        """
        return (self.matrix * variance[list(self.channels)]) @ self.matrix.T


def sensor_matrix(model: Model, sensors: tuple[Sensor, ...]) -> NDArray[np.float64]:
    """
    Find the readings per unit of every coordinate: s = H q.

    Parameters
    ----------
    model : Model
    sensors : tuple of Sensor
        Sensors of motion.

    Returns
    -------
    ndarray, shape (n_sensors, n_coordinates)

    Raises
    ------
    LayoutError
        If a sensor sits on the ground or on a body that the machine does not have.

    """
    rows = np.zeros((len(sensors), len(model.coordinates)))
    for row, sensor in zip(rows, sensors, strict=True):
        if sensor.body == GROUND:
            raise LayoutError(
                f'sensor {sensor.name}: sits on the ground, which does not move; '
                'name the moving body first and the ground as the reference'
            )
        try:
            row += model.motion_of_point(sensor.body, sensor.point, sensor.direction)
            if sensor.reference_body:
                row -= model.motion_of_point(sensor.reference_body, sensor.point, sensor.direction)
        except MachineError as error:
            raise LayoutError(f'sensor {sensor.name}: {error}') from None
    return rows


def observe_motion(model: Model, layout: Layout, kind: SensorKind) -> Observation:
    """
    Map the sensors of one kind of motion to the coordinates (step II of the paper).

    Parameters
    ----------
    model : Model
    layout : Layout
    kind : SensorKind
        Displacement, velocity or acceleration.

    Returns
    -------
    Observation

    Raises
    ------
    LayoutError
        If a sensor's body does not exist or noises are stated inconsistently.

    """
    channels = layout.of_kind(kind)
    sensors = tuple(layout.sensors[channel] for channel in channels)
    rows = sensor_matrix(model, sensors)
    weights = _weights(sensors, kind)
    unseen = _unseen(rows, model)
    # Scale rows by the noise, columns to unit length: metres and radians on one footing.
    scaled = rows * weights[:, np.newaxis]
    lengths = np.linalg.norm(scaled, axis=0)
    lengths[lengths == 0] = 1.0
    inverse = np.linalg.pinv(scaled / lengths, rcond=SEEING_TOLERANCE)
    matrix = inverse / lengths[:, np.newaxis] * weights
    basis = np.eye(rows.shape[1])
    return Observation(channels, matrix, matrix @ rows, unseen, rows, weights, basis)


def observe_force(model: Model, layout: Layout) -> Observation:
    """
    Map the force sensors to the generalised force.

    Parameters
    ----------
    model : Model
    layout : Layout

    Returns
    -------
    Observation
        Its matrix gives the generalised force of all exciters.

    Raises
    ------
    LayoutError
        If an excitation has no force sensor, or a force sensor no excitation.

    """
    channels = layout.of_kind(SensorKind.FORCE)
    sensors = tuple(layout.sensors[channel] for channel in channels)
    weights = _weights(sensors, SensorKind.FORCE)
    names = [point.name for point in model.machine.excitations]
    for sensor in sensors:
        if sensor.excitation not in names:
            raise LayoutError(
                f'sensor {sensor.name}: measures excitation "{sensor.excitation}", which machine '
                f'{model.machine.name} does not have; it has {", ".join(names) or "none"}'
            )
    matrix = np.zeros((len(model.coordinates), len(channels)))
    for name, direction in zip(names, model.excitation_directions, strict=True):
        share = np.array(
            [
                weight**2 if sensor.excitation == name else 0.0
                for weight, sensor in zip(weights, sensors, strict=True)
            ]
        )
        if not share.any():
            raise LayoutError(
                f'layout: no force sensor measures excitation "{name}" of machine '
                f'{model.machine.name}; add one, or remove the excitation from the machine file'
            )
        matrix += np.outer(direction, share / share.sum())
    rows = np.array([[float(sensor.excitation == name) for name in names] for sensor in sensors])
    basis = np.asarray(model.excitation_directions).T
    rows = rows.reshape(len(sensors), len(names))
    return Observation(channels, matrix, np.eye(len(matrix)), (), rows, weights, basis)


def _weights(sensors: tuple[Sensor, ...], kind: SensorKind) -> NDArray[np.float64]:
    """Weigh sensors by their noise; alike where noise is not stated or there is none."""
    noise = np.array([sensor.noise for sensor in sensors])
    if np.isnan(noise).any() or not noise.any():
        return np.ones(len(sensors))
    silent = [sensor.name for sensor in sensors if sensor.noise == 0]
    if silent:
        raise LayoutError(
            f'sensor {silent[0]}: noise is 0 while other {kind.value} sensors have some; '
            'state the noise of every sensor of a kind, or of none'
        )
    return np.asarray(noise.min() / noise)


def _unseen(rows: NDArray[np.float64], model: Model) -> tuple[str, ...]:
    """Coordinates that take part in motions which leave every reading at zero."""
    lengths = np.linalg.norm(rows, axis=0)
    blind = lengths <= SEEING_TOLERANCE * max(lengths.max(initial=0.0), 1.0)
    lengths[blind] = 1.0
    scaled = np.where(blind, 0.0, rows / lengths)
    _, values, right = np.linalg.svd(scaled, full_matrices=True)
    rank = int((values > SEEING_TOLERANCE * max(values.max(initial=0.0), 1.0)).sum())
    participation = np.linalg.norm(right[rank:], axis=0)
    return tuple(
        coordinate.in_words
        for coordinate, share in zip(model.coordinates, participation, strict=True)
        if share > 1e-6
    )
