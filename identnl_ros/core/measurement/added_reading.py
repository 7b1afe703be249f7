# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What sensors read beside their quantity: accelerometers gravity, force cells a mass in front."""

from dataclasses import dataclass

from identnl_ros.core.errors import LayoutError, MachineError
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.mechanics.kinematics import body_motion
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

# Directions of gravity in the machine file and in the layout that differ by less are one [rad].
SAME_DIRECTION = 1e-3


@dataclass(frozen=True)
class AddedReading:
    """
    A part of some readings that is linear in a motion: ``constant + matrix @ motion``.

    Parameters
    ----------
    channels : ndarray, shape (n_channels,)
        Sensors that read it, by their place among all.
    constant : ndarray, shape (n_channels,)
        [SI unit of the sensors].
    matrix : ndarray, shape (n_channels, n_coordinates)
        Per unit of the coordinates, or of their accelerations.

    """

    channels: NDArray[np.intp]
    constant: NDArray[np.float64]
    matrix: NDArray[np.float64]

    def of(self, motion: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Evaluate the part along a motion.

        Parameters
        ----------
        motion : ndarray, shape (n_samples, n_coordinates)

        Returns
        -------
        ndarray, shape (n_samples, n_channels)

        """
        # What is not known of other bodies does not matter.
        used = self.matrix.any(axis=0)
        return np.asarray(self.constant + motion[..., used] @ self.matrix[:, used].T)

    def taken_out(
        self, readings: NDArray[np.float64], motion: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """
        Subtract the part from readings.

        Parameters
        ----------
        readings : ndarray, shape (n_samples, n_sensors)
            Of all sensors.
        motion : ndarray, shape (n_samples, n_coordinates)

        Returns
        -------
        ndarray, shape (n_samples, n_sensors)
            The same array where no sensor reads such a part.

        """
        if not len(self.channels):
            return readings
        result = readings.copy()
        result[:, self.channels] -= self.of(motion)
        return result

    def among(self, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Extend constant and matrix to all sensors.

        Parameters
        ----------
        count : int
            Number of sensors.

        Returns
        -------
        constant : ndarray, shape (count,)
        matrix : ndarray, shape (count, n_coordinates)

        """
        constant = np.zeros(count)
        matrix = np.zeros((count, self.matrix.shape[1]))
        constant[self.channels], matrix[self.channels] = self.constant, self.matrix
        return constant, matrix


def gravity_reading(
    model: Model, sensors: tuple[Sensor, ...], gravity: NDArray[np.float64]
) -> AddedReading:
    """
    Find what sensors of specific force read beside acceleration.

    Such a sensor reads ``n . (a - g)``. When its body turns by small angles theta, n becomes
    n + theta x n. So it reads -n . g at rest and, to first order, -(theta x n) . g beside
    acceleration, which is linear in the coordinates.

    Parameters
    ----------
    model : Model
    sensors : tuple of Sensor
        Of any kind; those that do not read gravity have no such part.
    gravity : ndarray, shape (3,)
        Machine frame [m/s^2].

    Returns
    -------
    AddedReading
        Its motion is the displacement.

    Raises
    ------
    LayoutError
        If a sensor's body does not exist, or gravity points elsewhere than in the machine.

    """
    channels = [i for i, sensor in enumerate(sensors) if sensor.reads_gravity]
    if channels:
        _check_direction(model, gravity)
    tilt = np.zeros((len(channels), len(model.coordinates)))
    for row, sensor in zip(tilt, (sensors[i] for i in channels), strict=True):
        try:
            motion = body_motion(model.machine, model.coordinates, sensor.body, sensor.point)
        except MachineError as error:
            raise LayoutError(f'sensor {sensor.name}: {error}') from None
        row[:] = -np.cross(sensor.direction, gravity) @ motion[3:]
    constant = np.array([-sensors[i].direction @ gravity for i in channels])
    return AddedReading(np.array(channels, dtype=np.intp), constant, tilt)


def front_mass_reading(model: Model, sensors: tuple[Sensor, ...]) -> AddedReading:
    """
    Find what force cells read beside the force on the structure.

    The mass between sensing element and structure moves with the point at which the exciter acts
    on `ExcitationPoint.body`: the cell also reads the force that accelerates it along the
    direction of the exciter.

    Parameters
    ----------
    model : Model
    sensors : tuple of Sensor
        Of any kind; excitations that the machine does not have are passed over.

    Returns
    -------
    AddedReading
        Its motion is the acceleration.

    """
    points = {point.name: point for point in model.machine.excitations}
    channels = [
        i for i, sensor in enumerate(sensors) if sensor.front_mass and sensor.excitation in points
    ]
    matrix = np.zeros((len(channels), len(model.coordinates)))
    for row, sensor in zip(matrix, (sensors[i] for i in channels), strict=True):
        point = points[sensor.excitation]
        row[:] = sensor.front_mass * model.motion_of_point(
            point.body, point.point, point.direction
        )
    return AddedReading(np.array(channels, dtype=np.intp), np.zeros(len(channels)), matrix)


def has_front_mass(layout: Layout) -> bool:
    """
    Tell whether a force cell has a mass in front.

    Parameters
    ----------
    layout : Layout

    Returns
    -------
    bool

    """
    return any(sensor.front_mass for sensor in layout.sensors)


def _check_direction(model: Model, gravity: NDArray[np.float64]) -> None:
    """Refuse a layout whose gravity points elsewhere than the machine's."""
    other = model.machine.gravity
    if other is None or not other.any() or not gravity.any():
        return
    across = float(np.linalg.norm(np.cross(other, gravity)))
    if np.arctan2(across, float(other @ gravity)) > SAME_DIRECTION:
        raise LayoutError(
            f'layout: gravity is {_written(gravity)} m/s^2, but that of machine '
            f'{model.machine.name} is {_written(other)} m/s^2; both are in the machine frame: '
            'correct the key gravity of one'
        )


def _written(vector: NDArray[np.float64]) -> str:
    return f'[{", ".join(f"{number:g}" for number in vector)}]'
