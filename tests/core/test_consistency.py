# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Channels that contradict the motion of rigid bodies are named; all others are let pass."""

from dataclasses import replace

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.complete_layout import complete_layout, TYPICAL_NOISE
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.quality.channel_comparison import BandSums
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.consistency import Consistency
from identnl_ros.core.quality.consistency_spectra import bridged, CORRELATED, Spectra
from identnl_ros.core.quality.contradictions import Contradictions
from identnl_ros.core.quality.equal_pairs import pair_drops
from identnl_ros.core.quality.gain_limits import gain_limits
from identnl_ros.core.quality.leave_one_out import leave_one_out
from identnl_ros.core.quality.long_windows import LongWindows, StretchSums, together
from identnl_ros.core.quality.redundancy import redundancy
from identnl_ros.core.synchronisation.segment_spectra import segment_spectra
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
from identnl_ros.storage.shipped import shipped_config
import numpy as np
import pytest
from scipy.stats import binom, kstest

from tests.core.machines import line_layout, oscillator

D, V, A, F = (
    SensorKind.DISPLACEMENT,
    SensorKind.VELOCITY,
    SensorKind.ACCELERATION,
    SensorKind.FORCE,
)
ORDER = {D: 0, V: 1, A: 2}
MODEL = assemble(load_machine(shipped_config('knee_column.yaml')).machine)
LAYOUT = load_layout(shipped_config('knee_column_layout.yaml')).layout
NAMES = [sensor.name for sensor in LAYOUT.sensors]
RATE = 2000.0
LINES = np.arange(5.0, 200.0, 2.5)
BLOCK = assemble(oscillator())


def motion_of(model, layout, lines=LINES, seconds=2.0, seed=0, rate=RATE, late=0.0):
    """
    Give readings of a random periodic motion of all coordinates, in closed form.

    Accelerations of about 0.1 m/s^2 per line. Forces are not of this motion.
    """
    time = np.arange(round(seconds * rate)) / rate
    generator = np.random.default_rng(seed)
    shape = (len(model.coordinates), len(lines))
    omega = 2 * np.pi * np.asarray(lines)
    random = generator.normal(size=shape) + 1j * generator.normal(size=shape)
    amplitudes = 0.1 * random / omega**2
    samples = np.zeros((len(time), len(layout.sensors)))
    for i, sensor in enumerate(layout.sensors):
        if sensor.kind is F:
            continue
        row = sensor_matrix(model, (sensor,))[0]
        own = (row @ amplitudes) * (1j * omega) ** ORDER[sensor.kind]
        delay = sensor.delay + (late if np.ndim(late) == 0 else late[i])
        samples[:, i] = (np.exp(1j * np.outer(time - delay, omega)) @ own).real
    return samples


CLEAN = motion_of(MODEL, LAYOUT)


def in_phase(shape, layout=LAYOUT):
    """Give readings of a motion of 40 Hz, all coordinates in phase: accelerations of a shape."""
    time = np.arange(4000) / RATE
    samples = np.zeros((len(time), len(layout.sensors)))
    omega = 2 * np.pi * 40.0
    for i, sensor in enumerate(layout.sensors):
        if sensor.kind is not F:
            own = sensor_matrix(MODEL, (sensor,))[0] @ shape / omega**2
            phase = omega * (time - sensor.delay) + ORDER[sensor.kind] * np.pi / 2
            samples[:, i] = own * omega ** ORDER[sensor.kind] * np.cos(phase)
    return samples


def random_shape(seed):
    sizes = [1 if 'translation' in name else 0.1 for name in MODEL.coordinate_names]
    return np.random.default_rng(seed).normal(size=len(sizes)) * sizes


def passed(
    change=None,
    seconds=9.0,
    model=MODEL,
    layout=LAYOUT,
    clean=CLEAN,
    seed=1,
    factor=1.0,
    block=997,
):
    """Let a stream pass; returns what watches it."""
    watch = Consistency(model, layout, RATE)
    noise = np.array([TYPICAL_NOISE[one.kind] if np.isnan(one.noise) else one.noise
                      for one in layout.sensors])  # fmt: skip
    generator = np.random.default_rng(seed)
    count = round(seconds * RATE)
    readings = clean[np.arange(count) % len(clean)].copy()
    if change is not None:
        readings = change(readings, np.arange(count) / RATE)
    readings += factor * noise * generator.standard_normal(readings.shape)
    for begin in range(0, count, block):
        watch.add(begin, readings[begin : begin + block])
    return watch


