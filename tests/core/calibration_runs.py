# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Closed-form records for the tests of calibration, and whether intervals hold."""

from dataclasses import replace

from identnl_ros.core.calibration.findings import Property
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import sensor_matrix
import numpy as np
from scipy.stats import binom

from tests.core.weak_runs import A, D, F, V

RATE = 5000.0
COUNT = 3000
FREQUENCIES = np.arange(5.0, 200.0, 2.5)
OMEGA = 2 * np.pi * FREQUENCIES
ORDER = {D: 0, V: 1, A: 2}
GAIN, DIRECTION, DELAY = Property.GAIN, Property.DIRECTION, Property.DELAY


def motion(model, coordinates=None):
    """Complex displacements of the coordinates; accelerations of 0.1 a line."""
    generator = np.random.default_rng(0)
    shape = (len(model.coordinates), len(OMEGA))
    random = generator.normal(size=shape) + 1j * generator.normal(size=shape)
    if coordinates is not None:
        random[np.setdiff1d(np.arange(len(random)), coordinates)] = 0.0
    return random * 0.1 / OMEGA**2


def readings(model, actual, amplitudes, count=COUNT):
    """Closed-form SI readings of sensors as they are, understood by a layout of gain 1."""
    time = np.arange(count) / RATE
    samples = np.zeros((count, len(actual.sensors)))
    for i, sensor in enumerate(actual.sensors):
        if sensor.kind is F:
            continue
        lines = (sensor_matrix(model, (sensor,))[0] @ amplitudes) * (1j * OMEGA) ** ORDER[
            sensor.kind
        ]
        moved = (np.exp(1j * np.outer(time - sensor.delay, OMEGA)) @ lines).real
        samples[:, i] = sensor.gain * moved + sensor.offset
    return samples


def noisy(samples, layout, seed):
    noise = np.array([sensor.noise for sensor in layout.sensors])
    return samples + noise * np.random.default_rng(seed).standard_normal(samples.shape)


def record(samples, layout, seed=1):
    return MeasuredRecord(layout, RATE, noisy(samples, layout, seed))


def changed(layout, name, **changes):
    return Layout(
        tuple(replace(one, **changes) if one.name == name else one for one in layout.sensors)
    )


def found_of(findings, sensor):
    return {one.what: one for one in findings.calibrated if one.sensor == sensor}


def errors_of(findings, actual, declared):
    """Errors over standard errors, by property."""
    truth = {one.name: one for one in actual.sensors}
    stated = {one.name: one for one in declared.sensors}
    result = {}
    for one in findings.calibrated:
        sensor = truth[one.sensor]
        if one.what is DIRECTION:
            along = sensor.direction @ stated[one.sensor].direction
            right = np.arctan2(sensor.direction @ one.axis, along)
        else:
            right = getattr(sensor, one.what.value)
        result.setdefault(one.what, []).append((one.value - right) / one.standard_error)
    return result


def assert_intervals_hold(scores):
    scores = np.asarray(scores)
    inside = int((np.abs(scores) < 1.96).sum())
    assert inside >= binom.ppf(1e-3, len(scores), 0.95), inside
    assert abs(scores.mean()) < 4 / np.sqrt(len(scores))
    # Nor are the intervals wider than need be.
    assert np.sqrt(np.mean(scores**2)) > 0.75
