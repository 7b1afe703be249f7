# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What a planned run would tell of the unknowns: Fisher's information, the Cramer-Rao bound.

No unbiased estimate from the same run is more exact; a maximum-likelihood fit comes up to it.
"""

from identnl_ros.core.equilibrium import static_equilibrium
from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.excitation import Signal
from identnl_ros.core.information import Information
from identnl_ros.core.layout import Layout
from identnl_ros.core.model import Model
from identnl_ros.core.nuisance import RecordInformation, with_many_rows
from identnl_ros.core.sensitivity import CHUNK, STEP_LIMIT, VariedSimulation
from identnl_ros.core.sensor_prediction import HALF_WIDTH, SensorPrediction
from identnl_ros.core.sensor_unknown import SensorUnknown
import numpy as np
from numpy.typing import NDArray


def expected_information(
    model: Model,
    layout: Layout,
    signals: tuple[Signal, ...],
    sample_rate: float,
    duration: float,
    settling: float = 0.0,
    sensor_unknowns: tuple[SensorUnknown, ...] = (),
    step_limit: float = STEP_LIMIT,
) -> Information:
    """
    Predict the information of a run that has not been made.

    The initial state is an unknown too, eliminated here; the force is exact. Memory does not
    grow with the duration.

    Parameters
    ----------
    model : Model
        The values expected.
    layout : Layout
        With the noise of every sensor of motion.
    signals : tuple of Signal
        Force of every excitation point.
    sample_rate : float
        [Hz].
    duration : float
        Of the samples used [s].
    settling : float
        From rest to the first sample used [s].
    sensor_unknowns : tuple of SensorUnknown
        To be estimated as well.
    step_limit : float
        Integration step times fastest eigenvalue [-].

    Returns
    -------
    Information
        On the model's unknowns, then the sensors'. Its ``solve().inverse`` is the smallest
        covariance, ``solve().null_space`` what the run cannot tell; runs add up by ``merged``.

    Raises
    ------
    DataError
        If there would be fewer than two samples.
    LayoutError
        If a noise is not stated, or a sensor does not fit the machine.
    MachineError
        If a value is missing or the motion grows without bound.

    """
    count = round(duration * sample_rate)
    if count < 2:
        raise DataError(
            f'planned run: {duration:g} s at {sample_rate:g} Hz are {count} samples, '
            'expected at least two'
        )
    prediction = SensorPrediction(model, layout, sample_rate, sensor_unknowns)
    deviation = _noise(layout, prediction)
    rest = static_equilibrium(model)
    simulation = VariedSimulation(
        model, signals, 1 / sample_rate, rest, np.zeros_like(rest),
        step_limit=step_limit, sensitive=False,
    )  # fmt: skip
    settled = round(settling * sample_rate)
    for start in range(0, settled, CHUNK):
        simulation.advance(min(CHUNK, settled - start))
    simulation = VariedSimulation(
        model, signals, 1 / sample_rate, simulation.displacement, simulation.velocity,
        start=settled / sample_rate, step_limit=step_limit, steps=simulation.steps,
    )  # fmt: skip
    n_own = 2 * rest.size
    information = Information.empty(n_own + len(model.estimated) + len(sensor_unknowns))
    late = prediction.stated_delays
    first = np.where(prediction.moved, np.ceil(late) + HALF_WIDTH, 0)
    last = np.where(prediction.moved, count + np.floor(late) - HALF_WIDTH, count)
    for part in prediction.run(simulation, count, np.zeros(len(sensor_unknowns))):
        sample = np.arange(part.first, part.first + len(part.readings))[:, np.newaxis]
        weights = ((sample >= first) & (sample < last)) / deviation
        rows = (part.derivatives * weights[:, :, np.newaxis]).reshape(-1, information.size)
        information = with_many_rows(information, rows, np.zeros(len(rows)))
    return RecordInformation(information, n_own).marginal()


def _noise(layout: Layout, prediction: SensorPrediction) -> NDArray[np.float64]:
    sensors = [layout.sensors[channel] for channel in prediction.channels]
    for sensor in sensors:
        if not (sensor.noise > 0 or sensor.resolution > 0):
            raise LayoutError(
                f'sensor {sensor.name}: noise is {sensor.noise}, expected a positive number; '
                'how exact a run will be depends on the noise of every sensor'
            )
    return np.array(
        [np.hypot(np.nan_to_num(one.noise), one.resolution / np.sqrt(12)) for one in sensors]
    )