def said(watch):
    return {(one.channel, one.condition) for one in watch.findings()}


def times(**factors):
    def change(readings, time):
        for name, factor in factors.items():
            readings[:, NAMES.index(name)] *= factor
        return readings

    return change


def exchanged(one, other):
    def change(readings, time):
        pair = [NAMES.index(one), NAMES.index(other)]
        readings[:, pair] = readings[:, pair[::-1]]
        return readings

    return change


def plus(name, signal):
    def change(readings, time):
        readings[:, NAMES.index(name)] += signal(time)
        return readings

    return change


# Mathematics.


def test_errors_are_those_of_fits_without_the_channel():
    generator = np.random.default_rng(3)
    rows = generator.normal(size=(9, 4)) * [1, 10, 0.1, 1]
    variance = generator.uniform(0.1, 10, size=(2, 9))
    used = np.ones(9, dtype=bool)
    used[6] = False
    found = leave_one_out(rows, variance, used)
    readings = generator.normal(size=9)
    for band in range(2):
        for i in range(9):
            others = [j for j in range(9) if j != i and used[j]]
            root = 1 / np.sqrt(variance[band, others])
            fit, *_ = np.linalg.lstsq(rows[others] * root[:, None], readings[others] * root)
            expected = readings[i] - rows[i] @ fit
            np.testing.assert_allclose(found.errors[band, i] @ readings, expected, rtol=1e-9)
            # The variance of this difference, from the fit's covariance.
            cov = np.linalg.inv((rows[others] * (root**2)[:, None]).T @ rows[others])
            np.testing.assert_allclose(
                found.variance[band, i], variance[band, i] + rows[i] @ cov @ rows[i]
            )
    assert found.told.all()


def test_a_channel_that_nothing_else_sees_is_not_told():
    rows = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    found = leave_one_out(rows, np.ones((1, 3)), np.ones(3, dtype=bool))
    assert found.told.tolist() == [True, True, False]
    # Without the first, the second has nothing to be compared with; the first still has.
    found = leave_one_out(rows, np.ones((1, 3)), np.array([False, True, True]))
    assert found.told.tolist() == [True, False, False]


def test_spectra_are_those_of_windows_that_are_differentiated():
    # The other module multiplies by derivatives of the window, in the time domain.
    layout = line_layout(kinds=(D, V, A), noise={D: 1e-9, V: 1e-7, A: 1e-3, F: 1.0})
    readings = motion_of(BLOCK, layout, seconds=10.24) + 0.01
    record = MeasuredRecord(layout, RATE, readings)
    other = segment_spectra(BLOCK, record)
    assert other.length == 2048
    spectra = Spectra(layout, redundancy(BLOCK, layout).orders, RATE)
    assert spectra.length == 2048
    chunk = next(spectra.add(0, readings))
    wanted = [i for i, begin in enumerate(other.begins) if begin % 1024 == 0][:5]
    band = 8
    places = spectra.bands[band]
    bins = np.round(spectra.frequencies[places] / RATE * 2048).astype(int)
    own = other.spectra[wanted][:, np.isin(other.bins, bins)]
    assert own.shape[1] == len(places)
    expected = np.einsum('kfc,kfd->cd', own, own.conj()).real
    found = chunk.products[band][np.ix_(other.channels, other.channels)]
    np.testing.assert_allclose(found, expected, rtol=1e-7)
    # Rigid motion leaves nothing, at any frequency; delays are taken out.
    layout = replace(
        layout,
        sensors=tuple(
            replace(one, delay=1e-3) if one.kind is V else one for one in layout.sensors
        ),
    )
    spectra = Spectra(layout, redundancy(BLOCK, layout).orders, RATE)
    chunk = next(spectra.add(0, motion_of(BLOCK, layout, seconds=10.24) + 0.01))
    errors = leave_one_out(redundancy(BLOCK, layout).rows, np.ones((1, 4)),
                           np.ones(4, dtype=bool)).errors[0]  # fmt: skip
    left = np.einsum('ci,bij,cj->bc', errors, chunk.products, errors)[:, other.channels]
    # Sums instead of integrals.
    assert left.max() < 1e-10 * chunk.products.max()


