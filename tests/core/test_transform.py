# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensors to motion, streaming: accuracy on known motions, gaps, losses, cutting into blocks."""

from dataclasses import replace
from itertools import pairwise

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.alignment import HALF_WIDTH
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
import numpy as np
import pytest

from tests.core.machines import blocks_of, line_layout, motion_of, oscillator, skew_machine
from tests.reference_machines import complete_layout

RATE = 2000.0
KINDS = {kind.value: kind for kind in SensorKind}
ONE = assemble(oscillator())
SKEW_MACHINE = skew_machine()
SKEW = assemble(SKEW_MACHINE)
FREQUENCIES = np.array([7.3, 41.0, 97.0])  # Hz, below a twentieth of the sample rate


def harmonic(times, derivative, columns=12):
    """Return some smooth motion of every coordinate and its derivatives."""
    generator = np.random.default_rng(1)
    amplitude = generator.uniform(0.5e-6, 2e-6, (columns, 3))
    phase = generator.uniform(0, 6, (columns, 3))
    omega = 2 * np.pi * FREQUENCIES
    angle = np.multiply.outer(times, omega)[:, np.newaxis, :] + phase + derivative * np.pi / 2
    return (amplitude * omega**derivative * np.sin(angle)).sum(axis=2)


def readings(model, layout, count, rate=RATE):
    """Return what perfect sensors with their delays record of the harmonic motion."""
    samples = np.empty((count, len(layout.sensors)))
    for channel, sensor in enumerate(layout.sensors):
        times = np.arange(count) / rate - sensor.delay
        if sensor.kind is SensorKind.FORCE:
            samples[:, channel] = 100 * np.cos(2 * np.pi * 30 * times)
            continue
        order = {'displacement': 0, 'velocity': 1, 'acceleration': 2}[sensor.kind.value]
        motion = harmonic(times, order, len(model.coordinates))
        samples[:, channel] = motion @ sensor_matrix(model, (sensor,))[0]
    return samples


def joined(motions, name):
    return np.concatenate([getattr(motion, name) for motion in motions])


def transformed(model, layout, count=600, sizes=()):
    samples = readings(model, layout, count)
    return motion_of(model, layout, blocks_of(samples, RATE, sizes))


def check(motions, model, tolerances, first):
    assert motions[0].first_index == first
    assert all(a.next_index == b.first_index for a, b in pairwise(motions))
    times = np.arange(motions[0].first_index, motions[-1].next_index) / RATE
    for order, (name, tolerance) in enumerate(
        zip(('displacement', 'velocity', 'acceleration'), tolerances, strict=True)
    ):
        expected = harmonic(times, order, len(model.coordinates))
        found = joined(motions, name)
        assert np.abs(found - expected).max() < tolerance * np.abs(expected).max()
    force = np.outer(100 * np.cos(2 * np.pi * 30 * times), model.excitation_directions[0])
    np.testing.assert_allclose(joined(motions, 'force'), force, atol=100 * tolerances[0])


def test_all_quantities_measured_are_passed_on_exactly():
    motions = transformed(SKEW, complete_layout(SKEW_MACHINE))
    check(motions, SKEW, (1e-12, 1e-12, 1e-12), 0)
    assert motions[-1].next_index == 600
    assert not motions[0].velocity_derived
    assert not motions[0].acceleration_derived


@pytest.mark.parametrize(
    ('measured', 'derived'),
    [
        (('displacement',), ('velocity', 'acceleration')),
        (('displacement', 'velocity'), ('acceleration',)),
        (('displacement', 'acceleration'), ('velocity',)),
    ],
)
def test_what_is_not_measured_is_derived_to_1e_9_below_a_twentieth_of_the_sample_rate(
    measured, derived
):
    layout = complete_layout(SKEW_MACHINE, kinds=[KINDS[name] for name in measured])
    motions = transformed(SKEW, layout)
    check(motions, SKEW, (1e-12, 1e-9, 1e-8), HALF_WIDTH)
    assert motions[0].velocity_derived == ('velocity' in derived)
    assert motions[0].acceleration_derived == ('acceleration' in derived)
    assert MotionTransform(SKEW, layout, RATE).derived == derived


