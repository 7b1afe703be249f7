# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Where the fit of a model to a record starts, whatever is wrong with some of the sensors."""

from dataclasses import replace

from identnl_ros.core.discrepancy.consistent_motion import consistent_motion
from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord, standard_deviations
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.elements import Element
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.weak.rough_start import rough_start
import numpy as np


def start_values(machine: Machine, record: MeasuredRecord) -> Model:
    """
    Take start values from the data where possible, else from the machine.

    Parameters
    ----------
    machine : Machine
    record : MeasuredRecord

    Returns
    -------
    Model

    Raises
    ------
    MachineError
        If neither has them.

    """
    model = assemble(machine)
    known = bool(np.isfinite(model.values).all())
    elements = any(isinstance(joint, Element) for joint in machine.joints)
    # Weak-form windows need forces that are linear in the rate; values that stand beside friction
    # are those of an earlier fit.
    if not model.estimated or (known and (elements or model.time_dependent)):
        return model
    try:
        return rough_start(model, _trusted(model, record))
    except (DataError, LayoutError):
        model.require_values()
        return model


def _trusted(model: Model, record: MeasuredRecord) -> MeasuredRecord:
    """Leave out displacement sensors that contradict the others."""
    sensors = record.layout.sensors
    places = [i for i, one in enumerate(sensors) if one.kind is SensorKind.DISPLACEMENT]
    readings = record.samples[:, places]
    noise = standard_deviations(record)[places]
    valid = np.isfinite(readings).all(axis=1)
    if not places or not np.all(noise > 0) or not valid.any():
        return record
    readings = readings[valid] - readings[valid].mean(axis=0)
    rows = sensor_matrix(model, tuple(sensors[i] for i in places))
    matrix, _ = consistent_motion(readings, rows, noise)
    left_out = {place for i, place in enumerate(places) if not matrix[:, i].any()}
    kept = [i for i in range(len(sensors)) if i not in left_out]
    layout = replace(record.layout, sensors=tuple(sensors[i] for i in kept))
    return replace(record, layout=layout, samples=record.samples[:, kept])
