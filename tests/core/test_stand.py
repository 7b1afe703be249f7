# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated stand: reproducible, and its imperfections are those that were asked for."""

from dataclasses import replace

from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.blocks import ChannelStatus
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine, sine, Sweep
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest
from scipy.stats import kstest

from tests.core.machines import known, line_layout, oscillator, slideway, X, Z

RATE = 1000.0
MODEL = assemble(oscillator(known(2.0), known(4e4), known(60.0)))
SIGNAL = multisine(5.0, (5.0, 100.0), 1.0, np.random.default_rng(8))


def stand(layout=None, seed=3, rate=RATE, signal=SIGNAL, model=MODEL, **settings):
    return SimulatedStand(model, layout or line_layout(), (signal,), rate, seed, 77, **settings)


def changed(layout, name, **changes):
    return Layout(
        tuple(
            replace(sensor, **changes) if sensor.name == name else sensor
            for sensor in layout.sensors
        )
    )


NOISY = line_layout(noise=1e-3, dropout_probability=0.01)


def test_a_seed_gives_the_same_bytes_again_and_another_seed_others():
    first, again, other = (stand(NOISY, seed).read(1500).samples for seed in (3, 3, 4))
    assert first.tobytes() == again.tobytes()
    assert np.all((first != other) | np.isnan(first))


@pytest.mark.parametrize('sizes', [[1] * 40, [512, 512], [511, 2, 700], [3000], [7, 0, 13]])
def test_sizes_of_the_blocks_do_not_change_a_bit(sizes):
    delayed = changed(NOISY, 'block_velocity', delay=2.3e-3)
    whole = stand(delayed).read(sum(sizes)).samples
    source = stand(delayed)
    parts = [source.read(size).samples for size in sizes]
    assert np.concatenate(parts).tobytes() == whole.tobytes()


@pytest.mark.parametrize('sizes', [[1] * 40, [511, 2, 700], [3000], [100] * 20])
def test_sizes_of_the_blocks_do_not_change_a_bit_where_the_machine_hardens(sizes):
    # The steps of the integration grow on the way, by what the motion has been so far.
    hardening = assemble(oscillator(known(2.0), known(4e3), known(60.0), None, known(1e16)))
    swelling = Sweep(5.0, (1.0, 40.0), 5.0)
    delayed = changed(NOISY, 'block_velocity', delay=2.3e-3)
    settings = {'model': hardening, 'signal': swelling}
    whole = stand(delayed, **settings).read(3000).samples
    source = stand(delayed, **settings)
    parts = np.concatenate([source.read(size).samples for size in sizes])
    assert parts.tobytes() == whole[: len(parts)].tobytes()


def test_blocks_carry_index_time_stream_and_end():
    source = stand(stamp_ns=1_700_000_000_123_456_789, rate=3000.0)
    blocks = [source.read(7), source.read(4), source.read(2, last=True)]
    assert [block.first_index for block in blocks] == [0, 7, 11]
    assert [block.last for block in blocks] == [False, False, True]
    assert {block.stream_id for block in blocks} == {77}
    stamps = [block.stamp_ns - 1_700_000_000_123_456_789 for block in blocks]
    assert stamps == [0, 2_333_333, 3_666_667]


def test_block_given_out_is_not_changed_later():
    source = stand(NOISY)
    block = source.read(10)
    before = block.samples.copy()
    source.read(2000)
    np.testing.assert_array_equal(block.samples, before)


def test_perfect_sensors_show_the_motion_at_their_point_along_their_direction():
    tilted = Sensor('tilted', SensorKind.DISPLACEMENT, 'block', direction=X + Z)
    layout = Layout((*line_layout().sensors, tilted))
    samples = stand(layout).read(800).samples
    force, displacement, velocity, acceleration, along = samples.T
    np.testing.assert_allclose(force, SIGNAL.on_grid(0, 1 / RATE, 800), atol=1e-10)
    left = 2.0 * acceleration + 60.0 * velocity + 4e4 * displacement
    np.testing.assert_allclose(left, force, atol=1e-9)
    np.testing.assert_allclose(along, displacement / np.sqrt(2), rtol=1e-12)


def test_noise_is_white_normal_and_as_large_as_stated():
    noises = dict(zip(SensorKind, (0.5, 2e-6, 1e-4, 3e-2), strict=True))
    count = 20000
    clean = stand().read(count).samples
    noise = stand(line_layout(noise=noises)).read(count).samples - clean
    correlation = np.corrcoef(np.hstack((noise[:-1], noise[1:])).T) - np.eye(8)
    assert np.abs(correlation).max() < 4.5 / np.sqrt(count)
    for column, size in zip(noise.T, noises.values(), strict=True):
        assert kstest(column / size, 'norm').pvalue > 1e-4
        assert column.std() == pytest.approx(size, rel=4.5 / np.sqrt(2 * count))


def test_sensor_of_unknown_noise_is_simulated_without():
    samples = [stand(line_layout(noise=noise)).read(100).samples for noise in (0.0, np.nan)]
    np.testing.assert_array_equal(*samples)


def test_quantised_readings_are_the_nearest_steps():
    step = 1e-7
    clean = stand().read(2000).samples[:, 1]
    found = stand(changed(line_layout(), 'block_displacement', resolution=step))
    found = found.read(2000).samples[:, 1]
    np.testing.assert_allclose(found / step, np.round(found / step), atol=1e-6)
    assert np.abs(found - clean).max() <= step / 2 * (1 + 1e-9)
    assert len(np.unique(found)) > 20


