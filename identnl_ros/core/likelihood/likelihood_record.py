# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A measured record, made ready for a likelihood fit: forces, noise, valid samples."""

from dataclasses import dataclass, replace

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.added_reading import has_front_mass
from identnl_ros.core.measurement.initial_state import initial_state
from identnl_ros.core.measurement.measured_force import measured_forces
from identnl_ros.core.measurement.measured_record import (
    MARGIN,
    MeasuredRecord,
    standard_deviations,
)
from identnl_ros.core.measurement.sensor_prediction import HALF_WIDTH, SensorPrediction
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import Signal
import numpy as np
from numpy.typing import NDArray

# An unknown delay may turn out this many samples away from the stated one.
DELAY_ALLOWANCE = 10
# Standard deviation given to sensors without noise, as a fraction of what they show.
PERFECT = 1e-9


@dataclass(frozen=True)
class PreparedRecord:
    """
    A stretch of a record with all that a fit needs of it.

    Parameters
    ----------
    prediction : SensorPrediction
    signals : tuple of Signal
        Measured forces.
    sample_rate : float
        [Hz].
    first : int
        Sample of the record at which the simulation begins.
    measured : ndarray, shape (n_samples, n_motion_channels)
        From there on; 0 where not valid.
    weights : ndarray, shape (n_samples, n_motion_channels)
        1 / standard deviation; 0 where not valid.
    initial_displacement, initial_velocity : ndarray, shape (n_coordinates,)
        From the first samples.
    origin : float
        Time of the first sample of the record since the begin of the stream [s].

    """

    prediction: SensorPrediction
    signals: tuple[Signal, ...]
    sample_rate: float
    first: int
    measured: NDArray[np.float64]
    weights: NDArray[np.float64]
    initial_displacement: NDArray[np.float64]
    initial_velocity: NDArray[np.float64]
    origin: float

    @property
    def valid(self) -> int:
        """Number of valid readings."""
        return int(np.count_nonzero(self.weights))


def prepare(model: Model, record: MeasuredRecord, prediction: SensorPrediction) -> PreparedRecord:
    """
    Make a record ready for the fit.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord
    prediction : SensorPrediction
        Of the record's layout and sample rate.

    Returns
    -------
    PreparedRecord

    Raises
    ------
    LayoutError
        If a force is not measured, or some sensors have no noise while others have.
    DataError
        If a force has holes.

    """
    channels = list(prediction.channels)
    sensors = record.layout.sensors
    # A mass in front of a cell brings the motion sensors into the force.
    front = has_front_mass(record.layout)
    late = max((abs(one.delay) for one in sensors if one.excitation or front), default=0.0)
    margin = MARGIN + int(np.ceil(late * record.sample_rate))
    measured = record.samples[margin : len(record.samples) - margin, channels]
    deviation = standard_deviations(record)[channels]
    deviation[np.isnan(deviation)] = np.inf  # no samples to estimate it from
    silent = deviation == 0
    if silent.any() and not silent.all():
        name = sensors[channels[int(np.argmax(silent))]].name
        raise LayoutError(
            f'sensor {name}: noise is 0 while other sensors have some; '
            'state the noise of every sensor, or of none'
        )
    if silent.any():
        at_rest, _ = prediction.gravity.among(len(channels))
        deviation = PERFECT * _typical(record, channels, at_rest)
    weights = np.where(np.isfinite(measured), 1 / deviation, 0.0)
    prepared = PreparedRecord(
        prediction, measured_forces(model, record), record.sample_rate, margin,
        np.where(weights > 0, measured, 0.0), weights,
        np.zeros(len(model.coordinates)), np.zeros(len(model.coordinates)), record.origin,
    )  # fmt: skip
    return stretch(model, record, prepared, 0, len(measured))


def stretch(
    model: Model, record: MeasuredRecord, whole: PreparedRecord, begin: int, end: int
) -> PreparedRecord:
    """
    Cut a piece out of a prepared record.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord
    whole : PreparedRecord
    begin, end : int
        Samples of the prepared record.

    Returns
    -------
    PreparedRecord
        With an initial state of its own.

    """
    weights = whole.weights[begin:end].copy()
    prediction = whole.prediction
    allowance = HALF_WIDTH + DELAY_ALLOWANCE
    for i in np.flatnonzero(prediction.moved):
        delay = prediction.stated_delays[i]
        weights[: max(0, int(np.ceil(delay)) + allowance), i] = 0.0
        weights[len(weights) - max(0, int(np.ceil(-delay)) + allowance) :, i] = 0.0
    displacement, velocity = initial_state(model, record, whole.signals, whole.first + begin)
    return replace(
        whole,
        first=whole.first + begin,
        measured=whole.measured[begin:end],
        weights=weights,
        initial_displacement=displacement,
        initial_velocity=velocity,
    )


def _typical(
    record: MeasuredRecord, channels: list[int], at_rest: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Root mean square of the motion that every channel's kind shows; 1 where nothing."""
    kinds = [record.layout.sensors[i].kind for i in channels]
    squares = np.nanmean((record.samples[:, channels] - at_rest) ** 2, axis=0)
    result = np.empty(len(channels))
    for kind in set(kinds):
        own = np.array([one is kind for one in kinds])
        result[own] = np.sqrt(np.nanmean(squares[own]))
    result[~(result > 0)] = 1.0
    return result
