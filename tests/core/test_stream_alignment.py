# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Blocks of several sources become one stream, for as long as they come and whatever happens."""

from itertools import pairwise

from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.noise_level import NoiseLevel
from identnl_ros.core.synchronisation.motion_delay import noise_on_grid
from identnl_ros.core.synchronisation.resampling import Grid, resample
from identnl_ros.core.synchronisation.stream_alignment import StreamAlignment, StreamSource
import numpy as np
import pytest

from tests.core.machines import deviations_of, truth_of, values_of
from tests.core.stream_runs import (
    aligned,
    Device,
    EPOCH_NS,
    joined,
    LAYOUT,
    misalignments,
    MODEL,
    NAMES,
    play,
)
from tests.core.test_synchronisation_alignment import (
    BLOCK,
    LAYOUT as STAND_LAYOUT,
    MODEL as STAND,
    RATE as STAND_RATE,
    readings,  # noqa: F401 - a fixture
    sources_of,
)
from tests.core.weak_runs import identifier_of, statuses

PROBES, OTHERS = (0, 1, 2), (3,)
D = SensorKind.DISPLACEMENT


def pair(duration=10.0, **changes):
    """Probes that pass unchanged, and an accelerometer with another clock."""
    settings = {'skew': 40e-6, 'offset': 3e-3, 'latency': 3e-4, 'seed': 2, 'noise': 0.1}
    first = Device('probes', PROBES, 2000.0, noise=0.1)
    second = Device('accelerometers', OTHERS, 2000.0, **(settings | changes))
    return first.record(duration), second.record(duration)


def test_two_clocks_are_aligned_to_less_than_a_microsecond():
    devices = pair()
    alignment, parts = aligned(devices)
    errors = misalignments(devices, joined(parts))
    assert np.sqrt(np.mean(errors**2)) < 0.5e-6
    assert np.abs(errors).max() < 1e-6
    _, state = alignment.state
    assert state.skew == pytest.approx(40e-6, abs=0.2e-6)
    assert state.offset == pytest.approx(3e-4, abs=2e-4)  # the latency of the stamps
    assert 0 < state.deviation < 1e-6
    # Stamps begin so much too early, late, by their jitter.
    apart = parts[0].stamp_ns - EPOCH_NS - 1e9 * devices[0].time(first_row(devices, parts))
    assert abs(apart) < 4e5


def first_row(devices, parts):
    """Find the sample of the first device that the stream begins with."""
    table = np.concatenate([samples for _, _, samples in devices[0].blocks])
    return int(np.flatnonzero((table == parts[0].samples[0, list(PROBES)]).all(axis=1))[0])


def test_reference_passes_bit_for_bit():
    devices = pair(4.0)
    _, parts = aligned(devices)
    table, begin = joined(parts), first_row(devices, parts)
    original = np.concatenate([samples for _, _, samples in devices[0].blocks])
    assert 2000 * 4 - len(table) < 50
    np.testing.assert_array_equal(table[:, list(PROBES)], original[begin : begin + len(table)])


def test_what_comes_out_does_not_depend_on_the_order_of_arrival():
    devices = pair(7.0)
    _, parts = aligned(devices)
    for seed in (1, 2):
        alignment = StreamAlignment(LAYOUT, [one.source for one in devices], 2000.0, MODEL)
        other = play(alignment, devices, 'random', seed)
        assert [one.first_index for one in other] == [one.first_index for one in parts]
        assert [one.stamp_ns for one in other] == [one.stamp_ns for one in parts]
        np.testing.assert_array_equal(joined(other), joined(parts))


def test_damping_identified_from_the_aligned_stream_is_in_its_intervals(readings):  # noqa: F811
    records = sources_of(readings, 0)
    sources = [StreamSource(one.name, one.channels, one.sample_rate) for one in records]
    alignment = StreamAlignment(STAND_LAYOUT, sources, STAND_RATE, STAND, settling=0.35)
    blocks = sorted(
        (int(stamp), number, int(index))
        for number, one in enumerate(records)
        for index, stamp in zip(one.stamped, one.stamps_ns, strict=True)
    )
    parts = []
    for stamp, number, index in blocks:
        alignment.add(number, index, stamp, records[number].samples[index : index + BLOCK])
        parts.extend(alignment.take())
    table = joined([*parts, *alignment.end()])
    valid = np.flatnonzero(np.isfinite(table).all(axis=1))
    assert len(valid) > 4700
    found = identifier_of(
        table[valid[0] : valid[-1] + 1], STAND, STAND_LAYOUT, rate=STAND_RATE
    ).estimate()
    assert statuses(found) == {EstimateStatus.OK}
    scores = np.abs(values_of(found) - truth_of(STAND)) / deviations_of(found)
    assert np.all(scores < 3.3)
    # 95 % intervals of 16 parameters: at most three outside, with a probability of 0.7 %.
    assert (scores > 1.96).sum() <= 3