def test_variance_of_white_noise_is_known_in_every_band():
    layout = line_layout(kinds=(D, V, A))
    spectra = Spectra(layout, redundancy(BLOCK, layout).orders, RATE)
    readings = np.random.default_rng(0).standard_normal((int(200 * RATE), 4))
    chunks = list(spectra.add(0, readings))
    found = np.mean([np.einsum('bii->bi', one.products) for one in chunks], axis=0)
    ratio = found / (5 * spectra.bins_per_sum[:, np.newaxis] * spectra.noise_power)
    count = 5 * len(chunks) * spectra.bins_per_sum
    # 400 values that are normal, more or less: 5 standard deviations.
    score = (ratio - 1) / np.sqrt(CORRELATED / count)[:, np.newaxis]
    assert np.abs(score).max() < 5
    assert 0.7 < np.sqrt(np.mean(score[: len(spectra.bands)] ** 2)) < 1.3


THREE = line_layout(kinds=(D, V, A), noise={D: 1e-6, V: 2e-4, A: 5e-2, F: 1.0})


def searched(clean, layout, seed, left_out=()):
    """Judge one chunk, channels left out by hand."""
    noise = np.array([one.noise for one in layout.sensors])
    setup = redundancy(BLOCK, layout)
    spectra = Spectra(layout, setup.orders, RATE)
    generator = np.random.default_rng(seed)
    readings = np.concatenate((clean, clean))[: 3 * 2048]
    readings = readings + noise * generator.standard_normal(readings.shape)
    (chunk,) = spectra.add(0, readings)
    bands = slice(0, len(spectra.bands))
    sums = BandSums(
        chunk.products[bands],
        5 * spectra.bins_per_sum[bands],
        noise**2 * spectra.noise_power[bands],
        noise**2 * (chunk.power[bands, 1:] / chunk.power[bands, :1])[:, setup.orders],
        chunk.valid,
    )
    search = Contradictions(setup, sums, 0.03, 5.0)
    if left_out:
        search.used = np.isin(np.arange(len(noise)), left_out, invert=True)
        search.comparison = search.compare(search.used)
    return search


def test_factors_are_unbiased_with_true_standard_deviations():
    clean = motion_of(BLOCK, THREE, lines=np.arange(10.0, 60.0, 5.0))
    clean[:, 2] *= 1.02
    scores = []
    for seed in range(150):
        gains = searched(clean, THREE, seed, (2,)).gains()
        scores.append((gains.value[2] - 1.02) / gains.standard_deviation[2])
    # Unbiased, of unit variance and normal: 150 scores, bounds of 1e-4.
    assert abs(np.mean(scores)) < 3.9 / np.sqrt(150)
    assert kstest(scores, 'norm').pvalue > 1e-4


FIVE = Layout(
    tuple(
        Sensor(f'{kind.name}_{i}', kind, 'block', noise=noise)
        for kind, noise in ((D, 1e-6), (V, 2e-4), (A, 5e-2))
        for i in range(1 + (kind is not A))
    )
)


@pytest.mark.parametrize('sign', [-1, 1])
def test_a_gain_of_the_stated_size_is_named_in_99_percent_and_a_smaller_one_less(sign):
    clean = motion_of(BLOCK, FIVE, lines=np.arange(10.0, 60.0, 5.0))
    clean *= 0.15  # little motion: noise decides
    clean_search = searched(clean, FIVE, 1000)
    limits = gain_limits(clean_search.gains(), 5.0, 0.03)
    size = float(limits.named[4])
    assert 0.06 < size < 0.5
    trials = 120
    named = {1.0: 0, 0.5: 0}
    for share in named:
        wrong = clean.copy()
        wrong[:, 4] *= 1 + sign * share * size
        for seed in range(trials):
            search = searched(wrong, FIVE, seed)
            told = search.left_out == (4,) and search.gains().wrong(5.0, 0.03)[4]
            named[share] += bool(told and not search.explanations(4))
    # At least so many, unless 1 in 1000 bad luck.
    assert named[1.0] >= binom.ppf(1e-3, trials, 0.99)
    assert named[0.5] < 0.9 * trials


