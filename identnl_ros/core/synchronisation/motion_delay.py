# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the motion of the newest seconds tells of the delays between the sources of a stream."""

from collections.abc import Sequence
from dataclasses import replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.delay_estimate import DelayEstimate, source_delays
from identnl_ros.core.synchronisation.source_stream import SourceStream
import numpy as np
from numpy.typing import NDArray


def noise_on_grid(sensors: Layout, own_rates: Sequence[float], rate: float) -> Layout:
    """
    State the noise of one sample after resampling: its density in the band stays what it is.

    Where the rate changes, that of the converter's steps is part of it: samples that are sums of
    many others have no steps.

    Parameters
    ----------
    sensors : Layout
    own_rates : sequence of float
        At which each sensor was sampled [Hz].
    rate : float
        Of the grid [Hz].

    Returns
    -------
    Layout

    """
    changed = []
    for sensor, own in zip(sensors.sensors, own_rates, strict=True):
        if own != rate:
            noise = np.hypot(sensor.noise, sensor.resolution / np.sqrt(12))
            sensor = replace(sensor, noise=float(noise * np.sqrt(rate / own)), resolution=0.0)
        changed.append(sensor)
    return replace(sensors, sensors=tuple(changed))


def motion_delays(
    model: Model,
    layout: Layout,
    groups: Sequence[Sequence[SourceStream]],
    points: tuple[int, int],
    grid_rate: float,
    prior: tuple[NDArray[np.float64], NDArray[np.float64]],
    search: float = 0.0,
) -> DelayEstimate | None:
    """
    Compare what sources saw, on the grid as it lies in them now.

    All are brought to the lowest of the rates: above its Nyquist frequency the slowest source
    shows nothing.

    Parameters
    ----------
    model : Model
    layout : Layout
    groups : sequence of sequence of SourceStream
        Sources that are aligned already stand together; the first group is the reference.
    points : tuple of int
        Begin and end of the time on the grid.
    grid_rate : float
        [Hz].
    prior : tuple of ndarray
        As `source_delays` takes it: mean and covariance.
    search : float
        [s].

    Returns
    -------
    DelayEstimate or None
        None: the motion tells nothing.

    """
    streams = [one for group in groups for one in group]
    rate = min(grid_rate, *(one.rate for one in streams))
    spacing = grid_rate / rate
    count = int((points[1] - points[0]) / spacing)
    grid = points[0] + spacing * np.arange(count, dtype=np.float64)
    parts = []
    for one in streams:
        assert one.line is not None
        stretch = None if spacing == 1.0 else max(1.0, one.line.step * spacing)
        parts.append(one.read(grid, one.line, stretch))
    order = [place for one in streams for place in one.places]
    own_rates = [one.rate for one in streams for _ in one.places]
    some = replace(layout, sensors=tuple(layout.sensors[place] for place in order))
    channels, first = [], 0
    for group in groups:
        count = sum(len(one.places) for one in group)
        channels.append(list(range(first, first + count)))
        first += count
    try:
        record = MeasuredRecord(
            noise_on_grid(some, own_rates, rate), rate, np.concatenate(parts, axis=1)
        )
        names = [group[0].source.name for group in groups]
        found = source_delays(model, record, channels, names, search, *prior)
    except DataError:
        return None
    return found if np.isfinite(found.covariance).all() else None
