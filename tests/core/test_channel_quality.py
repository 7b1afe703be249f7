# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Faults that a channel shows by itself: found where they are, and nowhere else."""

from dataclasses import replace
import pickle

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import ChannelStatus
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.mark import ALL_CHANNELS
from identnl_ros.core.quality.monitor import LOOKAHEAD, monitored, QualityMonitor
from identnl_ros.core.simulation.excitation import Impulses, multisine, sine, Sweep
import numpy as np
import pytest

from tests.core.machines import blocks_of, deviations_of, values_of
from tests.core.weak_runs import exact, F, identifier_of, LAYOUT, NOISE, RATE

COUNT = 6000
SIGNALS = {
    'multisine': multisine(2.0, (5.0, 80.0), 0.5, np.random.default_rng(3)),
    'sine': sine(4.0, 23.0),
    'sweep': Sweep(2.0, (5.0, 80.0), 1.0),
    'blows': Impulses(100.0, 2.5e-3, 0.5),  # five samples
}
FORCE_NOISE = 2e-3
SENSORS = tuple(
    replace(sensor, noise=FORCE_NOISE if sensor.kind is F else NOISE[sensor.kind])
    for sensor in LAYOUT.sensors
)
FINE = replace(LAYOUT, sensors=SENSORS)
STEPS = replace(
    LAYOUT, sensors=tuple(replace(sensor, resolution=sensor.noise) for sensor in SENSORS)
)
SIGMA = np.array([sensor.noise for sensor in SENSORS])
CHANNELS = range(len(SENSORS))


@pytest.fixture(scope='module')
def clean():
    return {name: exact(signal=signal, count=COUNT) for name, signal in SIGNALS.items()}


def drawn(samples, generator, layout=FINE):
    samples = samples + SIGMA * generator.standard_normal(samples.shape)
    steps = np.array([sensor.resolution for sensor in layout.sensors])
    return np.where(steps > 0, steps * np.round(samples / np.where(steps, steps, 1)), samples)


def watched(blocks, layout=FINE, rate=RATE):
    monitor = QualityMonitor(layout, rate)
    return monitor, list(monitored(blocks, monitor))


def joined(blocks):
    return np.concatenate([block.samples for block in blocks])


def named(findings):
    return {(finding.channel, finding.condition) for finding in findings}


def local_noise(values, at):
    """Noise and what motion leaves around a sample of polynomials through 33 samples."""
    place = np.linspace(-1, 1, 33)
    return max(
        np.sqrt(np.sum((part - np.polyval(np.polyfit(place, part, 11), place)) ** 2) / 21)
        for part in (values[first : first + 33] for first in at - 16 - 33 * np.arange(8))
    )


def with_fault(samples, fault, channel, layout, generator):
    """Put a fault into a record in place; return the samples that it concerns."""
    at = int(generator.integers(1500, COUNT - 1500))
    # Spikes are told from smooth motion.
    while fault is Condition.SPIKE and local_noise(samples[:, channel], at) > 2 * SIGMA[channel]:
        at = int(generator.integers(1500, COUNT - 1500))
    size = SIGMA[channel] * generator.choice([-1, 1])
    rows = slice(at, at + 1)
    if fault is Condition.SPIKE:
        samples[at, channel] += (
            15 * size / SIGMA[channel] * max(SIGMA[channel], local_noise(samples[:, channel], at))
        )
    elif fault is Condition.STUCK:
        rows = slice(at, at + 40)
        samples[rows, channel] = samples[at, channel]
    elif fault is Condition.MISSING:
        samples[at, channel] = generator.choice([np.nan, np.inf])
    elif fault is Condition.REPEAT:
        rows = slice(at, at + 50)
        back = int(generator.integers(50, 1000))
        samples[rows] = samples[at - back : at - back + 50].copy()
    return rows