def test_dropping_a_pair_lowers_the_squares_as_a_fit_without_it():
    generator = np.random.default_rng(4)
    rows = generator.normal(size=(9, 4)) * [1, 10, 0.1, 1]
    variance = generator.uniform(0.1, 10, size=(2, 9))
    readings = generator.normal(size=(2, 9))
    used = np.ones(9, dtype=bool)
    used[6] = False

    def squares(band, channels):
        root = 1 / np.sqrt(variance[band, channels])
        fit, *_ = np.linalg.lstsq(
            rows[channels] * root[:, None], readings[band, channels] * root, rcond=None
        )
        return np.sum((root * (readings[band, channels] - rows[channels] @ fit)) ** 2)

    products = np.einsum('bi,bj->bij', readings, readings)
    sums = BandSums(products, np.ones(2), np.zeros((2, 9)), np.zeros((2, 9)), used)
    found = pair_drops(leave_one_out(rows, variance, used), variance, sums, used)
    whole = [i for i in range(9) if used[i]]
    for i in whole:
        for j in whole:
            if i != j:
                rest = [k for k in whole if k not in (i, j)]
                drop = sum(squares(band, whole) - squares(band, rest) for band in range(2))
                assert found[i, j] == pytest.approx(drop, rel=1e-9)
    assert not found[6].any()
    assert not np.diag(found).any()


def test_what_a_direction_does_to_a_factor_is_its_derivative():
    column = NAMES.index('column_a3z')
    angle = 1e-4
    clean = motion_of(MODEL, LAYOUT, [40.0])
    watch = passed(clean=clean, factor=1e-3)
    lean = watch._gains.lean[column]
    sensor = LAYOUT.sensors[column]
    _, _, (_, first, second) = np.linalg.svd(sensor.direction[np.newaxis])
    changes = []
    for across in (first, second):
        turned = list(LAYOUT.sensors)
        turned[column] = replace(sensor, direction=sensor.direction + angle * across)
        moved = motion_of(MODEL, replace(LAYOUT, sensors=tuple(turned)), [40.0])
        own = clean[:, column] - clean[:, column].mean()
        changes.append((moved[:, column] @ own / (clean[:, column] @ own) - 1) / angle)
    assert lean == pytest.approx(np.hypot(*changes), rel=0.02)
    assert lean > 0.1


def test_long_windows_hold_every_chunk_once():
    def chunk(i):
        bit = np.zeros((1, 1, 200))
        bit[..., i] = 1
        return StretchSums(i, i + 1, bit, bit[0], 1, np.array([i != 7]), np.array([float(i)]))

    windows = LongWindows(3)
    for i in range(150):
        for window in windows.add(chunk(i)):
            # The newest ones, without a gap.
            assert window.next_index == i + 1
            expected = np.zeros(200)
            expected[window.first_index : i + 1] = 1
            np.testing.assert_array_equal(window.products[0, 0], expected)
            assert window.segments == i + 1 - window.first_index
            assert window.valid[0] == (not window.first_index <= 7 <= i)
            assert window.largest[0] == i
            assert window.segments in {6, 9, 12, 24, 36, 48, 96, 144}
    (rest,) = windows.finish()
    assert (rest.first_index, rest.next_index) == (0, 150)
    windows.restart()
    assert windows.finish() == []
    assert together([chunk(3)]).segments == 1


# Faults.


def test_clean_data_have_no_findings_and_known_factors():
    watch = passed(seconds=40.0)
    assert watch.findings() == ()
    gains = watch.gains
    assert np.isnan(gains['force'][0])
    scores = [(value - 1) / spread for name, (value, spread) in gains.items() if name != 'force']
    assert np.abs(scores).max() < 4.5
    assert max(spread for name, (_, spread) in gains.items() if name != 'force') < 0.01


