# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Accelerometers that read gravity: at rest, tilted, and in every estimator."""

from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.diagnosis import diagnose, Verdict
from identnl_ros.core.discrepancy.motion_channels import MotionChannels
from identnl_ros.core.errors import LayoutError
from identnl_ros.core.likelihood.likelihood import fit_likelihood
from identnl_ros.core.measurement.added_reading import gravity_reading
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.joints import GROUND, SpringDamper
from identnl_ros.core.mechanics.kinematics import body_motion
from identnl_ros.core.mechanics.machine import (
    Body,
    ConstantForce,
    ExcitationPoint,
    Machine,
    STANDARD_GRAVITY,
)
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.synchronisation.delay_estimate import source_delays
from identnl_ros.core.validation.agreement import Agreement
from identnl_ros.core.validation.validation import Validation
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.core.machines import (
    blocks_of,
    deviations_of,
    identified,
    known,
    line_layout,
    motion_of,
    ORIGIN,
    oscillator,
    truth_of,
    unknown,
    values_of,
    X,
    Z,
)

RATE = 500.0
GRAVITY = np.array(STANDARD_GRAVITY)
D, A, F = SensorKind.DISPLACEMENT, SensorKind.ACCELERATION, SensorKind.FORCE
NOISE = {F: 0.0, D: 2e-6, A: 2e-3}
SIGNAL = multisine(20.0, (0.5, 12.0), 4.0, np.random.default_rng(5))


def rocker(forces=(), motions=('translation_1', 'rotation_2')):
    """
    Describe a mast that slides along x and rocks about y: 3 and 7 Hz.

    At these frequencies, what tilt makes an accelerometer read is several per cent of what
    acceleration does.
    """
    mast = Body('mast', known(20.0), 0.5 * Z, np.diag([3.0, 2.0, 1.0]), motions)
    stiffness = (unknown(2e4), *map(known, (1.0, 1.0, 1.0)), unknown(2500.0))
    damping = (unknown(30.0), *map(known, (1.0, 1.0, 1.0)), unknown(4.0))
    foot = SpringDamper('foot', 'mast', GROUND, ORIGIN, np.eye(3), stiffness, damping)
    shaker = ExcitationPoint('shaker', 'mast', np.array([0.0, 0.0, 0.8]), X)
    return Machine('rocker', (mast,), (foot,), (shaker,), forces)


MODEL = assemble(rocker())
PLACES = (('low', ORIGIN, X), ('high', Z, X), ('side', np.array([0.4, 0.0, 0.5]), Z))


def rocker_layout(reads_gravity=True):
    sensors = [Sensor('cell', F, excitation='shaker', noise=NOISE[F])]
    for name, point, direction in PLACES:
        sensors.append(Sensor(f'{name}_d', D, 'mast', point, direction, noise=NOISE[D]))
        sensors.append(
            Sensor(
                f'{name}_a', A, 'mast', point, direction, noise=NOISE[A],
                reads_gravity=reads_gravity,
            )
        )  # fmt: skip
    return Layout(tuple(sensors))


DC, AC = rocker_layout(True), rocker_layout(False)
FREE_OF_GRAVITY = replace(
    AC,
    sensors=tuple(
        replace(one, offset=-float(one.direction @ GRAVITY)) if one.kind is A else one
        for one in AC.sensors
    ),
)
"""Of sensors whose constant part was taken out with the offset, as calibrated at rest."""


def measured(layout, seed=1, declared=None, count=6000, model=MODEL):
    stand = SimulatedStand(model, layout, (SIGNAL,), RATE, seed, 1, declared_layout=declared)
    return stand.read(count + 200).samples[200:]


def weak(samples, layout):
    identifier = WeakIdentifier(MODEL)
    for motion in motion_of(MODEL, layout, blocks_of(samples, RATE)):
        identifier.add(motion)
    return identifier.estimate()


def test_at_rest_an_accelerometer_reads_minus_gravity_along_its_axis():
    level = SimulatedStand(MODEL, DC.with_noise_times(0), (SIGNAL,), RATE, 1, 1)
    reading = dict(zip((one.name for one in DC.sensors), level.read(1).samples[0], strict=True))
    shaken = SimulatedStand(MODEL, AC.with_noise_times(0), (SIGNAL,), RATE, 1, 1).read(1)
    assert reading['side_a'] == pytest.approx(9.80665 + shaken.samples[0, 6])
    assert reading['high_a'] == pytest.approx(shaken.samples[0, 4], abs=1e-12)


