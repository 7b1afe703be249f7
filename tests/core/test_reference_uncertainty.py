# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Errors of calibrated gains contain those of the references, and have them in common."""

from dataclasses import replace

from identnl_ros.core.calibration.known_input import calibrate_amplitude, KnownAmplitude
from identnl_ros.core.calibration.motion_calibration import calibrate_motion
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.assembly import assemble
import numpy as np
import pytest

from tests.core.calibration_runs import (
    assert_intervals_hold,
    changed,
    found_of,
    GAIN,
    motion,
    RATE,
    readings,
    record,
)
from tests.core.machines import line_layout, oscillator
from tests.core.weak_runs import A, D, F, V

RUNS = 60
BLOCK = assemble(oscillator())
MOTION = motion(BLOCK)
LINE = line_layout(kinds=(D, V, A), noise={D: 1e-9, V: 5e-7, A: 1e-2, F: 0.1})
SECOND = replace(LINE.sensors[-1], name='second')
LAYOUT = Layout((*LINE.sensors, SECOND))
PROBES = 'block_displacement', 'block_velocity'
# Of the stated gain: each probe its own, and what both have of one standard.
ERRORS = {
    'block_displacement': {'probe': 0.004, 'laser': 0.006},
    'block_velocity': {'speed': 0.008, 'laser': 0.006},
}
SOURCES = ('probe', 'speed', 'laser')
TRUTH = {'block_acceleration': 1.05, 'second': 0.97}


def with_drawn_references(seed):
    """Sensors as they are: the layout states gains of the probes that are too high."""
    drawn = dict(zip(SOURCES, np.random.default_rng(seed).standard_normal(3), strict=True))
    actual = LAYOUT
    for name, errors in ERRORS.items():
        too_high = sum(error * drawn[source] for source, error in errors.items())
        actual = changed(actual, name, gain=1 - too_high)
    for name, gain in TRUTH.items():
        actual = changed(actual, name, gain=gain)
    return actual


def runs(errors):
    for seed in range(RUNS):
        clean = readings(BLOCK, with_drawn_references(seed), MOTION)
        yield calibrate_motion(
            BLOCK, [record(clean, LAYOUT, seed)], LAYOUT, PROBES, {GAIN}, gain_errors=errors
        )


@pytest.fixture(scope='module')
def drawn():
    """Calibrate with references that are drawn anew every time."""
    return list(runs(ERRORS))


def test_intervals_hold_over_drawn_references(drawn):
    for name, truth in TRUTH.items():
        found = [found_of(findings, name)[GAIN] for findings in drawn]
        assert_intervals_hold([(one.value - truth) / one.standard_error for one in found])
    # References that differ as their uncertainty allows do not contradict one another.
    assert not any(findings.doubts for findings in drawn)


def test_error_is_that_of_the_best_mean_of_the_references(drawn):
    # Noise is small beside the references: what is left is their best linear unbiased mean.
    table = np.array([[ERRORS[name].get(source, 0.0) for source in SOURCES] for name in PROBES])
    best = np.linalg.inv(table @ table.T).sum() ** -0.5
    for name, truth in TRUTH.items():
        found = found_of(drawn[0], name)[GAIN]
        assert found.standard_error == pytest.approx(truth * best, rel=0.03)
        assert found.own_error < 0.1 * found.standard_error


def test_gains_by_the_same_references_share_their_errors(drawn):
    scores = []
    for findings in drawn:
        one, other = (found_of(findings, name)[GAIN] for name in TRUTH)
        off = one.value / TRUTH[one.sensor] - other.value / TRUTH[other.sensor]
        first, second = one.relative_errors, other.relative_errors
        spread = [first.get(key, 0.0) - second.get(key, 0.0) for key in {*first, *second}]
        error = np.linalg.norm(spread)
        # Far better known than each by itself.
        assert error < 0.1 * one.standard_error
        scores.append(off / error)
    assert_intervals_hold(scores)


def test_references_taken_as_exact_are_told_and_too_narrow_or_in_doubt():
    scores, doubts = [], 0
    for findings in runs(None):
        found = found_of(findings, 'second')[GAIN]
        scores.append((found.value - TRUTH['second']) / found.standard_error)
        doubts += bool(findings.doubts)
    assert np.mean(np.abs(scores) < 1.96) < 0.2
    assert doubts > RUNS / 2
    assert any('block_velocity is not given' in one for one in findings.remarks)


def test_the_uncertainty_of_a_single_reference_is_that_of_the_gain():
    clean = readings(BLOCK, LAYOUT, MOTION)
    errors = {'block_velocity': {'laser': 0.01}}
    layout = Layout(tuple(one for one in LAYOUT.sensors if one.kind is not D))
    samples = np.delete(clean, [one.kind is D for one in LAYOUT.sensors], axis=1)
    exact, known = (
        calibrate_motion(
            BLOCK,
            [record(samples, layout)],
            layout,
            ('block_velocity',),
            {GAIN},
            gain_errors=given,
        )
        for given in (None, errors)
    )
    for before, after in zip(exact.calibrated, known.calibrated, strict=True):
        assert after.value == pytest.approx(before.value, rel=1e-6)
        assert after.own_error == pytest.approx(before.standard_error, rel=1e-3)
        # A reference that reads too little makes the motion too small, the gain too high.
        assert after.shares == {'laser': pytest.approx(0.01 * after.value, rel=1e-3)}
    assert known.remarks[-1].endswith('the uncertainty of the gain of block_velocity.')


def test_sensors_on_one_calibrator_share_its_error():
    time = np.arange(4000) / RATE
    layout = Layout((LINE.sensors[-1], SECOND))
    ratios, scores = [], []
    for seed in range(RUNS):
        true = 10 * (1 + 0.02 * np.random.default_rng(seed).standard_normal())
        found = []
        for channel, (name, gain) in enumerate(TRUTH.items()):
            samples = np.zeros((len(time), 2))
            samples[:, channel] = (
                gain * true * np.sqrt(2) * np.sin(2 * np.pi * 80 * time + channel)
            )
            findings = calibrate_amplitude(
                [record(samples, layout, 2 * seed + channel)],
                layout,
                KnownAmplitude(name, 10.0, 80.0, 0.02, 'shaker'),
            )
            found.append(found_of(findings, name)[GAIN])
            scores.append((found[-1].value - gain) / found[-1].standard_error)
        one, other = found
        assert one.shares.keys() == other.shares.keys() == {'shaker'}
        off = one.value / other.value / (TRUTH[one.sensor] / TRUTH[other.sensor]) - 1
        own = np.hypot(one.own_error / one.value, other.own_error / other.value)
        ratios.append(off / own)
    assert_intervals_hold(scores[::2])
    assert_intervals_hold(ratios)