@pytest.mark.parametrize(
    ('change', 'expected'),
    [
        (times(knee_s3z=-1), {('knee_s3z', Condition.INVERTED)}),
        (times(column_a1y=-1, knee_v2z=-1),
         {('column_a1y', Condition.INVERTED), ('knee_v2z', Condition.INVERTED)}),
        (times(front_left=1.06), {('front_left', Condition.GAIN)}),
        (times(column_v3x=0.94), {('column_v3x', Condition.GAIN)}),
        (exchanged('knee_a1x', 'knee_a2z'),
         {('knee_a1x', Condition.SWAPPED), ('knee_a2z', Condition.SWAPPED)}),
        (exchanged('column_s1x', 'knee_s4y'),
         {('column_s1x', Condition.SWAPPED), ('knee_s4y', Condition.SWAPPED)}),
        (plus('knee_v1y', lambda t: 3e-5 * np.sin(2 * np.pi * 49.8 * t)),
         {('knee_v1y', Condition.HUM)}),
        (plus('column_a2z', lambda t: 0.03 * np.sin(2 * np.pi * 180.3 * t)),
         {('column_a2z', Condition.HUM)}),
    ],
)  # fmt: skip
def test_faults_are_named_on_their_channels(change, expected):
    watch = passed(change)
    assert said(watch) == expected
    for one in watch.findings():
        assert one.sentence.startswith(one.channel + ':')
        assert one.first_index == 0
        assert one.next_index > 7 * RATE


def test_amounts_are_those_of_the_faults():
    (gain,) = passed(times(knee_s3z=1.08)).findings()
    assert abs(gain.amount - 1.08) < 0.004
    assert '1.08' in gain.sentence
    assert 'sensors of knee' in gain.sentence
    (hum,) = passed(
        plus('knee_s2y', lambda t: 60e-9 * np.sin(2 * np.pi * 60.1 * t))
    ).findings()  # fmt: skip
    assert abs(hum.amount - 60e-9) < 6e-9
    assert hum.unit == 'm'
    assert '60 Hz' in hum.sentence


def test_drift_is_told_from_offsets_and_from_motion():
    def change(readings, time):
        # A large offset of one, a drift of another, and the knee sinks by 1 um.
        readings[:, NAMES.index('knee_s1x')] += 1e-4
        readings[:, NAMES.index('column_s3z')] += 5e-8 * time / 30
        down = np.zeros(len(MODEL.coordinates))
        down[MODEL.coordinate_names.index('knee.translation_3')] = -1e-6
        for i, sensor in enumerate(LAYOUT.sensors):
            if sensor.kind is D:
                readings[:, i] += (sensor_matrix(MODEL, (sensor,))[0] @ down) * time / 30
        return readings

    found = passed(change, seconds=34.0).findings()
    assert {(one.channel, one.condition) for one in found} == {('column_s3z', Condition.DRIFT)}
    assert 2e-8 < found[0].amount < 5e-8


def test_a_fault_that_begins_later_is_found_and_goes_when_it_is_mended():
    begin, end = 8.0, 20.0

    def change(readings, time):
        wrong = (time > begin) & (time < end)
        readings[wrong, NAMES.index('knee_a3z')] *= -1
        return readings

    def at(seconds):
        return said(passed(change, seconds=seconds))

    fault = {('knee_a3z', Condition.INVERTED)}
    assert at(begin) == set()
    assert at(begin + 8.5) == fault
    assert at(end) == fault
    assert at(end + 16) == set()


@pytest.mark.parametrize(
    'names',
    [('column_s1x', 'column_a1x'), ('column_s4y', 'column_v4y'), ('column_a4y', 'column_s4y')],
)
def test_two_wrong_sensors_of_a_place_do_not_outvote_the_third(names):
    # One frequency; leaving out one channel after the other begins with the third.
    clean = motion_of(MODEL, LAYOUT, [40.0])
    found = said(passed(times(**dict.fromkeys(names, -1)), clean=clean, seconds=7.5))
    assert found == {(name, Condition.INVERTED) for name in names}