@pytest.mark.parametrize('missing', [1, 4, 7, 9])
def test_partly_measured_velocity_is_completed_from_the_displacement(missing):
    sensors = complete_layout(SKEW_MACHINE).sensors
    velocity = [sensor for sensor in sensors if sensor.kind is SensorKind.VELOCITY]
    left_out = {sensor.name for sensor in velocity[:missing]}
    layout = Layout(tuple(sensor for sensor in sensors if sensor.name not in left_out))
    motions = transformed(SKEW, layout)
    derived = bool(MotionTransform(SKEW, layout, RATE).derived)
    assert derived == (missing >= 4)  # nine sensors see six motions with up to three left out
    check(motions, SKEW, (1e-12, 1e-9, 1e-12), HALF_WIDTH if derived else 0)


@pytest.mark.parametrize('delay', [3.0, 0.5, 2.37, -1.25, 11.9])
def test_known_delays_are_taken_out(delay):
    layout = complete_layout(SKEW_MACHINE)
    late = Layout(tuple(
        replace(sensor, delay=delay / RATE) if i % 3 == 1 else sensor
        for i, sensor in enumerate(layout.sensors)
    ))  # fmt: skip
    motions = transformed(SKEW, late)
    reach = abs(round(delay)) + (HALF_WIDTH if delay % 1 else 0)
    check(motions, SKEW, (1e-10, 1e-10, 1e-10), reach)


def test_delays_and_derivatives_together():
    layout = complete_layout(SKEW_MACHINE, kinds=(SensorKind.DISPLACEMENT,))
    late = Layout(tuple(replace(sensor, delay=2.3 / RATE) for sensor in layout.sensors))
    motions = transformed(SKEW, late)
    check(motions, SKEW, (1e-10, 1e-9, 1e-8), 2 * HALF_WIDTH + 2)
    assert motions[-1].next_index == 600 - 2 * HALF_WIDTH - 2


LATE = line_layout(kinds=(SensorKind.DISPLACEMENT, SensorKind.ACCELERATION), delay=1.5 / RATE)
QUANTITIES = ('displacement', 'velocity', 'acceleration', 'force')


@pytest.mark.parametrize('sizes', [[1] * 200, [2, 3, 5, 7] * 20, [64] * 4, [17, 1, 400]])
@pytest.mark.parametrize('machine', ['one', 'two'])
def test_cutting_into_blocks_does_not_change_a_bit(sizes, machine):
    model, layout = {
        'one': (ONE, LATE),
        'two': (SKEW, complete_layout(SKEW_MACHINE, kinds=(SensorKind.DISPLACEMENT,))),
    }[machine]
    samples = readings(model, layout, 450)
    whole = motion_of(model, layout, blocks_of(samples, RATE))
    parts = motion_of(model, layout, blocks_of(samples, RATE, sizes))
    for name in QUANTITIES:
        np.testing.assert_array_equal(joined(parts, name), joined(whole, name))


def test_motion_blocks_follow_each_other_and_only_the_last_is_last():
    blocks = blocks_of(readings(ONE, LATE, 300), RATE, [50] * 5, stamp_ns=5_000_000_000)
    motions = motion_of(ONE, LATE, blocks)
    assert [motion.last for motion in motions] == [False] * (len(motions) - 1) + [True]
    for earlier, later in pairwise(motions):
        assert later.first_index == earlier.next_index
    for motion in motions:
        assert motion.stamp_ns == 5_000_000_000 + motion.first_index * 500_000


def test_end_of_a_stream_too_short_for_any_motion_is_passed_on():
    motions = motion_of(ONE, LATE, blocks_of(readings(ONE, LATE, 5), RATE))
    assert [motion.last for motion in motions] == [True]
    assert motions[0].displacement.shape == (0, 1)


def test_empty_last_block_passes_the_end_on_and_loses_nothing():
    blocks = blocks_of(readings(ONE, LATE, 300), RATE, [100, 100], last=False)
    end = replace(blocks[-1], first_index=300, samples=np.empty((0, 3)), last=True)
    motions = motion_of(ONE, LATE, [*blocks, end])
    assert [motion.last for motion in motions] == [False, False, False, True]
    assert motions[-1].first_index == motions[-2].next_index


def test_nothing_is_given_out_across_a_gap():
    samples = readings(ONE, LATE, 500)
    blocks = blocks_of(samples, RATE, [50] * 9)
    transform = MotionTransform(ONE, LATE, RATE)
    motions = [transform.add(block) for block in blocks if block.first_index not in (150, 200)]
    indices = np.concatenate(
        [np.arange(motion.first_index, motion.next_index) for motion in motions if motion]
    )
    reach = 2 * HALF_WIDTH + 2
    expected = [*range(reach, 150 - reach), *range(250 + reach, 500 - reach)]
    np.testing.assert_array_equal(indices, expected)
    assert transform.follower.lost_samples == 100
    whole = motion_of(ONE, LATE, blocks)
    found = joined([motion for motion in motions if motion], 'velocity')
    np.testing.assert_array_equal(found, joined(whole, 'velocity')[indices - reach])


