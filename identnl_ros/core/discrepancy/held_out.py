# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How far a simulation is from data that it was not fitted to, before and after."""

from dataclasses import dataclass

from identnl_ros.core.discrepancy.comparison import Comparison
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.force_error import force_error, ForceError
from identnl_ros.core.discrepancy.settled_model import settled
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class HeldOutError:
    """
    Error of a re-simulation, its initial state alone fitted.

    Parameters
    ----------
    response : float
        Root mean square over the sensors of error over signal [-].
    noise_floor : float
        The same of the sensors' noise: no model can do better [-].
    channels : dict of str to (float, float, float)
        Of every sensor: error, noise, signal [SI unit].
    time : ndarray, shape (n_samples,)
        [s].
    measured, simulated : dict of str to ndarray, shape (n_samples,)
        [SI unit]; NaN: no valid reading.
    kinds : dict of str to SensorKind
        Of every sensor.
    force : ForceError
        What the equations of motion leave unexplained.

    """

    response: float
    noise_floor: float
    channels: dict[str, tuple[float, float, float]]
    time: Reals
    measured: dict[str, Reals]
    simulated: dict[str, Reals]
    kinds: dict[str, SensorKind]
    force: ForceError


def held_out_error(description: Description, model: Model, record: MeasuredRecord) -> HeldOutError:
    """
    Re-simulate a record under its measured force.

    Parameters
    ----------
    description : Description
        Its layout is that of the record.
    model : Model
        All values known.
    record : MeasuredRecord

    Returns
    -------
    HeldOutError

    Raises
    ------
    MachineError
        If the motion grows without bound.

    """
    fitted = settled(description, model, record, held=True, passes=3)
    comparison = Comparison(description, model, record, fitted.state, earlier=fitted.comparison)
    if comparison.failed:
        raise MachineError(f'machine {model.machine.name}: the simulation does not stay bounded')
    error, valid = comparison.simulated_error()
    channels, shares, floors = {}, [], []
    for i, sensor in enumerate(comparison.sensors):
        used = valid[:, i]
        if not used.any():
            continue
        signal = float(np.std(comparison.measured[used, i]))
        size = float(np.sqrt(np.mean(error[used, i] ** 2)))
        noise = float(comparison.deviation[i])
        channels[sensor.name] = size, noise, signal
        if signal > 0:
            shares.append((size / signal) ** 2)
            floors.append((noise / signal) ** 2)
    names = [sensor.name for sensor in comparison.sensors]
    return HeldOutError(
        float(np.sqrt(np.mean(shares))),
        float(np.sqrt(np.mean(floors))),
        channels,
        np.arange(len(error)) / record.sample_rate,
        dict(zip(names, np.where(valid, comparison.measured, np.nan).T, strict=True)),
        dict(zip(names, (comparison.measured - error).T, strict=True)),
        {sensor.name: sensor.kind for sensor in comparison.sensors},
        force_error(comparison),
    )
