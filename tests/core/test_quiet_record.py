# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Quiet records: noise, steps and offsets with errors that hold, and what is not quiet."""

from dataclasses import replace

from identnl_ros.core.calibration.findings import Property
from identnl_ros.core.calibration.quiet_findings import (
    motion_at_rest,
    quiet_findings,
    with_noise,
)
from identnl_ros.core.calibration.quiet_record import quiet_channels
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
import numpy as np
import pytest
from scipy.stats import binom

from tests.core.test_calibration import BLOCK, LINE, motion, readings, record

A, D = SensorKind.ACCELERATION, SensorKind.DISPLACEMENT
RATE = 5000.0
COUNT = 20_000
RUNS = 100
RING = Layout((Sensor('ring', A, 'block', gain=0.01, offset=0.3, noise=0.02, reads_gravity=True),))


def channel(samples, layout=RING):
    (found,) = quiet_channels([MeasuredRecord(layout, RATE, samples[:, np.newaxis])], layout)
    return found


def white(seed, size=0.02):
    return size * np.random.default_rng(seed).standard_normal(COUNT)


def test_noise_and_mean_have_intervals_that_hold_and_white_noise_is_called_white():
    found = [channel(white(seed) + 0.5) for seed in range(RUNS)]
    noise = np.array([(one.noise / 0.02 - 1) / one.relative_error for one in found])
    mean = np.array([(one.mean - 0.5) / one.mean_error for one in found])
    for scores in (noise, mean):
        assert (np.abs(scores) < 1.96).sum() >= binom.ppf(1e-3, RUNS, 0.95)
        assert abs(scores.mean()) < 0.4
        assert np.std(scores) > 0.75
    assert sum(one.white for one in found) >= RUNS - 2
    assert found[0].density == pytest.approx(0.02 * np.sqrt(2 / RATE), rel=0.03)
    assert not any(one.resolution for one in found)


def test_a_hum_line_is_told_and_left_out_of_the_noise():
    time = np.arange(COUNT) / RATE
    found = channel(white(1) + 0.03 * np.sin(2 * np.pi * 50 * time))
    assert not found.white
    assert found.lines[0].frequency == pytest.approx(50, abs=1)
    assert found.lines[0].amplitude == pytest.approx(0.03 / np.sqrt(2), rel=0.05)
    assert found.noise == pytest.approx(0.02, rel=0.03)


def test_low_frequency_noise_widens_the_error_of_the_mean():
    generator = np.random.default_rng(2)
    wander = np.convolve(generator.standard_normal(COUNT), np.ones(1000) / 1000, 'same')
    found = channel(white(1) + wander)
    assert found.low_frequency > 0
    assert found.noise == pytest.approx(0.02, rel=0.03)
    assert found.mean_error > 10 * 0.02 / np.sqrt(COUNT)


@pytest.mark.parametrize('step', [0.005, 0.02])
def test_the_step_of_the_converter_is_found(step):
    found = channel(step * np.round((white(1) + 0.123) / step))
    assert found.resolution == pytest.approx(step, rel=1e-6)
    assert found.own_noise == pytest.approx(0.02, rel=0.03)


def test_noise_that_hides_in_a_step_is_not_told():
    found = channel(0.1 * np.round((white(1) + 0.05) / 0.1))
    assert np.isnan(found.own_noise)
    findings = quiet_findings([found], RING, RING, {}, None)
    (left,) = findings.undetermined
    assert left.what is Property.NOISE


def test_the_offset_of_what_reads_gravity_is_what_gravity_does_not_explain():
    up = replace(RING.sensors[0], direction=np.array([0.0, 0.0, 1.0]))
    layout = Layout((up,))
    # At rest it reads 9.80665 upwards; the layout's offset is 0.05 m/s^2 short.
    found = channel(white(1) + 9.80665 + 0.05, layout)
    findings = quiet_findings([found], layout, layout, {}, None)
    (offset,) = [one for one in findings.calibrated if one.what is Property.OFFSET]
    assert offset.value == pytest.approx(0.3 + 0.01 * 0.05, abs=4 * offset.standard_error)
    assert offset.standard_error < 0.01 * 0.001
    # An uncertain gain makes the share of gravity uncertain.
    known = {('ring', Property.GAIN): 0.01}
    (wide,) = [
        one
        for one in quiet_findings([found], layout, layout, known, None).calibrated
        if one.what is Property.OFFSET
    ]
    assert wide.standard_error == pytest.approx(0.01 * 9.80665 * 0.01, rel=0.01)


def test_noise_and_offset_follow_a_gain_that_was_found():
    louder = Layout((replace(RING.sensors[0], gain=0.0125, reads_gravity=False),))
    found = channel(white(1) + 0.4)
    findings = quiet_findings([found], RING, louder, {}, None)
    values = {one.what: one.value for one in findings.calibrated}
    assert values[Property.NOISE] == pytest.approx(0.02 / 1.25, rel=0.02)
    # Recorded at rest: 0.3 + 0.01 * 0.4, whatever the gain is.
    assert values[Property.OFFSET] == pytest.approx(0.304, abs=1e-5)


def test_a_machine_that_moves_is_told_and_one_at_rest_is_not():
    still = record(np.zeros((COUNT, 4)), LINE)
    moving = record(1e-2 * readings(BLOCK, LINE, motion(BLOCK), COUNT), LINE)
    found = []
    for one in (still, moving):
        layout = with_noise(LINE, quiet_channels([one], LINE))
        found.append(motion_at_rest(BLOCK, [one], layout))
    assert found[0] == ()
    assert 'redundant sensors see the same motion' in found[1][0]


def test_hum_in_the_cables_is_no_motion():
    hum = np.sin(2 * np.pi * 50 * np.arange(COUNT) / RATE)[:, np.newaxis]
    one = record(hum * [0.0, 1e-8, 3e-6, 0.01], LINE)
    layout = with_noise(LINE, quiet_channels([one], LINE))
    assert motion_at_rest(BLOCK, [one], layout) == ()


def test_a_short_record_is_refused_with_the_seconds_that_are_needed():
    noise = np.random.default_rng(1).standard_normal((5632, 4))
    words = rf'no channel is valid for {5632 / RATE:.3g} s \(5632 samples at {RATE:g} Hz\)'
    with pytest.raises(DataError, match=rf'{words}.* found a record of {5631 / RATE:.3g} s'):
        quiet_channels([record(noise[:-1], LINE)], LINE)
    assert len(quiet_channels([record(noise, LINE)], LINE)) == 4
