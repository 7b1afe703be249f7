# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a quiet record says of the layout, and whether the machine was quiet."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from identnl_ros.core.calibration.cross_spectra import cross_spectra
from identnl_ros.core.calibration.findings import Calibrated, Findings, Property, Undetermined
from identnl_ros.core.calibration.motion_likelihood import elimination
from identnl_ros.core.calibration.quiet_record import QuietChannel
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

# Motion has so many times the power, by degree of freedom, of what no rigid motion explains.
COMMON = 4.0
# Standard errors of a drift that is told.
DRIFTING = 5.0


def with_noise(layout: Layout, channels: Sequence[QuietChannel]) -> Layout:
    """
    Put noise and resolution that were found into a layout, its gains unchanged.

    Parameters
    ----------
    layout : Layout
    channels : sequence of QuietChannel

    Returns
    -------
    Layout

    """
    # Noise and rounding together, which is what spectra show.
    noise = {one.sensor.name: one.noise for one in channels}
    return replace(
        layout,
        sensors=tuple(
            replace(one, noise=noise[one.name], resolution=0.0) if one.name in noise else one
            for one in layout.sensors
        ),
    )


def quiet_findings(
    channels: Sequence[QuietChannel],
    layout: Layout,
    corrected: Layout,
    errors: dict[tuple[str, Property], float],
    rest: NDArray[np.float64] | None,
) -> Findings:
    """
    Put noise, resolution and offset in the terms of a layout.

    Parameters
    ----------
    channels : sequence of QuietChannel
    layout : Layout
        By which the samples are SI.
    corrected : Layout
        With gains and directions that were found otherwise.
    errors : dict of (str, Property) to float
        Standard errors of these: gain relative [-], direction [rad].
    rest : ndarray, shape (n_sensors,) or None
        Displacements that the sensors should read [m]; None: not known.

    Returns
    -------
    Findings

    """
    names = [sensor.name for sensor in layout.sensors]
    calibrated: list[Calibrated] = []
    undetermined: list[Undetermined] = []
    for one in channels:
        old, index = one.sensor, names.index(one.sensor.name)
        new = corrected.sensors[index]
        factor = abs(new.gain / old.gain)
        name = old.name
        if one.noise > 0 and np.isfinite(one.own_noise):
            value = one.own_noise / factor
            error = value * float(
                np.hypot(one.relative_error, errors.get((name, Property.GAIN), 0.0))
            )
            calibrated.append(Calibrated(name, Property.NOISE, old.noise, value, error))
        else:
            reason = 'hidden in the steps of the converter' if one.noise > 0 else 'there is none'
            undetermined.append(Undetermined(name, Property.NOISE, reason))
        if one.resolution:
            step = one.resolution / factor
            calibrated.append(Calibrated(name, Property.RESOLUTION, old.resolution, step, np.nan))
        if old.kind is SensorKind.DISPLACEMENT and rest is None:
            reason = 'where the machine rests depends on its unknowns'
            undetermined.append(Undetermined(name, Property.OFFSET, reason))
            continue
        reading, doubt = _at_rest(new, layout.gravity, errors)
        if old.kind is SensorKind.DISPLACEMENT and rest is not None:
            reading = float(rest[index])
        gain = new.gain / old.gain
        value = old.offset + old.gain * (one.mean - gain * reading)
        error = abs(old.gain) * float(np.hypot(one.mean_error, gain * doubt))
        calibrated.append(Calibrated(name, Property.OFFSET, old.offset, value, error))
    return Findings(tuple(calibrated), tuple(undetermined), tuple(_remarks(channels)))


def motion_at_rest(
    model: Model, records: Iterable[MeasuredRecord], layout: Layout
) -> tuple[str, ...]:
    """
    Say whether the machine moves in a record that should be quiet.

    Parameters
    ----------
    model : Model
    records : iterable of MeasuredRecord
    layout : Layout
        With the white noise of the channels.

    Returns
    -------
    tuple of str
        Sentences; empty: nothing that redundant sensors have in common.

    """
    records = (replace(one, layout=layout) for one in records)
    nothing = np.zeros(len(layout.sensors))
    try:
        spectra = cross_spectra(model, records, nothing)
    except DataError:
        return ()
    rows = sensor_matrix_of(model, layout)
    found: list[str] = []
    for one in (part.moving() for part in spectra):
        if not len(one.frequencies):
            continue
        _, _, weights = elimination(rows[one.channels], one.variance)
        left = np.einsum('fcd,fdc->f', weights, one.sums).real
        whole = np.einsum('fcc,fc->f', one.sums, 1 / one.variance).real
        freedom = np.einsum('fcc,fc->f', weights, one.variance) * one.counts
        rank = one.counts * len(one.channels) - freedom
        if freedom.sum() < 1 or rank.sum() < 1:
            continue
        moving = (whole - left).sum() / rank.sum()
        if moving > COMMON * left.sum() / freedom.sum():
            strongest = float(one.frequencies[np.argmax(whole - left)] / 2 / np.pi)
            found.append(
                'The machine is not quiet: redundant sensors see the same motion, '
                f'{np.sqrt(moving):.2g} times the noise in a band of '
                f'{one.frequencies.min() / 2 / np.pi:.3g} to '
                f'{one.frequencies.max() / 2 / np.pi:.3g} Hz, most at {strongest:.3g} Hz. '
                'The noise is what lies beside it.'
            )
    return tuple(found)


def sensor_matrix_of(model: Model, layout: Layout) -> NDArray[np.float64]:
    """
    Rows of the sensors of motion; zero for force sensors.

    Parameters
    ----------
    model : Model
    layout : Layout

    Returns
    -------
    ndarray, shape (n_sensors, n_coordinates)

    """
    rows = np.zeros((len(layout.sensors), len(model.coordinates)))
    for row, sensor in zip(rows, layout.sensors, strict=True):
        if sensor.kind is not SensorKind.FORCE:
            row += sensor_matrix(model, (sensor,))[0]
    return rows


def _at_rest(
    sensor: Sensor, gravity: NDArray[np.float64], errors: dict[tuple[str, Property], float]
) -> tuple[float, float]:
    """Give the reading of a sensor of a machine at rest, and its standard error."""
    if not sensor.reads_gravity:
        return 0.0, 0.0
    reading = -float(gravity @ sensor.direction)
    across = float(np.linalg.norm(np.cross(gravity, sensor.direction)))
    of_gain = reading * errors.get((sensor.name, Property.GAIN), 0.0)
    of_direction = across * errors.get((sensor.name, Property.DIRECTION), 0.0)
    return reading, float(np.hypot(of_gain, of_direction))


def _remarks(channels: Sequence[QuietChannel]) -> Iterable[str]:
    for one in channels:
        unit = one.sensor.kind.unit
        if one.lines:
            lines = ', '.join(
                f'{line.frequency:.4g} Hz ({line.amplitude:.2g} {unit} rms)'
                for line in one.lines[:3]
            )
            more = f' and {len(one.lines) - 3} more' if len(one.lines) > 3 else ''
            yield f'{one.sensor.name}: lines at {lines}{more} are no white noise.'
        if one.low_frequency:
            yield (
                f'{one.sensor.name}: below {one.low_frequency:.3g} Hz the noise is more than '
                f'{one.density:.2g} {unit}/Hz^0.5.'
            )
        if abs(one.drift) > DRIFTING * one.drift_error:
            yield f'{one.sensor.name}: the mean drifts by {one.drift:.2g} {unit}/s.'