def test_drifting_clock_is_followed():
    devices = pair(16.0, drift=1e-6 / 60)
    _, parts = aligned(devices)
    errors = misalignments(devices, joined(parts))
    # Without being followed: 1.7e-8 / s * (16 s)^2 / 2 = 2.1 us.
    assert np.abs(errors).max() < 1e-6


def test_without_motion_stamps_go_on_with_what_motion_has_shown():
    devices = pair(9.0)
    for one in devices:
        one.until = 9.0
        one.record(9.0, begin=18000)
        # The motion ends where nobody looks: a jump of a displacement has no spectrum.
        del one.blocks[890:910]
    alignment, _ = aligned(devices)
    line_error = abs(alignment_error(alignment, devices))
    deviation = alignment.state[1].deviation
    # Of the latency 1 ms was not known, and the skew was known to 1e-7 nine seconds ago.
    assert 1e-6 < deviation < 1e-4
    assert line_error < 3 * deviation


def test_stamps_alone_are_not_enough_for_damping_and_that_is_told():
    devices = pair(4.0)
    for one in devices:
        one.until = -1.0
        one.blocks.clear()
        one.record(4.0)
    alignment, _ = aligned(devices)
    assert 0.9e-3 < alignment.state[1].deviation < 1.1e-3
    assert abs(alignment_error(alignment, devices)) < 3e-3
    assert any('changes the damping' in text for text in alignment.remarks())
    alignment, _ = aligned(devices, model=None)
    assert any('aligned by its stamps alone' in text for text in alignment.remarks())


def alignment_error(alignment, devices):
    """Error of the time at which the second source is read at last."""
    first, second = alignment.places
    return devices[1].time(second) - devices[0].time(first)


def test_silent_source_has_no_readings_until_it_is_back():
    devices = pair(10.0)
    gone = slice(500, 700)  # blocks of 10 ms; the index goes on
    del devices[1].blocks[gone]
    alignment, parts = aligned(devices)
    table = joined(parts)
    missing = np.isnan(table[:, 3])
    begin = first_row(devices, parts)
    edge = devices[1].time(5.0 * 2000.0) * 2000 - begin
    assert not np.isnan(table[:, :3]).any()
    assert missing[int(edge) + 1 : int(edge) + 3999].all()
    assert missing[: int(edge) - 70].sum() < 80
    assert missing[int(edge) + 4070 : -80].sum() == 0
    texts = ' '.join(alignment.remarks())
    assert 'accelerometers: no samples' in texts
    assert 'accelerometers: is back' in texts
    assert '4000 samples lost' in texts
    assert np.abs(misalignments(devices, table)).max() < 1e-6


def test_reference_may_fall_silent_too():
    devices = pair(10.0)
    del devices[0].blocks[400:600]
    _, parts = aligned(devices)
    table = joined(parts)
    # What is not the reference any more is interpolated.
    assert 4000 <= np.isnan(table[:, 0]).sum() < 4000 + 200
    assert np.isnan(table[1000:-1000, 3]).sum() == 0
    assert np.abs(misalignments(devices, table)).max() < 1.5e-6


def test_restarted_source_is_aligned_anew():
    devices = pair(5.0)
    device = devices[1]
    again = Device('accelerometers', OTHERS, 2000.0, 40e-6, 6.0, seed=5, noise=0.1).record(6.0)
    device.blocks.extend(again.blocks)
    devices[0].record(7.0, begin=10000)
    alignment, parts = aligned(devices)
    table = joined(parts)
    assert not np.isnan(table[:, 0]).any()
    assert np.isnan(table[11000:15500, 3]).all()
    assert not np.isnan(table[16000:23000, 3]).any()
    assert any('began anew with sample 0' in text for text in alignment.remarks())
    assert np.abs(misalignments(devices, table)).max() < 1e-6