@pytest.mark.parametrize('wrong', [(1,), (2, 3)])
def test_of_three_sensors_two_that_may_both_be_wrong_are_named(wrong):
    layout = line_layout(kinds=(D, V, A), noise={D: 1e-8, V: 1e-6, A: 1e-2, F: 1.0})
    clean = motion_of(BLOCK, layout)
    clean[:, list(wrong)] *= -1  # the same readings but for a common sign
    (found,) = passed(model=BLOCK, layout=layout, clean=clean).findings()
    assert found.sentence.startswith(
        'block_displacement (or block_velocity and block_acceleration, both): reads -1.00'
    )


def test_an_exchange_that_two_wrong_signs_explain_as_well_says_both():
    pair = [NAMES.index(name) for name in ('knee_a1x', 'knee_a2z')]

    def opposite(share):
        """Motion in which the second reads so many times the negative of the first."""
        rows = sensor_matrix(MODEL, tuple(LAYOUT.sensors[i] for i in pair))
        shape = random_shape(8)
        null = rows[1] + share * rows[0]
        return in_phase(shape - null * (null @ shape) / (null @ null))

    names = [NAMES[i] for i in pair]
    # Readings that are opposite: exchanged or inverted is the same to the last digit.
    found = passed(exchanged(*names), clean=opposite(1.0)).findings()
    conditions = {(name, one) for name in names for one in (Condition.SWAPPED, Condition.INVERTED)}
    assert {(one.channel, one.condition) for one in found} == conditions
    assert all('exchanged with' in one.sentence for one in found)
    assert all('both have the wrong polarity' in one.sentence for one in found)
    # Readings that differ in size as well tell which it is.
    clean = opposite(1.3)
    assert said(passed(exchanged(*names), clean=clean)) == {
        (name, Condition.SWAPPED) for name in names
    }
    assert said(passed(times(**dict.fromkeys(names, -1)), clean=clean)) == {
        (name, Condition.INVERTED) for name in names
    }


def test_a_small_gain_in_much_noise_is_found_by_long_windows():
    channel = NAMES.index('knee_a1x')
    sensors = list(LAYOUT.sensors)
    sensors[channel] = replace(sensors[channel], noise=60 * sensors[channel].noise)
    layout = replace(LAYOUT, sensors=tuple(sensors))
    short = passed(seconds=10.0, layout=layout)
    least = short.gain_limits['knee_a1x'][0]
    size = 0.03 + 0.5 * (least - 0.03)
    assert 0.05 < size < 0.3
    change = times(knee_a1x=1 - size)
    assert passed(change, seconds=10.0, layout=layout).findings() == ()
    watch = passed(change, seconds=120.0, layout=layout)
    (found,) = watch.findings()
    assert (found.channel, found.condition) == ('knee_a1x', Condition.GAIN)
    assert found.amount == pytest.approx(1 - size, abs=0.25 * size)
    # 12 times as long: noise counts less by the root of that.
    assert watch.least_gain_limits['knee_a1x'][0] < 0.03 + 0.45 * (least - 0.03)
    assert passed(seconds=120.0, layout=layout).findings() == ()


# What must not be called a fault.


def test_inexact_layouts_are_no_fault():
    generator = np.random.default_rng(5)
    late = generator.uniform(-25e-6, 25e-6, len(NAMES))
    turned = replace(
        LAYOUT,
        sensors=tuple(
            one
            if one.kind is F
            else replace(one, direction=one.direction + np.radians(1.0) * np.cross(
                one.direction, generator.normal(size=3) / np.sqrt(2)))
            for one in LAYOUT.sensors
        ),
    )  # fmt: skip
    for lines in (LINES, [40.0]):
        clean = motion_of(MODEL, turned, lines, late=late)
        clean *= 1 + 0.01 * generator.normal(size=len(NAMES))
        assert passed(clean=clean).findings() == ()
        assert said(passed(times(knee_s3z=-1), clean=clean)) == {('knee_s3z', Condition.INVERTED)}


