# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Delays from rigid-body consistency: unbiased, at the bound, with intervals that hold."""

from dataclasses import replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.synchronisation.damping_cost import damping_cost, delay_warning
from identnl_ros.core.synchronisation.delay_estimate import source_delays
from identnl_ros.core.synchronisation.segment_spectra import segment_spectra
import numpy as np
import pytest
from scipy.stats import binom

from tests.core.machines import line_layout, oscillator

D, V, A = SensorKind.DISPLACEMENT, SensorKind.VELOCITY, SensorKind.ACCELERATION
ORDER = {D: 0, V: 1, A: 2}
RATE = 5000.0
COUNT = 3000
FREQUENCIES = np.arange(5.0, 200.0, 2.5)
RUNS = 60
BLOCK = assemble(oscillator())
LINE = line_layout(kinds=(D, V, A), noise={D: 1e-8, V: 2e-6, A: 1e-2, SensorKind.FORCE: 0.0})


def amplitudes(model):
    """Complex displacements of all coordinates; accelerations of 0.1 a line."""
    generator = np.random.default_rng(0)
    shape = (len(model.coordinates), len(FREQUENCIES))
    random = generator.normal(size=shape) + 1j * generator.normal(size=shape)
    return random * 0.1 / (2 * np.pi * FREQUENCIES) ** 2


def readings(model, layout, delays, skew=0.0, count=COUNT):
    """Give closed-form readings of sensors that are late; the last source's clock is slow."""
    time = np.arange(count) / RATE
    omega = 2 * np.pi * FREQUENCIES
    samples = np.zeros((count, len(layout.sensors)))
    for i, sensor in enumerate(layout.sensors):
        if sensor.kind is SensorKind.FORCE:
            continue
        late = delays[i] + skew * (sensor.kind is A) * (time - time.mean())
        lines = (sensor_matrix(model, (sensor,))[0] @ amplitudes(model)) * (1j * omega) ** ORDER[
            sensor.kind
        ]
        samples[:, i] = (np.exp(1j * np.outer(time - late, omega)) @ lines).real
    return samples


def noisy(samples, layout, seed):
    noise = np.array([sensor.noise for sensor in layout.sensors])
    return samples + noise * np.random.default_rng(seed).standard_normal(samples.shape)


def late(layout, kind, delay):
    return np.array([delay * (sensor.kind is kind) for sensor in layout.sensors])


SOURCES = ([1, 2], [3])
NAMES = ('probes', 'accelerometers')


def test_perfect_sensors_are_consistent_to_rounding():
    record = MeasuredRecord(LINE, RATE, readings(BLOCK, LINE, np.zeros(4)))
    found = source_delays(BLOCK, record, SOURCES, NAMES)
    assert abs(found.delays[1]) < 1e-12
    assert abs(found.skews[1]) < 1e-11


@pytest.mark.parametrize(('delay', 'skew'), [(0.0, 0.0), (3e-6, 4e-6)])
def test_delays_and_skews_are_at_the_bound_with_intervals_that_hold(delay, skew):
    clean = readings(BLOCK, LINE, late(LINE, A, delay), skew)
    errors, deviations = [], []
    for seed in range(RUNS):
        record = MeasuredRecord(LINE, RATE, noisy(clean, LINE, seed))
        found = source_delays(BLOCK, record, SOURCES, NAMES)
        errors.append((found.delays[1] - delay, found.skews[1] - skew))
        deviations.append((found.standard_deviations[1], found.skew_deviations[1]))
    # Information on the delay of an accelerometer against two other sensors whose motion is
    # not known, line by line; along the record for the skew.
    omega = 2 * np.pi * FREQUENCIES
    motion = np.abs(amplitudes(BLOCK)[0]) * omega**2
    kinematics = np.stack((omega**-2, omega**-1, np.ones(len(omega))))
    weights = np.array([1e-8, 2e-6, 1e-2])[:, np.newaxis] ** -2.0 * kinematics**2
    share = weights[2] * (1 - weights[2] / weights.sum(axis=0))
    duration = COUNT / RATE
    bound = ((COUNT / 2) * (omega**2 * motion**2 * share).sum()) ** -0.5
    bounds = np.array([bound, bound * np.sqrt(12) / duration])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / bounds
    assert np.all((ratio > 0.75) & (ratio < [1.3, 1.35])), ratio
    inside = (np.abs(errors) < 1.96 * np.array(deviations)).sum(axis=0)
    assert np.all(inside >= binom.ppf(1e-3, RUNS, 0.95)), inside
    assert np.all(np.mean(deviations, axis=0) < 1.3 * bounds)
    scores = np.array(errors) / deviations
    assert np.all(np.abs(scores.mean(axis=0)) < 4 / np.sqrt(RUNS))