@pytest.mark.parametrize('layout', [FINE, STEPS], ids=['fine', 'steps'])
@pytest.mark.parametrize(
    'fault', [Condition.SPIKE, Condition.STUCK, Condition.MISSING, Condition.REPEAT]
)
def test_faulty_samples_are_found_and_no_others(clean, fault, layout):
    for number in range(16):
        generator = np.random.default_rng([number, int(fault), layout is STEPS])
        samples = drawn(clean[list(SIGNALS)[number % 4]], generator, layout)
        channel = int(generator.integers(len(SENSORS)))
        rows = with_fault(samples, fault, channel, layout, generator)
        monitor, blocks = watched(blocks_of(samples, RATE, [100] * 60), layout)
        everywhere = fault is Condition.REPEAT
        name = ALL_CHANNELS if everywhere else SENSORS[channel].name
        assert named(monitor.summary().findings) == {(name, fault)}, number
        expected = np.zeros(samples.shape, dtype=bool)
        expected[rows, CHANNELS if everywhere else channel] = True
        cleaned = joined(blocks)
        if fault is Condition.STUCK:
            # A sample may equal the held value before or after by chance.
            differs = np.isnan(cleaned) != expected
            assert differs.sum() <= 3
            assert not differs[:, np.arange(len(SENSORS)) != channel].any()
        elif fault is Condition.REPEAT and layout is STEPS:
            # Three channels with coarse steps need some rows before they are sure; those
            # before are left out too.
            assert np.all(np.isnan(cleaned[expected]))
        else:
            np.testing.assert_array_equal(np.isnan(cleaned), expected)
        kept = np.isfinite(cleaned)
        np.testing.assert_array_equal(cleaned[kept], samples[kept])


@pytest.mark.parametrize('layout', [FINE, STEPS], ids=['fine', 'steps'])
@pytest.mark.parametrize('signal', SIGNALS)
def test_nothing_is_found_in_good_data(clean, signal, layout):
    for seed in range(3):
        samples = drawn(clean[signal], np.random.default_rng(seed), layout)
        unknown = replace(
            layout,
            sensors=tuple(
                replace(sensor, noise=float('nan'), resolution=0.0) for sensor in layout.sensors
            ),
        )
        for one in (layout, unknown):
            monitor, blocks = watched(blocks_of(samples, RATE, [100] * 60), one)
            assert monitor.summary().findings == ()
            np.testing.assert_array_equal(joined(blocks), samples)


def test_perfect_sensors_may_rest_and_repeat_themselves(clean):
    perfect = FINE.with_noise_times(0.0)
    periodic = np.tile(clean['multisine'][-1000:], (6, 1))
    resting = np.repeat(clean['sine'][:1], 4000, axis=0)
    for samples in (clean['multisine'], clean['blows'], periodic, resting):
        monitor, blocks = watched(blocks_of(samples, RATE, [100] * 60), perfect)
        assert monitor.summary().findings == ()
        np.testing.assert_array_equal(joined(blocks), samples)


def test_blows_of_any_size_are_no_spikes(clean):
    generator = np.random.default_rng(5)
    blow = clean['blows'][1000:2000] * np.hanning(2000)[1000:][:, np.newaxis] ** 4
    for _ in range(8):
        scale = 10 ** generator.uniform(-4.5, 0, 12)[:, np.newaxis, np.newaxis]
        samples = drawn((scale * blow).reshape(-1, len(SENSORS)), generator)
        assert watched(blocks_of(samples, RATE, [500] * 24))[0].summary().findings == ()


def all_faults(clean):
    generator = np.random.default_rng(11)
    samples = drawn(np.concatenate([clean['multisine'], clean['sweep']]), generator)
    with_fault(samples, Condition.SPIKE, 1, FINE, generator)
    with_fault(samples, Condition.REPEAT, 0, FINE, generator)
    samples[6000:6400, 2] = samples[6000, 2]
    samples[7000:7300, 0] = np.nan
    samples[8000:, 1] += 8 * SIGMA[1] * generator.standard_normal(len(samples) - 8000)
    return samples


def test_result_does_not_depend_on_the_cutting_into_blocks(clean):
    samples = all_faults(clean)
    generator = np.random.default_rng(0)
    results = []
    for sizes in ([100] * 120, [1] * 500 + [37] * 300, generator.integers(1, 2000, 60), []):
        monitor, blocks = watched(blocks_of(samples, RATE, sizes))
        results.append((joined(blocks).tobytes(), monitor.summary()))
    assert len({data for data, _ in results}) == 1
    assert all(repr(summary) == repr(results[0][1]) for _, summary in results)
    assert {finding.condition for finding in results[0][1].findings} >= {
        Condition.SPIKE, Condition.REPEAT, Condition.STUCK, Condition.MISSING, Condition.LOST,
        Condition.NOISE,
    }  # fmt: skip


def test_samples_come_out_in_order_after_a_bounded_delay(clean):
    monitor = QualityMonitor(FINE, RATE)
    samples = drawn(clean['sine'], np.random.default_rng(1))
    given = 0
    for block in blocks_of(samples, RATE, [17] * 300, last=False):
        for cleaned, quality in zip(monitor.add(block), monitor.quality, strict=True):
            assert cleaned.first_index == quality.first_index == given
            given = cleaned.next_index
            assert quality.next_index == given
            assert cleaned.stamp_ns == round(cleaned.first_index / RATE * 1e9)
        assert block.next_index - given <= LOOKAHEAD