def test_a_direction_that_is_a_little_off_is_no_wrong_gain():
    channel = NAMES.index('knee_a1x')

    def pointing(direction):
        sensors = list(LAYOUT.sensors)
        sensors[channel] = replace(sensors[channel], direction=np.asarray(direction))
        return replace(LAYOUT, sensors=tuple(sensors))

    shape = random_shape(3)
    path = np.array(
        [sensor_matrix(MODEL, (pointing(one).sensors[channel],))[0] @ shape for one in np.eye(3)]
    )
    path = path / np.linalg.norm(path)
    beside = np.cross(path, [1.0, 0.0, 0.0])
    beside = beside / np.linalg.norm(beside)

    # The sensor sees a tenth of the motion: a turn of 1 degree towards it adds 17 %.
    def turned(degrees):
        angle = np.arcsin(0.1) + np.radians(degrees)
        return pointing(np.sin(angle) * path + np.cos(angle) * beside)

    layout = turned(0.0)
    exact, wrong = in_phase(shape, layout), in_phase(shape, turned(1.0))
    assert np.ptp(wrong[:, channel]) > 1.15 * np.ptp(exact[:, channel])
    for degrees in (1.0, -1.0):
        clean = in_phase(shape, turned(degrees))
        assert passed(layout=layout, clean=clean).findings() == ()
    # More than that is told, with the turn that would do the same.
    (found,) = passed(layout=layout, clean=in_phase(shape, turned(3.0))).findings()
    assert (found.channel, found.condition) == ('knee_a1x', Condition.GAIN)
    assert 'or the direction by 3 degrees' in found.sentence


@pytest.mark.parametrize('factor', [1.0, 4.0])
def test_noise_alone_is_no_evidence(factor):
    watch = passed(clean=np.zeros_like(CLEAN), seconds=20.0, factor=factor)
    assert watch.findings() == ()


def test_motion_at_the_frequency_of_the_mains_is_no_hum():
    clean = motion_of(MODEL, LAYOUT, [50.0, 100.0, 120.0])
    assert passed(clean=clean).findings() == ()


# What cannot be told.


def test_of_two_sensors_both_are_named():
    layout = line_layout(kinds=(D, A), noise={D: 1e-8, A: 1e-2, F: 1.0})
    clean = motion_of(BLOCK, layout)
    clean[:, 1] *= -1
    found = passed(model=BLOCK, layout=layout, clean=clean).findings()
    names = [one.name for one in layout.sensors if one.kind is not F]
    assert [one.channel for one in found] == names
    assert all(one.condition is Condition.INVERTED for one in found)
    assert found[0].sentence.startswith(f'{names[0]} (or {names[1]})')


def test_two_force_sensors_of_an_exciter_check_each_other():
    cells = tuple(Sensor(f'cell_{i}', F, excitation='exciter', noise=0.1) for i in range(2))
    layout = Layout((*cells, Sensor('probe', D, 'block', noise=1e-8)))
    clean = motion_of(BLOCK, layout)
    clean[:, :2] = 100 * np.sin(2 * np.pi * 35.0 * np.arange(len(clean)) / RATE)[:, np.newaxis]
    watch = passed(model=BLOCK, layout=layout, clean=clean)
    assert watch.findings() == ()
    assert watch.checkable == {'cell_0': ('cell_1',), 'cell_1': ('cell_0',), 'probe': ()}
    clean[:, 1] *= -1
    found = passed(model=BLOCK, layout=layout, clean=clean).findings()
    assert [one.channel for one in found] == ['cell_0', 'cell_1']


@pytest.mark.parametrize('name', ['knee_column', 'three_body', 'oscillator'])
def test_checkable_channels_are_those_in_the_span_of_others(name):
    model = assemble(load_machine(shipped_config(f'{name}.yaml')).machine)
    layout = load_layout(shipped_config(f'{name}_layout.yaml')).layout
    watch = Consistency(model, layout, 2000.0)
    for sensor in layout.sensors:
        if sensor.kind is F:
            assert watch.checkable[sensor.name] == ()
            continue
        for table, kinds in (
            (watch.checkable, (D, V, A)),
            (watch.drift_checkable, (sensor.kind,)),
        ):
            others = tuple(
                one for one in layout.sensors if one.kind in kinds and one is not sensor
            )
            rows = sensor_matrix(model, others)
            more = sensor_matrix(model, (*others, sensor))
            redundant = np.linalg.matrix_rank(rows) == np.linalg.matrix_rank(more)
            assert bool(table[sensor.name]) == redundant
    # All but the force cell, except on the oscillator, which has one sensor of motion.
    count = sum(bool(others) for others in watch.checkable.values())
    assert count == (0 if name == 'oscillator' else len(layout.sensors) - 1)