def test_lost_samples_are_nan_as_often_as_stated_and_flagged():
    layout = changed(line_layout(), 'block_velocity', dropout_probability=0.03)
    source = stand(layout)
    blocks = [source.read(10) for _ in range(2000)]
    lost = np.isnan(np.concatenate([block.samples for block in blocks]))
    assert not lost[:, [0, 1, 3]].any()
    count = lost[:, 2].sum()
    assert abs(count - 600) < 4.5 * np.sqrt(600 * 0.97)
    for block in blocks:
        expected = ChannelStatus.MISSING_SAMPLES if np.isnan(block.samples[:, 2]).any() else 0
        assert block.channel_status.tolist() == [0, 0, expected, 0]


def test_dropouts_do_not_change_the_noise_of_the_samples_that_remain():
    with_losses, without = (
        stand(line_layout(noise=1e-3, dropout_probability=p)).read(1000).samples
        for p in (0.1, 0.0)
    )
    kept = ~np.isnan(with_losses)
    np.testing.assert_array_equal(with_losses[kept], without[kept])


@pytest.mark.parametrize('tenths', [0, 10, 30, 1, 7, 23, 5130])
def test_delayed_sensors_show_exactly_what_was_there_before(tenths):
    # The undelayed stand, sampled ten times as fast, has every delayed instant.
    count = 700
    late = line_layout(delay=tenths / (10 * RATE))
    found = stand(late).read(count).samples
    fine = stand(rate=10 * RATE).read(10 * count).samples
    instants = 10 * np.arange(count) - tenths
    started = instants >= 0
    scale = np.abs(fine).max(axis=0)
    error = np.abs(found[started] - fine[instants[started]]) / scale
    assert error.max() < 1e-9
    np.testing.assert_array_equal(found[~started], 0.0)


def test_before_the_start_sensors_show_the_state_of_rest():
    gravity = np.array([0.0, 0.0, -9.81])
    machine = oscillator(known(2.0), known(4e4), known(60.0), gravity=9.81 * X)
    assert np.array_equal(gravity[:2], [0, 0])
    late = line_layout(delay=3.5e-3)
    samples = stand(late, model=assemble(machine)).read(10).samples
    np.testing.assert_allclose(
        samples[:4], np.tile([0, 2.0 * 9.81 / 4e4, 0, 0], (4, 1)), atol=1e-15
    )


def test_machine_stays_at_rest_until_the_force_acts():
    machine = oscillator(
        known(2.0), known(4e4), known(60.0), gravity=9.81 * X,
        more_joints=(slideway(normal=X, longitudinal=Z, normal_stiffness=known(1e10)),),
    )  # fmt: skip
    samples = stand(model=assemble(machine), signal=sine(0.0, 1.0)).read(2000).samples
    np.testing.assert_allclose(samples[:, 1], samples[0, 1], rtol=1e-9)
    assert np.abs(samples[:, 3]).max() < 1e-9


@pytest.mark.parametrize(('actual', 'declared'), [(2.0, 2.2), (-0.5, 0.5), (1.0, 1.0)])
def test_wrong_gain_and_offset_in_the_declared_layout_scale_and_shift_the_readings(
    actual, declared
):
    names = ('block_displacement', 'block_acceleration')
    real, believed = line_layout(), line_layout()
    for name in names:
        real = changed(real, name, gain=actual, offset=0.3)
        believed = changed(believed, name, gain=declared, offset=0.1)
    clean = stand().read(300).samples
    source = stand(real, declared_layout=believed)
    assert source.layout is believed
    found = source.read(300).samples
    expected = clean.copy()
    expected[:, [1, 3]] = (actual * clean[:, [1, 3]] + 0.3 - 0.1) / declared
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-18)


def test_sensor_with_any_gain_reads_si_where_the_layout_is_right():
    odd = changed(line_layout(), 'block_displacement', gain=-37.0, offset=12.0)
    np.testing.assert_array_equal(stand(odd).read(50).samples, stand().read(50).samples)


def test_drift_that_the_declared_layout_lacks_grows_from_the_begin_of_the_stream():
    drifting = changed(line_layout(), 'block_displacement', gain=1e6, drift=0.2)
    believed = changed(line_layout(), 'block_displacement', gain=1e6)
    source = stand(drifting, declared_layout=believed)
    found = np.concatenate([source.read(count).samples for count in (700, 500)])
    clean = stand().read(1200).samples
    rate = source.read(1).sample_rate
    np.testing.assert_allclose((found - clean)[:, 1], 0.2e-6 * np.arange(1200) / rate, atol=1e-15)
    record = MeasuredRecord(believed, rate, found).part(300, 1200)
    np.testing.assert_allclose(reread(record, drifting).samples[:, 1], clean[300:, 1], atol=1e-15)


def test_declared_layout_with_other_channels_is_refused():
    fewer = Layout(line_layout().sensors[:-1])
    with pytest.raises(LayoutError):
        stand(declared_layout=fewer).read(10)


def test_early_sensors_cannot_be_simulated():
    with pytest.raises(LayoutError, match='block_velocity: a simulated sensor cannot be early'):
        stand(changed(line_layout(), 'block_velocity', delay=-1e-3))


def test_force_sensor_of_an_exciter_that_is_not_there_is_refused():
    with pytest.raises(LayoutError, match='cell: the machine has no excitation "hammer"'):
        stand(changed(line_layout(), 'cell', excitation='hammer'))