@pytest.mark.parametrize('kind', ['weight', 'force'])
def test_a_tilted_body_at_rest_reads_gravity_along_the_turned_axis(kind):
    push = ConstantForce('push', 'saddle', ORIGIN, np.array([1.0, -2.0, 0.5]), known(3e4))
    down = np.array([1.0, 2.0, -9.0]) if kind == 'weight' else None
    turn = Rotation.from_rotvec([0.5, -0.3, 0.7]).as_matrix()
    saddle = Body(
        'saddle', known(120.0), np.array([0.2, 0.1, 0.75]), turn @ np.diag([3, 7, 8.5]) @ turn.T
    )
    rail = SpringDamper(
        'rail', 'saddle', GROUND, np.array([0.3, -0.1, 0.4]), turn.T,
        tuple(map(known, (5e7, 4e7, 3e7, 8e6, 5e6, 9e6))),
    )  # fmt: skip
    machine = Machine('skew', (saddle,), (rail,), (), (push,), down)
    model = assemble(machine)
    gravity = GRAVITY if down is None else down
    axes = [
        Sensor(f'axis_{i}', A, 'saddle', np.array([0.3, 0.1, 0.9]), axis, reads_gravity=True)
        for i, axis in enumerate(Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix())
    ]
    late = [replace(axes[-1], name='late', delay=0.0123)]
    layout = Layout((*axes, *late), gravity=gravity)
    samples = SimulatedStand(model, layout, (), RATE, 1, 1).read(20).samples
    rest = static_equilibrium(model)
    for reading, sensor in zip(samples.T, layout.sensors, strict=True):
        motion = body_motion(machine, model.coordinates, sensor.body, ORIGIN)
        angle = motion[3:] @ rest
        assert 1e-5 < np.linalg.norm(angle) < 3e-3
        turned = Rotation.from_rotvec(angle).apply(sensor.direction)
        # Rotations are small to first order: the square of the angle is left.
        size = np.linalg.norm(gravity) * angle @ angle
        np.testing.assert_allclose(reading, -turned @ gravity, atol=size, rtol=0)
        assert np.abs(reading + sensor.direction @ gravity).min() > 20 * size


def test_transform_takes_out_constant_and_tilt_exactly():
    clean = DC.with_noise_times(0)
    with_delay = replace(
        clean,
        sensors=tuple(replace(one, delay=2.0 / RATE) if one.kind is A else one
                      for one in clean.sensors),
    )  # fmt: skip
    expected = motion_of(MODEL, AC, blocks_of(measured(AC.with_noise_times(0)), RATE))[0]
    for layout in (clean, with_delay):
        found = motion_of(MODEL, layout, blocks_of(measured(layout), RATE))[0]
        begin = found.first_index - expected.first_index
        same = expected.acceleration[begin : begin + len(found.acceleration)]
        assert np.abs(same).max() > 0.5
        np.testing.assert_allclose(found.acceleration, same, rtol=0, atol=1e-11)


@pytest.mark.parametrize('estimator', ['weak', 'pointwise', 'likelihood'])
def test_estimates_are_those_of_sensors_that_do_not_read_gravity(estimator):
    found = []
    for layout in (DC, AC):
        samples = measured(layout)
        if estimator == 'likelihood':
            record = MeasuredRecord(layout, RATE, samples[:3000])
            fit = fit_likelihood(MODEL.with_unknowns(1.1 * truth_of(MODEL)), [record])
            found.append((fit.values, np.sqrt(np.diag(fit.covariance))))
            continue
        estimate = (
            weak(samples, layout)
            if estimator == 'weak'
            else identified(MODEL, layout, blocks_of(samples, RATE))
        )
        found.append((values_of(estimate), deviations_of(estimate)))
    (one, deviations), (other, _) = found
    # The noise of the probes comes in with the tilt.
    np.testing.assert_array_less(np.abs(one - other), 0.05 * deviations)
    if estimator != 'pointwise':
        np.testing.assert_array_less(np.abs(one - truth_of(MODEL)), 4 * deviations)


@pytest.mark.parametrize('estimator', ['weak', 'likelihood'])
def test_offset_alone_leaves_the_tilt_which_biases_a_soft_machine(estimator):
    samples = measured(DC, declared=FREE_OF_GRAVITY)
    if estimator == 'weak':
        estimate = weak(samples, FREE_OF_GRAVITY)
        error = values_of(estimate) - truth_of(MODEL)
        assert np.abs(error / deviations_of(weak(measured(DC), DC))).max() > 10
        return
    start = MODEL.with_unknowns(1.1 * truth_of(MODEL))
    fit = fit_likelihood(start, [MeasuredRecord(FREE_OF_GRAVITY, RATE, samples[:3000])])
    assert np.abs((fit.values - truth_of(MODEL)) / np.sqrt(np.diag(fit.covariance))).max() > 10
    assert fit.excess > 100
    right = fit_likelihood(start, [MeasuredRecord(DC, RATE, measured(DC)[:3000])])
    assert abs(right.excess) < 4