# The stream.


def test_cutting_into_blocks_does_not_change_a_bit():
    change = times(knee_s3z=1.1)
    whole = passed(change, seconds=7.0, block=14000)
    parts = passed(change, seconds=7.0, block=173)
    assert whole.findings() == parts.findings()
    assert whole.findings()
    np.testing.assert_equal(whole.gains, parts.gains)


def test_missing_samples_do_not_mislead():
    def change(readings, time):
        generator = np.random.default_rng(2)
        readings[generator.random(readings.shape) < 1e-3] = np.nan
        readings[: len(readings) // 2, 7] = np.nan
        readings[:, 9] = np.nan
        readings[:, NAMES.index('knee_s3z')] *= -1
        return readings

    watch = passed(change)
    assert said(watch) == {('knee_s3z', Condition.INVERTED)}
    assert np.isnan(watch.gains[NAMES[9]][0])


def test_jumps_begin_new_segments():
    watch = Consistency(MODEL, LAYOUT, RATE)
    generator = np.random.default_rng(0)
    noise = np.array([one.noise for one in LAYOUT.sensors])
    for begin in range(0, 60000, 5000):
        # 1234 samples are lost between all blocks.
        places = begin + np.arange(5000 - 1234)
        readings = CLEAN[places % len(CLEAN)]
        watch.add(begin, readings + noise * generator.standard_normal(readings.shape))
    assert watch.findings() == ()
    assert np.isfinite(watch.gains['knee_s3z'][0])


def test_short_gaps_are_bridged_and_long_ones_are_not():
    time = np.arange(1000) / 1000.0
    samples = np.sin(2 * np.pi * 3 * time)[:, np.newaxis] * np.ones(3)
    broken = samples.copy()
    broken[100:104, 1] = np.nan
    broken[100:108, 2] = np.nan
    filled, valid = bridged(broken)
    assert valid.tolist() == [True, True, False]
    np.testing.assert_allclose(filled[:, :2], samples[:, :2], atol=2e-3)
    assert np.all(filled[:, 2] == 0)


def test_noise_that_nobody_states_is_estimated():
    layout = replace(
        LAYOUT, sensors=tuple(replace(one, noise=np.nan) for one in LAYOUT.sensors)
    )  # fmt: skip
    assert passed(layout=layout).findings() == ()
    assert said(passed(times(knee_a2y=-1), layout=layout)) == {('knee_a2y', Condition.INVERTED)}


def test_wrong_input_is_refused_with_the_place():
    watch = Consistency(MODEL, LAYOUT, RATE)
    with pytest.raises(DataError, match=r'shape \(10, 3\), expected .* 58\)'):
        watch.add(0, np.zeros((10, 3)))
    other = Layout((Sensor('cell', F, excitation='hammer'),))
    with pytest.raises(LayoutError, match='sensor cell: measures excitation "hammer"'):
        Consistency(MODEL, other, RATE)


def test_hum_goes_when_it_is_switched_off():
    def change(readings, time):
        readings[:, 12] += 1e-6 * np.sin(2 * np.pi * 50 * time) * (time < 9.0)
        return readings

    assert said(passed(change, seconds=9.0)) == {(NAMES[12], Condition.HUM)}
    assert said(passed(change, seconds=21.0)) == set()


def test_drift_that_could_be_of_either_channel_names_both():
    # Three corners at equal distances: what changes one distance may be at either end.
    layout = complete_layout(MODEL.machine)
    clean = motion_of(MODEL, layout)
    names = [sensor.name for sensor in layout.sensors]

    def change(readings, time):
        readings[:, names.index('knee_acceleration_2z')] += 0.06 * time / 30
        return readings

    found = passed(change, seconds=24.0, layout=layout, clean=clean).findings()
    assert {one.channel for one in found} == {'knee_acceleration_1x', 'knee_acceleration_2z'}
    assert all(' (or knee_acceleration_' in one.sentence for one in found)
