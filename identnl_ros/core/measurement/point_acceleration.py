# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Acceleration of an exciter's point as the sensors of motion of a record tell it."""

from dataclasses import dataclass, replace

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.added_reading import gravity_reading
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import Observation, observe_motion
from identnl_ros.core.measurement.short_gaps import bridged
from identnl_ros.core.measurement.stencils import stencil
from identnl_ros.core.mechanics.machine import ExcitationPoint
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Derivatives that make an acceleration of what a kind of sensor measures; the best kind first.
_DERIVATIVES = {SensorKind.ACCELERATION: 0, SensorKind.VELOCITY: 1, SensorKind.DISPLACEMENT: 2}
HALF_WIDTH = 8
# Part of a motion that sensors may leave out, by rounding.
ROUNDING = 1e-6


@dataclass(frozen=True)
class AccelerationShare:
    """
    What sensors of one delay contribute to an acceleration.

    Parameters
    ----------
    samples : ndarray, shape (n_samples,)
        [m/s^2].
    delay : float
        They show the acceleration this long before their time stamp [s].

    """

    samples: Reals
    delay: float


def acceleration_of(
    model: Model, record: MeasuredRecord, point: ExcitationPoint
) -> list[AccelerationShare]:
    """
    Find the acceleration of the point at which an exciter acts, along its direction.

    From accelerometers where they see it, else by derivatives of velocity or displacement, whose
    samples at the ends of the record repeat the nearest ones. Gravity is taken out; the tilt of
    accelerometers as far as displacement sensors see it.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord
    point : ExcitationPoint

    Returns
    -------
    list of AccelerationShare
        Their sum is the acceleration.

    Raises
    ------
    LayoutError
        If no kind of sensor sees that motion.
    DataError
        If the record lacks the readings that would.

    """
    row = model.motion_of_point(point.body, point.point, point.direction)
    filled = {
        i: bridged(record.samples[:, i])
        for i, sensor in enumerate(record.layout.sensors)
        if sensor.kind in _DERIVATIVES
    }
    kept = [i for i, one in filled.items() if np.isfinite(one).all()]
    layout = _part(record.layout, kept)
    found = layout and _seen(model, layout, row)
    if not layout or not found:
        whole = _part(record.layout, list(filled))
        if whole is None or _seen(model, whole, row) is None:
            raise LayoutError(
                f'layout: a force cell of excitation "{point.name}" has a mass in front, but no '
                f'sensors see the acceleration of that point of {point.body}; add an '
                'accelerometer there along the direction of the exciter'
            )
        raise DataError(
            f'record: the acceleration of excitation "{point.name}", where the force cell has a '
            'mass in front, is not known all along: sensors that see it have lost too many samples'
        )
    kind, weights, observation = found
    shares: dict[float, Reals] = {}

    def add(place: int, series: Reals) -> None:
        delay = layout.sensors[place].delay
        shares[delay] = shares.get(delay, 0.0) + series

    order = _DERIVATIVES[kind]
    constant, tilt = gravity_reading(model, layout.sensors, layout.gravity).among(len(kept))
    for place, weight in zip(observation.channels, weights, strict=True):
        series = filled[kept[place]] - constant[place]
        add(place, weight * _derivative(series, order, record.sample_rate))
    tilted = weights @ tilt[list(observation.channels)]
    displacement = observe_motion(model, layout, SensorKind.DISPLACEMENT)
    if tilted.any() and _sees(displacement, tilted):
        for place, weight in zip(displacement.channels, tilted @ displacement.matrix, strict=True):
            add(place, -weight * filled[kept[place]])
    return [AccelerationShare(series, delay) for delay, series in shares.items()]


def _part(layout: Layout, places: list[int]) -> Layout | None:
    """Keep some sensors; None where there are none."""
    sensors = tuple(layout.sensors[i] for i in places)
    return replace(layout, sensors=sensors) if sensors else None


def _seen(
    model: Model, layout: Layout, row: Reals
) -> tuple[SensorKind, Reals, Observation] | None:
    """Find the kind of sensor to take a motion from, and the weights of its sensors."""
    for kind in _DERIVATIVES:
        observation = observe_motion(model, layout, kind)
        if observation.channels and _sees(observation, row):
            return kind, row @ observation.matrix, observation
    return None


def _sees(observation: Observation, row: Reals) -> bool:
    """Tell whether a motion can be told from readings of one kind."""
    scale = np.abs(row).max()
    return bool(np.abs(row @ observation.seen - row).max() <= ROUNDING * scale)


def _derivative(series: Reals, order: int, rate: float) -> Reals:
    if not order:
        return series
    inner = np.correlate(series, stencil(order, 0.0, HALF_WIDTH) * rate**order, 'valid')
    return np.pad(inner, HALF_WIDTH, mode='edge')
