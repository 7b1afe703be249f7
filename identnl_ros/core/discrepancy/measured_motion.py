# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
The motion that all sensors have measured together, with as little of their noise as possible.

What the readings differ from the simulation by is taken for the response of the machine to a
force that its model lacks. Line by line of the spectrum the most probable such force is found,
if before the measurement all directions and lines are alike and of a given strength. So every
line comes from the sensors that know it best, nothing is differentiated numerically, and what
noise hides stays as simulated. The map is linear and does not depend on the readings: noise can
be sent through it to see what it does.
"""

from typing import Any

from identnl_ros.core.discrepancy.comparison import Comparison
from identnl_ros.core.discrepancy.nominal_motion import NominalMotion
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.measurement.sensor_prediction import MOTION_KINDS
import numpy as np
from numpy.typing import NDArray
from scipy import fft

Reals = NDArray[np.float64]

# Part of the record at each end over which deviations fade in and out, and that is left out.
FADE = 0.02


class MeasuredMotion:
    """
    The map from deviations of the readings to a motion.

    The machine responds as it does about its mean position; means are left as simulated.

    Parameters
    ----------
    comparison : Comparison
        Of a record with a model, simulated from its initial state.
    strength : float
        Of a force that may be missing: root mean square over time and coordinates, each over the
        root of its mass or moment of inertia [N/kg^0.5].

    """

    def __init__(self, comparison: Comparison, strength: float) -> None:
        model = comparison.model
        self._count = len(comparison.measured)
        self._simulated = comparison.simulated
        self._rate = 2j * np.pi * fft.rfftfreq(self._count, 1 / comparison.rate)[1:]
        rate = self._rate[:, np.newaxis, np.newaxis]
        self._compliance = np.linalg.inv(
            np.diag(model.mass_diagonal()) * rate**2
            + model.damping_matrix() * rate
            + model.tangent_stiffness(comparison.simulated.displacement.mean(axis=0))
        )
        orders = [MOTION_KINDS.index(one.kind) for one in comparison.sensors]
        self._orders = np.array(orders)[:, np.newaxis]
        self._rows = sensor_matrix(model, tuple(comparison.sensors))
        noise = comparison.deviation
        motion = self._compliance * (strength * np.sqrt(model.mass_diagonal()))
        self._tilt = comparison.tilt
        response = self._response(rate, motion) / noise[:, np.newaxis]
        adjoint = response.conj().transpose(0, 2, 1)
        size = len(model.coordinates)
        self._map = motion @ np.linalg.solve(adjoint @ response + np.eye(size), adjoint) / noise

    @property
    def whole(self) -> slice:
        """Samples at which deviations count in full."""
        edge = 1 + int(FADE * self._count)
        return slice(edge, self._count - edge)

    def along(self, deviation: Reals) -> NominalMotion:
        """
        Find the motion.

        Parameters
        ----------
        deviation : ndarray, shape (n_samples, n_motion_sensors)
            Of the readings from the simulated ones [SI]; 0 where not valid.

        Returns
        -------
        NominalMotion

        """
        lines = fft.rfft(deviation * self._fading()[:, np.newaxis], axis=0)[1:]
        lines = (self._map @ lines[:, :, np.newaxis])[:, :, 0]
        simulated = self._simulated
        series = simulated.displacement, simulated.velocity, simulated.acceleration
        return NominalMotion(
            *(
                one[: self._count] + self._in_time(lines * self._rate[:, np.newaxis] ** order)
                for order, one in enumerate(series)
            )
        )

    def readings(self, force: Reals) -> Reals:
        """
        Tell what a force adds to the readings, to first order.

        Parameters
        ----------
        force : ndarray, shape (n_samples, n_coordinates)
            [N, N m].

        Returns
        -------
        ndarray, shape (n_samples, n_motion_sensors)
            [SI].

        """
        lines = fft.rfft(force, axis=0)[1:]
        motion = self._compliance @ lines[:, :, np.newaxis]
        rate = self._rate[:, np.newaxis, np.newaxis]
        return self._in_time(self._response(rate, motion)[:, :, 0])

    def _response(self, rate: NDArray[Any], motion: NDArray[Any]) -> NDArray[np.complex128]:
        """Read a motion given line by line."""
        return np.asarray(rate**self._orders * (self._rows @ motion) + self._tilt @ motion)

    def _in_time(self, lines: NDArray[np.complex128]) -> Reals:
        return np.asarray(fft.irfft(np.pad(lines, ((1, 0), (0, 0))), self._count, axis=0))

    def _fading(self) -> Reals:
        edge = max(int(FADE * self._count), 1)
        rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
        return np.concatenate((rise, np.ones(self._count - 2 * edge), rise[::-1]))