def test_repeated_late_and_foreign_blocks_change_nothing():
    blocks = blocks_of(readings(ONE, LATE, 300), RATE, [50] * 5)
    foreign = replace(blocks[2], stream_id=2, samples=1e9 + blocks[2].samples)
    disturbed = [*blocks[:3], blocks[2], foreign, blocks[0], *blocks[3:], blocks[5]]
    calm, found = motion_of(ONE, LATE, blocks), motion_of(ONE, LATE, disturbed)
    for name in QUANTITIES:
        np.testing.assert_array_equal(joined(calm, name), joined(found, name))


def test_restarted_source_starts_afresh():
    first = blocks_of(readings(ONE, LATE, 300), RATE, [50] * 5)
    second = [replace(block, stream_id=2) for block in first]
    transform = MotionTransform(ONE, LATE, RATE)
    motions = [transform.add(block) for block in (*first, *second)]
    count = len(first)
    for earlier, later in zip(motions[:count], motions[count:], strict=True):
        np.testing.assert_array_equal(earlier.velocity, later.velocity)
        assert later.stream_id == 2


@pytest.mark.parametrize('channel', [0, 1, 2])
def test_lost_sample_is_felt_exactly_where_the_stencils_touch_it(channel):
    layout = line_layout(kinds=(SensorKind.DISPLACEMENT, SensorKind.ACCELERATION))
    samples = readings(ONE, layout, 200)
    samples[100, channel] = np.nan
    motions = motion_of(ONE, layout, blocks_of(samples, RATE, [37, 64, 3]))
    index = np.arange(motions[0].first_index, motions[-1].next_index)
    here, near = index == 100, np.abs(index - 100) <= HALF_WIDTH
    nowhere = np.zeros_like(here)
    expected = {
        0: {'force': here},
        1: {'displacement': here, 'velocity': near},
        2: {'acceleration': here},
    }[channel]
    for name in QUANTITIES:
        lost = np.isnan(joined(motions, name)[:, 0])
        np.testing.assert_array_equal(lost, expected.get(name, nowhere))


def test_lost_sample_of_a_late_channel_is_felt_where_the_interpolation_touches_it():
    layout = line_layout()
    late = Layout(tuple(
        replace(sensor, delay=3.5 / RATE) if sensor.kind is SensorKind.VELOCITY else sensor
        for sensor in layout.sensors
    ))  # fmt: skip
    samples = readings(ONE, late, 200)
    samples[100, 2] = np.nan
    motions = motion_of(ONE, late, blocks_of(samples, RATE, [37, 64, 3]))
    index = np.arange(motions[0].first_index, motions[-1].next_index)
    lost = np.isnan(joined(motions, 'velocity')[:, 0])
    # The reading at 100 shows the instant 96.5; round half to even gives a shift of 4.
    np.testing.assert_array_equal(lost, np.abs(index + 4 - 100) <= HALF_WIDTH)
    assert not np.isnan(joined(motions, 'displacement')).any()


def test_missing_readings_are_counted_by_sensor():
    samples = readings(ONE, LATE, 200)
    samples[10:15, 1] = np.nan
    samples[90, 2] = np.nan
    transform = MotionTransform(ONE, LATE, RATE)
    for block in blocks_of(samples, RATE, [13, 50]):
        transform.add(block)
    assert transform.counts.samples_without_reading == {
        'block_displacement': 5, 'block_acceleration': 1,
    }  # fmt: skip
    assert transform.counts.blocks == 3


@pytest.mark.parametrize('delay', [0.0, 0.4])
@pytest.mark.parametrize('kinds', [('displacement',), ('displacement', 'velocity')])
def test_stated_covariances_are_the_spread_of_the_motion(kinds, delay):
    noises = dict(zip(SensorKind, (0.5, 2e-8, 1e-5, 3e-3), strict=True))
    layout = line_layout(kinds=[KINDS[name] for name in kinds], noise=noises, delay=delay / RATE)
    count = 60000
    noise = np.array([sensor.noise for sensor in layout.sensors])
    samples = noise * np.random.default_rng(11).standard_normal((count, len(noise)))
    (motion,) = motion_of(ONE, layout, blocks_of(samples, RATE))
    for name in QUANTITIES:
        stated = getattr(motion, f'{name}_covariance')[0, 0]
        assert getattr(motion, name).var() == pytest.approx(stated, rel=0.05)