def test_clean_likelihood_returns_the_truth_to_nine_digits():
    clean = DC.with_noise_times(0)
    record = MeasuredRecord(clean, RATE, measured(clean, count=2000))
    fit = fit_likelihood(MODEL.with_unknowns(1.1 * truth_of(MODEL)), [record])
    np.testing.assert_allclose(fit.values, truth_of(MODEL), rtol=1e-9)


def test_validation_agrees_and_finds_fault_where_gravity_is_not_told_of():
    size = len(truth_of(MODEL))
    for declared, agrees in ((DC, True), (FREE_OF_GRAVITY, False)):
        run = Validation(MODEL, np.zeros((size, size)), declared, RATE)
        run.add(MeasuredRecord(declared, RATE, measured(DC, declared=declared, count=3000)))
        assert Agreement((run.comparison(),)).agrees is agrees


def test_diagnosis_finds_nothing_where_nothing_is_and_a_wrong_gain_where_it_is():
    description = Description(rocker(), DC)
    for name in ('', 'side_a'):
        actual = replace(
            DC,
            sensors=tuple(
                replace(one, gain=1.03) if one.name == name else one for one in DC.sensors
            ),
        )
        samples = measured(actual, declared=DC, count=3072)
        found = diagnose(
            description, MODEL.with_unknowns(1.1 * truth_of(MODEL)),
            MeasuredRecord(DC, RATE, samples, first_index=200),
        )  # fmt: skip
        if not name:
            assert found.verdict is Verdict.COMPLETE
            continue
        # Gravity is the best calibration there is: three per cent of it tell the gain.
        assert found.verdict is Verdict.EXPLAINED
        assert [one.hypothesis.key for one in found.named] == [('sensor_gain', name)]
        assert found.named[0].size == pytest.approx(0.03, rel=0.01)


def test_channels_of_motion_hold_all_that_motion_can_do_where_tilt_is_no_translation():
    # A body that only rocks: tilt reads alike at all heights, acceleration does not.
    model = assemble(rocker(motions=('rotation_2',)))
    sensors = tuple(one for one in DC.sensors if one.kind is A)
    rows = [(2, [0, 1, 2], sensor_matrix(model, sensors))]
    _, tilt = gravity_reading(model, sensors, GRAVITY).among(3)
    noise = np.array([1.0, 2.0, 0.5])
    channels = MotionChannels(rows, noise, tilt)
    motion = np.random.default_rng(2).normal(size=(5, 3, 1, 1))
    readings = motion[:, 2, :, 0] @ rows[0][2].T + motion[:, 0, :, 0] @ tilt.T
    expected = channels.of_readings(readings)
    assert channels.count == 2
    np.testing.assert_allclose(channels.of_motion(motion)[0], expected[:2], atol=1e-12)
    np.testing.assert_allclose(expected[2], 0.0, atol=1e-12)
    np.testing.assert_allclose(channels.turn.T @ channels.turn, np.eye(3), atol=1e-12)


def test_delays_between_sources_do_not_depend_on_the_constant_of_gravity():
    model = assemble(oscillator())
    noise = {F: 0.0, D: 1e-8, SensorKind.VELOCITY: 2e-6, A: 1e-2}
    layout = line_layout(noise=noise)
    reading = replace(layout, gravity=np.array([-9.8, 0.0, 0.0]), sensors=tuple(
        replace(one, reads_gravity=True) if one.kind is A else one for one in layout.sensors
    ))  # fmt: skip
    signal = multisine(20.0, (5.0, 150.0), 1.0, np.random.default_rng(5))
    found = []
    for one in (layout, reading):
        samples = SimulatedStand(model, one, (signal,), 5000.0, 1, 1).read(4000).samples
        record = MeasuredRecord(one, 5000.0, samples)
        found.append(source_delays(model, record, ([1, 2], [3]), ('slow', 'fast')))
    first, second = (one.delays[1] for one in found)
    assert samples[:, 3].mean() == pytest.approx(9.8, abs=0.2)
    assert abs(first - second) < 1e-10


def test_layout_whose_gravity_points_elsewhere_than_the_machine_is_refused():
    machine = replace(rocker(), gravity=np.array([0.0, -9.81, 0.0]))
    with pytest.raises(LayoutError, match=r'gravity is .* but that of machine rocker is'):
        MotionTransform(assemble(machine), DC, RATE)
    MotionTransform(assemble(machine), AC, RATE)
    local = replace(rocker(), gravity=np.array([0.0, 0.0, -9.78]))
    MotionTransform(assemble(local), DC, RATE)
