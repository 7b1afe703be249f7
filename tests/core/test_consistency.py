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
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.consistency import Consistency
from identnl_ros.core.quality.consistency_spectra import bridged, CORRELATED, Spectra
from identnl_ros.core.quality.contradictions import BandSums, Contradictions
from identnl_ros.core.quality.leave_one_out import leave_one_out
from identnl_ros.core.quality.redundancy import redundancy
from identnl_ros.core.synchronisation.segment_spectra import segment_spectra
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
from identnl_ros.storage.shipped import shipped_config
import numpy as np
import pytest
from scipy.stats import kstest

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


def test_factors_are_unbiased_with_true_standard_deviations():
    clean = motion_of(BLOCK, THREE, lines=np.arange(10.0, 60.0, 5.0))
    clean[:, 2] *= 1.02
    noise = np.array([one.noise for one in THREE.sensors])
    setup = redundancy(BLOCK, THREE)
    scores = []
    for seed in range(150):
        spectra = Spectra(THREE, setup.orders, RATE)
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
        search.used = np.array([True, True, False, True])
        search.comparison = search.compare(search.used)
        gains = search.gains()
        scores.append((gains.value[2] - 1.02) / gains.standard_deviation[2])
    # Unbiased, of unit variance and normal: 150 scores, bounds of 1e-4.
    assert abs(np.mean(scores)) < 3.9 / np.sqrt(150)
    assert kstest(scores, 'norm').pvalue > 1e-4


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