@pytest.mark.parametrize('delay', [0.0, 0.4, 2.0])
def test_covariance_of_displacement_and_derived_acceleration_is_that_of_the_motion(delay):
    noises = dict(zip(SensorKind, (0.5, 2e-8, 1e-5, 3e-3), strict=True))
    count = 60000
    for kinds in (('displacement',), ('displacement', 'velocity'), tuple(KINDS)[1:]):
        layout = line_layout(
            kinds=[KINDS[name] for name in kinds], noise=noises, delay=delay / RATE
        )
        noise = np.array([sensor.noise for sensor in layout.sensors])
        samples = noise * np.random.default_rng(11).standard_normal((count, len(noise)))
        (motion,) = motion_of(ONE, layout, blocks_of(samples, RATE))
        stated = motion.displacement_acceleration_covariance[0, 0]
        both = np.cov(motion.displacement[:, 0], motion.acceleration[:, 0])
        scale = np.sqrt(both[0, 0] * both[1, 1])
        assert both[0, 1] / scale == pytest.approx(stated / scale, abs=0.02)
        # What is taken for zero: displacement, acceleration with velocity.
        velocity = motion.velocity[:, 0]
        for other in (motion.displacement[:, 0], motion.acceleration[:, 0]):
            assert abs(np.corrcoef(velocity, other)[0, 1]) < 0.02
        if 'acceleration' in kinds:
            assert stated == 0.0


def test_covariance_of_partly_derived_acceleration_of_two_bodies_is_that_of_the_motion():
    layout = complete_layout(SKEW_MACHINE, 2e-8, 3e-3, 1e-5)
    left_out = [s.name for s in layout.sensors if s.kind is SensorKind.ACCELERATION][:7]
    layout = Layout(tuple(sensor for sensor in layout.sensors if sensor.name not in left_out))
    noise = np.array([sensor.noise for sensor in layout.sensors])
    count = 40000
    samples = noise * np.random.default_rng(12).standard_normal((count, len(noise)))
    (motion,) = motion_of(SKEW, layout, blocks_of(samples, RATE))
    both = np.cov(motion.displacement.T, motion.acceleration.T)
    sizes = np.sqrt(np.diag(both))
    expected = np.block(
        [
            [motion.displacement_covariance, motion.displacement_acceleration_covariance],
            [motion.displacement_acceleration_covariance.T, motion.acceleration_covariance],
        ]
    )
    np.testing.assert_allclose(
        both / np.outer(sizes, sizes), expected / np.outer(sizes, sizes), atol=0.04
    )


def test_noise_estimate_is_not_fooled_by_a_gap_a_repetition_or_a_second_source():
    unstated = line_layout(noise=np.nan)
    samples = 1e-6 * np.random.default_rng(3).standard_normal((3000, 4))
    samples[1500:] += 1e3  # while blocks were lost
    blocks = blocks_of(samples, RATE, [300] * 9)
    foreign = replace(blocks[1], stream_id=9, samples=1e6 * blocks[1].samples)
    transform = MotionTransform(ONE, unstated, RATE)
    assert transform.noise_estimated
    assert np.isnan(transform.displacement_covariance).all()
    for block in (*blocks[:4], blocks[2], foreign, *blocks[6:]):
        motion = transform.add(block)
    assert motion.noise_estimated
    np.testing.assert_allclose(motion.displacement_covariance, 1e-12, rtol=0.3)
    np.testing.assert_array_equal(
        motion.displacement_covariance, transform.displacement_covariance
    )


def test_block_of_another_layout_or_rate_is_refused():
    transform = MotionTransform(ONE, LATE, RATE)
    (block,) = blocks_of(readings(ONE, LATE, 50), RATE)
    with pytest.raises(DataError, match='2 channels, the layout has 3'):
        transform.add(
            replace(block, samples=block.samples[:, :2], channel_status=block.channel_status[:2])
        )
    with pytest.raises(DataError, match=r'sample rate 1000\.0 Hz'):
        transform.add(replace(block, sample_rate=1000.0))


def test_layout_blind_for_a_motion_is_refused_by_name():
    sensors = complete_layout(SKEW_MACHINE).sensors
    blind = Layout(tuple(
        sensor for sensor in sensors
        if not (sensor.body == 'saddle' and sensor.kind is SensorKind.DISPLACEMENT)
    ))  # fmt: skip
    with pytest.raises(LayoutError, match='cannot see translation 1 of saddle'):
        MotionTransform(SKEW, blind, RATE)
