# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What a planned run would tell of the unknowns: Fisher's information, the Cramer-Rao bound.

No unbiased estimate from the same run is more exact; a maximum-likelihood fit comes up to it.
"""

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.design.planned_run import PlannedRun
from identnl_ros.core.likelihood.nuisance import RecordInformation, with_many_rows
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.sensor_unknown import SensorUnknown
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.sensitivity import STEP_LIMIT
import numpy as np


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
    run = PlannedRun(
        model, layout, signals, sample_rate, duration, settling, sensor_unknowns, step_limit
    )
    information = Information.empty(run.size)
    for derivatives in run.weighted_derivatives():
        rows = derivatives.reshape(-1, run.size)
        information = with_many_rows(information, rows, np.zeros(len(rows)))
    return RecordInformation(information, run.n_own).marginal()