def test_nothing_excluded_means_the_same_estimate_to_the_last_bit(clean):
    samples = drawn(clean['multisine'], np.random.default_rng(3))
    _, cleaned = watched(blocks_of(samples, RATE, [100] * 60))
    raw, kept = (identifier_of(one, layout=FINE).estimate() for one in (samples, joined(cleaned)))
    np.testing.assert_array_equal(values_of(raw), values_of(kept))
    np.testing.assert_array_equal(deviations_of(raw), deviations_of(kept))


def test_a_lost_block_ends_the_run_in_front_of_it(clean):
    samples = drawn(clean['sine'], np.random.default_rng(2))
    blocks = blocks_of(samples, RATE, [100] * 60)
    del blocks[20:22]
    monitor, cleaned = watched(blocks)
    indices = np.concatenate([np.arange(one.first_index, one.next_index) for one in cleaned])
    np.testing.assert_array_equal(indices, np.r_[:2000, 2200:COUNT])
    np.testing.assert_array_equal(joined(cleaned), samples[indices])
    (finding,) = monitor.summary().findings
    assert (finding.channel, finding.condition) == (ALL_CHANNELS, Condition.GAP)
    assert (finding.first_index, finding.next_index) == (2000, 2200)
    assert '200 samples missing from 1 s on' in finding.sentence
    assert cleaned[-1].last
    assert not any(one.last for one in cleaned[:-1])


def test_a_run_shorter_than_the_delay_before_the_end_is_given_out(clean):
    samples = drawn(clean['sine'], np.random.default_rng(2))[:300]
    blocks = blocks_of(samples, RATE, [100, 100, 100])
    del blocks[1]
    monitor, cleaned = watched(blocks)
    assert [(one.first_index, one.next_index) for one in cleaned] == [(0, 100), (200, 300)]
    assert [bool(one.status[0] & Condition.GAP) for one in monitor.quality] == [False, True]


def test_end_of_the_range_is_told_by_the_full_scale_in_recorded_units(clean):
    samples = drawn(clean['sine'], np.random.default_rng(4))
    sensor = replace(SENSORS[1], gain=-2e3, offset=0.1, drift=1e-3)
    time = np.arange(COUNT) / RATE
    recorded = sensor.to_recorded(samples[:, 1], time)
    limit = 0.95 * np.abs(recorded).max()
    layout = Layout((SENSORS[0], replace(sensor, full_scale=limit), *SENSORS[2:]))
    samples[:, 1] = sensor.to_si(np.clip(recorded, -limit, limit), time)
    monitor, cleaned = watched(blocks_of(samples, RATE), layout)
    assert named(monitor.summary().findings) == {(sensor.name, Condition.SATURATED)}
    np.testing.assert_array_equal(np.isnan(joined(cleaned)[:, 1]), np.abs(recorded) >= limit)


def test_cut_peaks_are_found_without_a_full_scale(clean):
    samples = drawn(clean['sine'], np.random.default_rng(4))
    limit = 0.9 * samples[:, 1].max()
    cut = samples[:, 1] >= limit
    samples[:, 1] = np.minimum(samples[:, 1], limit)
    monitor, cleaned = watched(blocks_of(samples, RATE))
    assert named(monitor.summary().findings) == {(SENSORS[1].name, Condition.SATURATED)}
    found = np.isnan(joined(cleaned)[:, 1])
    # At first they might be steps of the converter.
    np.testing.assert_array_equal(found[1024:], cut[1024:])
    assert not np.any(found & ~cut)


def test_the_source_may_call_a_channel_saturated(clean):
    blocks = blocks_of(drawn(clean['sine'], np.random.default_rng(4)), RATE, [100] * 60)
    status = np.array([0, ChannelStatus.SATURATED, 0], dtype=np.uint8)
    blocks[30] = replace(blocks[30], channel_status=status)
    monitor, cleaned = watched(blocks)
    assert np.flatnonzero(np.isnan(joined(cleaned)[:, 1])).tolist() == list(range(3000, 3100))
    assert named(monitor.summary().findings) == {(SENSORS[1].name, Condition.SATURATED)}