@pytest.mark.parametrize('which', [0, 1])
def test_step_of_a_clock_is_told_and_the_source_aligned_anew(which):
    devices = pair(6.0)
    devices[1 - which].record(6.0, begin=12000)
    # 100 samples are lost and the index does not tell.
    device = devices[which]
    before, begin = device.offset, 12000
    device.offset += 0.05
    device.record(6.0, begin=begin)
    device.offset = before
    alignment, parts = aligned(devices)
    table = joined(parts)
    texts = ' '.join(alignment.remarks())
    assert f'{device.name}: its stamps jump near sample 1' in texts
    assert f'{device.name}: is aligned and has readings again' in texts
    lost = np.isnan(table[:, device.channels[-1]])
    assert 1.5 < lost.sum() / 2000 < 3.0
    other = devices[1 - which]
    assert np.isnan(table[:-200, other.channels[-1]]).sum() < 200


def test_rates_that_differ():
    probes = Device('probes', PROBES, 2000.0, noise=0.1).record(8.0)
    fast = Device('fast', OTHERS, 5120.0, skew=-30e-6, offset=-2e-3, seed=3, noise=0.1)
    devices = (probes, fast.record(8.0))
    alignment, parts = aligned(devices)
    assert np.abs(misalignments(devices, joined(parts))).max() < 1e-6
    # White noise loses what is above the grid's Nyquist frequency.
    assert alignment.layout.sensors[3].noise == pytest.approx(1e-2 * np.sqrt(2000 / 5120))
    slow = Device('slow', OTHERS, 500.0, skew=25e-6, offset=1e-3, seed=4, noise=0.1, block=0.1)
    devices = (probes, slow.record(8.0))
    alignment, parts = aligned(devices)
    assert any(
        one.startswith('slow: samples at 500 Hz, the grid at 2000 Hz; it shows nothing above 250')
        for one in alignment.remarks()
    )
    assert np.abs(misalignments(devices, joined(parts))).max() < 2e-6


def test_noise_on_the_grid_is_that_of_the_samples_given_out():
    sensors = (
        Sensor('kept', D, body='table', noise=1e-6, resolution=1.5e-6),
        Sensor('fast', D, body='table', noise=2e-6, resolution=3e-6),
        Sensor('finer', D, body='table', noise=2e-6),
    )
    rates = (1000.0, 4000.0, 1600.0)
    sources = [
        StreamSource(one.name, (one.name,), rate) for one, rate in zip(sensors, rates, strict=True)
    ]
    alignment = StreamAlignment(Layout(sensors), sources, 1000.0)
    # Known before any sample.
    told = alignment.layout.sensors
    generator = np.random.default_rng(9)
    parts = []
    for block in range(240):
        for source, (one, rate) in enumerate(zip(sensors, rates, strict=True)):
            count = round(rate / 20)
            samples = one.noise * generator.standard_normal((count, 1))
            if one.resolution:
                samples = one.resolution * np.round(samples / one.resolution)
            alignment.add(source, block * count, EPOCH_NS + block * 50_000_000, samples)
        parts += alignment.take()
    samples = np.concatenate([one.samples for one in parts])
    seen = np.nanstd(samples, axis=0)
    stated = np.hypot([one.noise for one in told], [one.resolution / 12**0.5 for one in told])
    # 10000 samples tell it to 0.7 %; low-passed noise lacks up to 2 % of its power at the top.
    np.testing.assert_allclose(seen, stated, rtol=0.04)
    assert told[0] == sensors[0]
    assert told[1].resolution == 0.0, 'sums of many steps have no steps'


