# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The force of every exciter from the cells that measure it."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.layout import Sensor
from identnl_ros.core.measurement.measured_record import MARGIN, MeasuredRecord
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import RecordedForce, Signal
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

# So many lost samples of a force in a row are bridged.
LONGEST_GAP = 3


@dataclass(frozen=True)
class MeanForce:
    """
    Noise-weighted mean of the cells that measure one force, their delays taken out.

    Parameters
    ----------
    cells : tuple of RecordedForce
    weights : tuple of float
        Their sum is one.
    delays : tuple of float
        [s].

    """

    cells: tuple[RecordedForce, ...]
    weights: tuple[float, ...]
    delays: tuple[float, ...]

    def on_grid(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        """Evaluate at equally spaced instants (see `Signal`)."""
        total = np.zeros(count)
        for cell, weight, delay in zip(self.cells, self.weights, self.delays, strict=True):
            total += weight * cell.on_grid(start + delay, step, count)
        return total


def measured_forces(model: Model, record: MeasuredRecord) -> tuple[Signal, ...]:
    """
    Take the forces of all exciters from the force sensors.

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
        If no sensor measures an excitation.
    DataError
        If the force is not known for longer than a few samples.

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
        bridged = {i: _bridged(record.samples[:, i]) for i in channels}
        whole = {i: one for i, one in bridged.items() if np.isfinite(one).all()}
        if not whole:
            lost = int(np.argmax(np.isnan(next(iter(bridged.values())))))
            raise DataError(
                f'record: the force of excitation "{point.name}" is not known for more than '
                f'{LONGEST_GAP} samples from sample {lost} on; cut the record there'
            )
        signals.append(
            MeanForce(
                tuple(RecordedForce(one, record.sample_rate) for one in whole.values()),
                tuple(cell_weights([sensors[i] for i in whole]).tolist()),
                tuple(sensors[i].delay for i in whole),
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


def _bridged(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fill short gaps from the samples around them."""
    valid = np.isfinite(samples)
    if valid.all():
        return samples
    filled = samples.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ~valid, [False])).astype(np.int8)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        around = np.arange(max(0, begin - MARGIN), min(len(samples), end + MARGIN))
        around = around[valid[around]]
        if end - begin <= LONGEST_GAP and around.size > MARGIN:
            spline = make_interp_spline(around, samples[around], 5)
            filled[begin:end] = spline(np.arange(begin, end))
    return filled