@pytest.mark.parametrize('factor', [3.0, 1 / 3])
def test_noise_that_is_not_as_stated_is_told_with_its_size(clean, factor):
    generator = np.random.default_rng(6)
    record = np.concatenate([clean['multisine'], clean['multisine'][-1000:]])
    # Accelerations of this nonlinear machine reach a quarter of the sample rate.
    for channel in (0, 1):
        wrong = np.ones(len(SENSORS))
        wrong[channel] = factor
        samples = record + wrong * SIGMA * generator.standard_normal(record.shape)
        (finding,) = watched(blocks_of(samples, RATE))[0].summary().findings
        assert (finding.channel, finding.condition) == (SENSORS[channel].name, Condition.NOISE)
        # Four percent is the uncertainty of the estimate.
        assert finding.amount == pytest.approx(factor * SIGMA[channel], rel=0.2)


def test_lines_close_to_half_the_sample_rate_are_called_aliasing(clean):
    generator = np.random.default_rng(7)
    for number in range(12):
        samples = drawn(clean[list(SIGNALS)[number % 3]], generator)
        channel = number % len(SENSORS)
        phase = 2 * np.pi * generator.uniform(0.405, 0.485) * np.arange(COUNT)
        samples[:, channel] += 2 * SIGMA[channel] * np.sin(phase)
        found = named(watched(blocks_of(samples, RATE))[0].summary().findings)
        assert found == {(SENSORS[channel].name, Condition.ALIASING)}


def test_a_silent_channel_is_lost_until_it_was_valid_for_as_long(clean):
    samples = drawn(clean['multisine'], np.random.default_rng(8))
    wait = round(0.1 * RATE)
    samples[1000:1500, 2] = np.nan
    samples[3000 : 3000 + wait - 1, 2] = np.nan
    monitor, cleaned = watched(blocks_of(samples, RATE, [100] * 60))
    rows = np.flatnonzero(np.isnan(joined(cleaned)[:, 2]))
    # The sample with which it has been valid for as long is used again.
    expected = np.r_[1000 : 1500 + wait - 1, 3000 : 3000 + wait - 1]
    np.testing.assert_array_equal(rows, expected)
    quality = monitor.summary().channels[2]
    assert quality.excluded == rows.size
    assert quality.causes == {
        Condition.MISSING: 500 + wait - 1,
        Condition.LOST: wait - 1,  # after the first outage, valid but not trusted yet
    }


def test_a_channel_without_noise_is_stuck_only_while_others_move(clean):
    layout = Layout(tuple(replace(one, noise=0.0, resolution=s) for one, s in zip(
        SENSORS, 2 * SIGMA, strict=True)))  # fmt: skip
    step = 2 * SIGMA
    samples = step * np.round(clean['multisine'] / step)
    moving = samples.copy()
    moving[3000:5000, 1] = moving[3000, 1]
    resting = samples.copy()
    resting[3000:] = resting[3000]
    found = [
        watched(blocks_of(one, RATE), layout)[0].summary().findings for one in (moving, resting)
    ]
    assert (SENSORS[1].name, Condition.STUCK) in named(found[0])
    assert {channel for channel, _ in named(found[0])} == {SENSORS[1].name}
    assert found[1] == ()


def test_a_stream_may_be_played_again(clean):
    samples = all_faults(clean)
    monitor, first = watched(blocks_of(samples, RATE, [100] * 120))
    before = repr(monitor.summary().findings)
    again = list(monitored(blocks_of(samples, RATE, [100] * 120), monitor))
    assert joined(first).tobytes() == joined(again).tobytes()
    assert repr(monitor.summary().findings) == before


def test_memory_does_not_grow():
    generator = np.random.default_rng(9)
    monitor = QualityMonitor(FINE, RATE)
    sizes = []
    samples = SIGMA * generator.standard_normal((60000, len(SENSORS)))
    samples[::500, 1] += 40 * SIGMA[1]
    for number, block in enumerate(blocks_of(samples, RATE, [500] * 120, last=False)):
        monitor.add(block)
        if number in (59, 119):
            sizes.append(len(pickle.dumps(monitor)))
    assert sizes[1] < 1.05 * sizes[0]


def test_blocks_of_another_layout_are_refused(clean):
    monitor = QualityMonitor(FINE, RATE)
    (block,) = blocks_of(clean['sine'][:100], RATE)
    with pytest.raises(DataError, match='2 channels, the layout has 3'):
        monitor.add(replace(block, samples=block.samples[:, :2],
                            channel_status=block.channel_status[:2]))  # fmt: skip
    with pytest.raises(DataError, match=r'sample rate 1000\.0 Hz'):
        monitor.add(replace(block, sample_rate=1000.0))