@pytest.mark.parametrize('own_rate', [10e3, 10.05e3, 100e3])
def test_the_noise_told_of_the_grid_raises_no_alarm_and_that_of_the_sensor_does(own_rate):
    rate, count = 10e3, 30000
    sensor = Sensor('probe', D, body='table', noise=1e-8)
    raw = Layout((sensor,))
    noise = 1e-8 * np.random.default_rng(11).standard_normal((round(count * own_rate / rate), 1))
    table = resample(noise, Grid(700.5, own_rate / rate), count - 200)
    told = {}
    for name, layout in (('raw', raw), ('grid', noise_on_grid(raw, [own_rate], rate))):
        level = NoiseLevel(layout, rate)
        for end in range(500, len(table), 500):
            level.add(table[max(0, end - 1000) : end], 500, np.zeros(1))
        told[name] = Condition(int(level.conditions[0]))
    assert told['grid'] == Condition(0)
    assert (Condition.NOISE in told['raw']) == (own_rate > 4 * rate)


def test_blocks_of_different_lengths_hold_nobody_up():
    probes = Device('probes', PROBES, 2000.0, noise=0.1, block=1.0).record(6.0)
    others = Device('others', OTHERS, 2000.0, 40e-6, 3e-3, seed=3, noise=0.1).record(6.0)
    alignment, parts = aligned((probes, others))
    table = joined(parts)
    assert not any('no samples' in text for text in alignment.remarks())
    assert np.isfinite(table[200:-200]).all()
    assert np.abs(misalignments((probes, others), table)).max() < 1e-6


def test_clock_of_the_host_that_is_set_back_does_not_stop_the_stream():
    devices = pair(5.0)
    for one in devices:
        one.record(5.0, begin=10000)
        one.blocks = [
            (first, stamp - 10**9 * (first >= 10000), samples)
            for first, stamp, samples in one.blocks
        ]
    alignment = StreamAlignment(LAYOUT, [one.source for one in devices], 2000.0, MODEL)
    parts = []
    for blocks in zip(*(one.blocks for one in devices), strict=True):
        for number, block in enumerate(blocks):
            alignment.add(number, *block)
        parts.extend(alignment.take())
    parts.extend(alignment.end())
    assert all(
        after.first_index >= before.first_index + len(before.samples)
        for before, after in pairwise(parts)
    )
    assert np.isfinite(joined(parts)[:, 3]).sum() > 0.9 * 20000
    assert sum('its stamps jump' in text for text in alignment.remarks()) == 2
    assert alignment.state[1].skew == pytest.approx(40e-6, abs=1e-6)


def test_one_source_passes_unchanged():
    device = Device('all', (0, 1, 2, 3), 2000.0).record(1.0, begin=700)
    del device.blocks[40:50]
    alignment, parts = aligned([device])
    table = joined(parts)
    assert parts[0].first_index == 0
    for first, _, samples in device.blocks:
        np.testing.assert_array_equal(table[first - 700 : first - 500][: len(samples)], samples)
    assert np.isnan(table[800:1000]).all()
    assert alignment.remarks() == ('all: 200 samples lost',)


def test_memory_is_bounded_also_where_a_source_never_comes():
    probes, _ = pair(14.0)
    alignment = StreamAlignment(LAYOUT, [probes.source, StreamSource('a', NAMES[3:], 2e3)], 2e3)
    sizes = []
    parts = play(alignment, [probes], each=lambda one: sizes.append(len(one._streams[0].samples)))
    assert max(sizes) < 6 * 2000
    assert np.isnan(joined(parts)[:, 3]).all()
    assert any('has sent nothing' in text for text in alignment.remarks())


def test_sources_that_do_not_overlap_are_refused():
    devices = pair(3.0, offset=100.0)
    with pytest.raises(DataError, match='accelerometers: by the stamps it begins'):
        aligned(devices)


def test_misuse_is_told():
    probes, others = (one.source for one in pair(0.1))
    with pytest.raises(DataError, match='every sensor of the layout in one source'):
        StreamAlignment(LAYOUT, [probes], 2000.0)
    with pytest.raises(DataError, match='sample rate is 0'):
        StreamAlignment(LAYOUT, [probes, others], 0.0)
    alignment = StreamAlignment(LAYOUT, [probes, others], 2000.0)
    with pytest.raises(DataError, match='one column for each of its 3 channels'):
        alignment.add(0, 0, EPOCH_NS, np.zeros((10, 2)))
    for device in pair(0.02):
        number = 0 if device.name == 'probes' else 1
        for block in device.blocks:
            alignment.add(number, *block)
    with pytest.raises(DataError, match='fewer than 3 blocks'):
        alignment.end()
