# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The force of every exciter from the cells that measure it."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.layout import Sensor
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.point_acceleration import acceleration_of, AccelerationShare
from identnl_ros.core.measurement.short_gaps import bridged, LONGEST_GAP
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import RecordedForce, Signal
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class WeightedSum:
    """
    Weighted sum of measured series, their delays taken out.

    Parameters
    ----------
    series : tuple of RecordedForce
    weights : tuple of float
        [N per unit of the series].
    delays : tuple of float
        [s].

    """

    series: tuple[RecordedForce, ...]
    weights: tuple[float, ...]
    delays: tuple[float, ...]

    def on_grid(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        """Evaluate at equally spaced instants (see `Signal`)."""
        total = np.zeros(count)
        for one, weight, delay in zip(self.series, self.weights, self.delays, strict=True):
            total += weight * one.on_grid(start + delay, step, count)
        return total


def measured_forces(model: Model, record: MeasuredRecord) -> tuple[Signal, ...]:
    """
    Take the forces of all exciters from the force sensors.

    What a cell reads of a mass in front of it is taken out with the acceleration of the point at
    which the exciter acts, as the sensors of motion tell it.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord

    Returns
    -------
    tuple of Signal
        One for every excitation point.

    Raises
    ------
    LayoutError
        If no sensor measures an excitation, or none the acceleration of a mass in front.
    DataError
        If the force, or that acceleration, is not known for longer than a few samples.

    """
    sensors = record.layout.sensors
    signals = []
    for point in model.machine.excitations:
        channels = [i for i, sensor in enumerate(sensors) if sensor.excitation == point.name]
        if not channels:
            raise LayoutError(
                f'layout: no force sensor measures excitation "{point.name}" of machine '
                f'{model.machine.name}; add one, or remove the excitation from the machine file'
            )
        filled = {i: bridged(record.samples[:, i]) for i in channels}
        whole = {i: one for i, one in filled.items() if np.isfinite(one).all()}
        if not whole:
            lost = int(np.argmax(np.isnan(next(iter(filled.values())))))
            raise DataError(
                f'record: the force of excitation "{point.name}" is not known for more than '
                f'{LONGEST_GAP} samples from sample {lost} on; cut the record there'
            )
        weights = cell_weights([sensors[i] for i in whole])
        mass = float(weights @ [sensors[i].front_mass for i in whole])
        shares: list[AccelerationShare] = acceleration_of(model, record, point) if mass else []
        signals.append(
            WeightedSum(
                tuple(
                    RecordedForce(one, record.sample_rate)
                    for one in (*whole.values(), *(share.samples for share in shares))
                ),
                (*weights.tolist(), *[-mass] * len(shares)),
                (*(sensors[i].delay for i in whole), *(share.delay for share in shares)),
            )
        )
    return tuple(signals)


def cell_weights(cells: Sequence[Sensor]) -> NDArray[np.float64]:
    """
    Weigh the cells that measure one force by their noise; alike where it is not stated.

    Parameters
    ----------
    cells : sequence of Sensor

    Returns
    -------
    ndarray, shape (n_cells,)
        Their sum is one.

    """
    noise = np.array([cell.noise for cell in cells])
    weights = 1 / noise**2 if np.all(noise > 0) else np.ones(len(noise))
    return np.asarray(weights / weights.sum())