def test_a_delay_of_milliseconds_is_found_by_trying():
    clean = readings(BLOCK, LINE, late(LINE, A, 3e-3))
    record = MeasuredRecord(LINE, RATE, noisy(clean, LINE, 1))
    found = source_delays(BLOCK, record, SOURCES, NAMES, search=5e-3)
    assert found.delays[1] == pytest.approx(3e-3, abs=1e-4)


def test_known_delays_of_the_layout_are_taken_out():
    sensors = tuple(replace(one, delay=5e-5 * (one.kind is A)) for one in LINE.sensors)
    layout = Layout(sensors)
    clean = readings(BLOCK, layout, late(LINE, A, 5e-5))
    found = source_delays(
        BLOCK, MeasuredRecord(layout, RATE, noisy(clean, LINE, 1)), SOURCES, NAMES
    )
    assert abs(found.delays[1]) < 4 * found.standard_deviations[1]


def test_constant_offsets_and_gravity_change_nothing():
    clean = readings(BLOCK, LINE, np.zeros(4)) + np.array([0.0, 1e-3, 1e-2, 9.81])
    found = source_delays(BLOCK, MeasuredRecord(LINE, RATE, clean), SOURCES, NAMES)
    assert abs(found.delays[1]) < 1e-10


def test_segments_with_lost_samples_are_left_out():
    samples = noisy(readings(BLOCK, LINE, np.zeros(4)), LINE, 1)
    samples[1200:1210, 2] = np.nan
    found = source_delays(BLOCK, MeasuredRecord(LINE, RATE, samples), SOURCES, NAMES)
    assert abs(found.delays[1]) < 4 * found.standard_deviations[1]
    spectra = segment_spectra(BLOCK, MeasuredRecord(LINE, RATE, samples))
    assert np.all((spectra.begins + spectra.length <= 1200) | (spectra.begins >= 1210))


def test_rest_tells_no_delay():
    record = MeasuredRecord(LINE, RATE, noisy(np.zeros((COUNT, 4)), LINE, 1))
    with pytest.raises(DataError, match='no motion stands out of the noise'):
        source_delays(BLOCK, record, SOURCES, NAMES)
    found = source_delays(BLOCK, record, SOURCES, NAMES, 1e-3, np.zeros(2), np.diag([1e-6, 1e-8]))
    np.testing.assert_allclose(found.standard_deviations[1], 1e-3)


def test_a_record_too_short_is_refused():
    record = MeasuredRecord(LINE, RATE, np.zeros((100, 4)))
    with pytest.raises(DataError, match='too few to find delays'):
        source_delays(BLOCK, record, SOURCES, NAMES)


def test_25_microseconds_cost_a_quarter_of_the_damping():
    assert float(damping_cost(25e-6, 60.0, 0.02)) == pytest.approx(-0.236, abs=1e-3)
    text = delay_warning('daq', 25e-6, np.array([20.0, 60.0]), np.array([0.05, 0.02]))
    assert text is not None
    assert 'daq: a delay of 25 us may remain' in text
    assert 'mode at 60 Hz by up to 24%' in text
    late = delay_warning('daq', 1.96e-3, np.array([10.07]), np.array([0.04]))
    assert 'daq: a delay of 1.96 ms may remain' in str(late)
    assert delay_warning('daq', 1e-7, np.array([60.0]), np.array([0.02])) is None
    assert 'by any amount' in str(delay_warning('daq', np.inf, np.ones(1), np.ones(1)))
