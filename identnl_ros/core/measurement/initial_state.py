# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The state in which a stretch of a record begins, to start a fit from."""

from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_record import MARGIN, MeasuredRecord
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.measurement.sensor_prediction import MOTION_KINDS
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import Signal
import numpy as np
from numpy.typing import NDArray

# Degree of the polynomial through the first samples that gives the initial state.
START_DEGREE = 5
# Weight of least elastic energy against readings in the initial state.
HELD = 1e-5


def initial_state(
    model: Model, record: MeasuredRecord, signals: tuple[Signal, ...], place: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Estimate the state at a sample from those around it.

    What the sensors do not see follows what they see and the force as slow motion does: with the
    least elastic energy.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord
    signals : tuple of Signal
        The measured forces, on the clock of the record.
    place : int
        The sample.

    Returns
    -------
    displacement, velocity : ndarray, shape (n_coordinates,)

    """
    try:
        rest = static_equilibrium(model)
    except MachineError:
        rest = np.zeros(len(model.coordinates))
    rows, readings = _readings_at(model, record, place)
    squares, shapes = np.linalg.eigh(model.tangent_stiffness(rest))
    root = shapes * np.sqrt(np.maximum(squares, 0.0))
    energy = root.T / max(float(np.abs(root).max()), np.finfo(float).tiny)
    interval = 1 / record.sample_rate
    result = []
    forces = np.array([one.on_grid((place - 1) * interval, interval, 3) for one in signals])
    forces = forces.reshape(-1, 3)
    for order, (loads, centre) in enumerate(
        ((forces[:, 1], rest), ((forces[:, 2] - forces[:, 0]) / (2 * interval), 0 * rest))
    ):
        inverse = np.linalg.pinv(model.tangent_stiffness(rest), rcond=1e-9, hermitian=True)
        slow = centre + inverse @ (loads @ model.excitation_directions)
        left = np.vstack((rows[order], HELD * energy))
        right = np.concatenate((readings[order] - rows[order] @ slow, np.zeros(len(rest))))
        result.append(slow + np.linalg.lstsq(left, right, rcond=1e-13)[0])
    return result[0], result[1]


def _readings_at(
    model: Model, record: MeasuredRecord, place: int
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Smooth what is seen of displacement and velocity at a sample; rows and readings."""
    rows = [np.empty((0, len(model.coordinates)))] * 2
    readings = [np.empty(0)] * 2
    for kind in MOTION_KINDS[:2]:
        for channel in record.layout.of_kind(kind):
            sensor = record.layout.sensors[channel]
            # The reading at a later sample shows the motion now.
            begin = max(0, place + round(sensor.delay * record.sample_rate) - MARGIN)
            samples = record.samples[begin : begin + 2 * MARGIN + 1, channel]
            time = np.arange(begin, begin + len(samples)) - place
            valid = np.isfinite(samples)
            if valid.sum() <= 2 * START_DEGREE:
                continue
            fit = np.polynomial.Polynomial.fit(
                time[valid] / record.sample_rate - sensor.delay, samples[valid], START_DEGREE
            )
            row = sensor_matrix(model, (sensor,))
            values = [fit(0.0), fit.deriv()(0.0)]
            if kind is SensorKind.VELOCITY:
                values = values[:1]
            for order, value in enumerate(values, MOTION_KINDS.index(kind)):
                rows[order] = np.vstack((rows[order], row))
                readings[order] = np.append(readings[order], value)
    return rows, readings
