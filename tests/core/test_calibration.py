# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Calibration: unbiased, at the bound, intervals that hold, silent where nothing is told."""

from dataclasses import replace

from identnl_ros.core.calibration.findings import corrected_layout
from identnl_ros.core.calibration.known_input import calibrate_amplitude, KnownAmplitude
from identnl_ros.core.calibration.motion_calibration import across, calibrate_motion
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.core import weak_runs
from tests.core.calibration_runs import (
    assert_intervals_hold,
    changed,
    COUNT,
    DELAY,
    DIRECTION,
    errors_of,
    found_of,
    GAIN,
    motion,
    OMEGA,
    RATE,
    readings,
    record,
)
from tests.core.machines import line_layout, oscillator
from tests.core.weak_runs import A, D, F, V
from tests.reference_machines import complete_layout, knee_and_column

RUNS = 60
BLOCK = assemble(oscillator())
LINE = line_layout(kinds=(D, V, A), noise={D: 1e-8, V: 2e-6, A: 1e-2, F: 0.1})
MACHINE = assemble(knee_and_column())


def test_gain_and_delay_are_at_the_bound_with_intervals_that_hold():
    actual = changed(LINE, 'block_acceleration', gain=1.05, delay=30e-6)
    clean = readings(BLOCK, actual, motion(BLOCK))
    trusted = 'block_displacement', 'block_velocity'
    scores, errors = {GAIN: [], DELAY: []}, []
    for seed in range(RUNS):
        findings = calibrate_motion(BLOCK, [record(clean, LINE, seed)], LINE, trusted)
        assert not findings.doubts
        for what, all_scores in errors_of(findings, actual, LINE).items():
            scores[what] += all_scores
        found = found_of(findings, 'block_acceleration')
        errors.append((found[GAIN].value - 1.05, found[DELAY].value - 30e-6))
    assert_intervals_hold(scores[GAIN])
    assert_intervals_hold(scores[DELAY])
    # Information on the third sensor of a motion that is known through the other two alone.
    size = np.abs(motion(BLOCK)[0]) * OMEGA**2
    others = ((np.array([1e-8, 2e-6])[:, np.newaxis] * OMEGA ** [[2], [1]]) ** -2.0).sum(axis=0)
    variance = 1e-4 + 1.05**2 / others
    of_gain = (COUNT / 2 * (size**2 / variance).sum()) ** -0.5
    of_delay = (COUNT / 2 * (1.05**2 * OMEGA**2 * size**2 / variance).sum()) ** -0.5
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / [of_gain, of_delay]
    assert np.all((ratio > 0.75) & (ratio < 1.3)), ratio


@pytest.fixture(scope='module')
def crooked():
    """Machine with trusted probes and accelerometers that are 5 %, 2 degrees, 30 us off."""
    layout = complete_layout(MACHINE.machine, 1e-8, 1e-2, kinds=(D, A))
    generator = np.random.default_rng(3)
    sensors = []
    for one in layout.sensors:
        if one.kind is A:
            lean = across(one.direction)[generator.integers(2)] * generator.choice([-1, 1])
            one = replace(
                one,
                gain=1 + 0.05 * generator.choice([-1, 1]),
                direction=one.direction + np.tan(np.radians(2)) * lean,
                delay=30e-6 * generator.random(),
            )
        sensors.append(one)
    actual = Layout(tuple(sensors))
    trusted = [one.name for one in layout.sensors if one.kind is D]
    return layout, actual, trusted, readings(MACHINE, actual, motion(MACHINE))


def test_gains_directions_and_delays_of_a_machine_with_intervals_that_hold(crooked):
    layout, actual, trusted, clean = crooked
    scores = {GAIN: [], DIRECTION: [], DELAY: []}
    for seed in range(3):
        findings = calibrate_motion(MACHINE, [record(clean, layout, seed)], layout, trusted)
        assert not findings.doubts
        assert not findings.undetermined
        for what, found in errors_of(findings, actual, layout).items():
            scores[what] += found
    for found in scores.values():
        assert len(found) >= 54
        assert_intervals_hold(found)
    corrected = corrected_layout(layout, findings.calibrated)
    for one, other in zip(corrected.sensors, actual.sensors, strict=True):
        assert one.gain == pytest.approx(other.gain, abs=5e-3)
        np.testing.assert_allclose(one.direction, other.direction, atol=5e-3)


def test_two_records_tell_as_much_as_one_that_is_twice_as_long(crooked):
    layout, _, trusted, clean = crooked
    one, two = (
        calibrate_motion(MACHINE, [record(clean, layout, i) for i in range(n)], layout, trusted)
        for n in (1, 2)
    )
    ratio = [
        b.standard_error / a.standard_error
        for a, b in zip(one.calibrated, two.calibrated, strict=True)
    ]
    np.testing.assert_allclose(ratio, np.sqrt(0.5), rtol=0.1)


def test_without_a_trusted_sensor_gains_and_delays_stay(crooked):
    layout, _, _, clean = crooked
    findings = calibrate_motion(MACHINE, [record(clean, layout)], layout, ())
    assert not findings.doubts
    assert not any(one.what in (GAIN, DELAY) for one in findings.calibrated)
    left = [one for one in findings.undetermined if one.what is GAIN]
    assert len(left) == 36
    assert 'no trusted sensor' in left[0].reason


def test_gains_alone_do_not_make_crooked_sensors_agree(crooked):
    layout, _, trusted, clean = crooked
    findings = calibrate_motion(MACHINE, [record(clean, layout)], layout, trusted, {GAIN})
    assert 'something else is wrong' in findings.doubts[0]


def test_a_wrong_point_is_no_gain(crooked):
    layout, actual, trusted, _ = crooked
    name = next(one.name for one in layout.sensors if one.kind is A)
    moved = changed(actual, name, point=np.array([0.4, 0.4, 0.5]))
    clean = readings(MACHINE, moved, motion(MACHINE))
    findings = calibrate_motion(MACHINE, [record(clean, layout)], layout, trusted)
    assert name in findings.doubts[0]


def test_directions_that_the_motion_does_not_show_stay_and_gains_come_out(crooked):
    layout, _, trusted, _ = crooked
    # Everything moves along x only: no motion across.
    straight = [
        i for i, one in enumerate(MACHINE.coordinates) if one.name.endswith('translation_1')
    ]
    assert straight
    actual = Layout(
        tuple(replace(one, gain=1.05 if one.kind is A else 1.0) for one in layout.sensors)
    )
    clean = readings(MACHINE, actual, motion(MACHINE, straight))
    findings = calibrate_motion(MACHINE, [record(clean, layout)], layout, trusted)
    assert not findings.doubts
    shown = {one.sensor for one in findings.calibrated if one.what is GAIN}
    along = {
        one.name
        for one in layout.sensors
        if one.kind is A and np.abs(sensor_matrix(MACHINE, (one,))[0][straight]).max() > 0.5
    }
    assert shown == along
    assert_intervals_hold(errors_of(findings, actual, layout)[GAIN])
    for name in along:
        assert DIRECTION not in found_of(findings, name)


def test_a_sensor_without_redundancy_stays():
    layout = Layout((*LINE.sensors[:2],))
    actual = changed(layout, 'block_displacement', gain=1.05)
    with pytest.raises(DataError, match='too few'):
        calibrate_motion(
            BLOCK, [record(readings(BLOCK, actual, motion(BLOCK)), layout)], layout, ()
        )


def test_rest_tells_nothing():
    with pytest.raises(DataError, match='no motion stands out of the noise'):
        calibrate_motion(BLOCK, [record(np.zeros((COUNT, 4)), LINE)], LINE, ('block_velocity',))


def test_a_perfect_sensor_has_no_errors_to_tell():
    silent = changed(LINE, 'block_velocity', noise=0.0)
    clean = readings(BLOCK, LINE, motion(BLOCK))
    with pytest.raises(DataError, match='states no noise'):
        calibrate_motion(BLOCK, [record(clean, silent)], silent, ('block_displacement',))


def test_amplitude_of_a_calibrator_gives_the_gain():
    layout = Layout((Sensor('ring', A, 'block', gain=0.01, offset=0.3, noise=0.05),))
    time = np.arange(4000) / RATE
    scores, errors = [], []
    for seed in range(RUNS):
        clean = 1.03 * 10 * np.sqrt(2) * np.sin(2 * np.pi * 159.155 * time + seed) + 2.0
        findings = calibrate_amplitude(
            [record(clean[:, np.newaxis], layout, seed)],
            layout,
            KnownAmplitude('ring', 10.0, 159.155),
        )
        (one,) = findings.calibrated
        scores.append((one.value - 0.0103) / one.standard_error)
        errors.append(one.standard_error)
    assert_intervals_hold(scores)
    # Of a sine in white noise: noise / root N for the root mean square.
    assert np.median(errors) == pytest.approx(0.01 * 0.05 / np.sqrt(4000) / 10, rel=0.2)
    wide = calibrate_amplitude(
        [record(clean[:, np.newaxis], layout, 0)], layout, KnownAmplitude('ring', 10.0, None, 0.02)
    )
    assert wide.calibrated[0].standard_error == pytest.approx(0.02 * 0.0103, rel=1e-2)


def test_a_line_that_is_not_there_is_no_amplitude():
    layout = Layout((Sensor('ring', A, 'block', noise=0.05),))
    with pytest.raises(DataError, match='no line of'):
        calibrate_amplitude(
            [record(np.zeros((4000, 1)), layout)], layout, KnownAmplitude('ring', 10.0, 159.0)
        )


def test_a_calibrated_stand_identifies_what_an_uncalibrated_one_misses():
    model = weak_runs.OSCILLATOR
    declared = line_layout(kinds=(D, V, A), noise={F: 0.0, D: 1e-7, V: 2.5e-5, A: 1e-2})
    actual = changed(declared, 'block_acceleration', gain=1.05, delay=30e-6)

    def run(layout, seed):
        stand = SimulatedStand(
            model, actual, (weak_runs.MULTISINE,), weak_runs.RATE, seed, 1, declared_layout=layout
        )
        return stand.read(2400 + weak_runs.SETTLING).samples[weak_runs.SETTLING :]

    findings = calibrate_motion(
        model,
        [MeasuredRecord(declared, weak_runs.RATE, run(declared, 1))],
        declared,
        ('block_displacement', 'block_velocity'),
    )
    assert not findings.doubts
    calibrated = corrected_layout(declared, findings.calibrated)
    truth = model.values[list(model.estimated)]
    covered = []
    for layout in (declared, calibrated):
        found = weak_runs.identifier_of(run(layout, 2), model, layout).estimate().parameters
        off = [abs(one.value - value) for one, value in zip(found, truth, strict=True)]
        deviations = [one.standard_deviation for one in found]
        covered.append(bool(np.all(np.array(off) < 3 * np.array(deviations))))
    assert covered == [False, True]
