# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Force signals against their definitions."""

from identnl_ros.core.errors import DataError
from identnl_ros.core.simulation.excitation import (
    Harmonics,
    Impulses,
    multisine,
    multisine_of,
    RecordedForce,
    sine,
    Sweep,
)
import numpy as np
import pytest
from scipy.integrate import quad


def at(signal, time):
    return signal.on_grid(time, 1.0, 1)[0]


@pytest.mark.parametrize(
    ('start', 'step', 'count'),
    [(0.0, 1e-4, 1), (0.0, 1e-4, 1000), (17.25, 1e-4, 777), (0.3, 1 / 48000, 256), (5.0, 0.1, 0)],
)
def test_harmonics_on_a_grid_are_the_sum_of_their_sines(start, step, count):
    generator = np.random.default_rng(5)
    signal = Harmonics(
        generator.uniform(1, 9, 20), generator.uniform(1, 300, 20), generator.uniform(0, 6, 20)
    )
    time = start + step * np.arange(count)
    expected = sum(
        amplitude * np.sin(2 * np.pi * frequency * time + phase)
        for amplitude, frequency, phase in zip(
            signal.amplitudes, signal.frequencies, signal.phases, strict=True
        )
    )
    np.testing.assert_allclose(signal.on_grid(start, step, count), expected, atol=1e-9)


def test_sine_starts_at_zero_upwards():
    signal = sine(7.0, 50.0)
    np.testing.assert_allclose(signal.on_grid(0.0, 0.005, 3), [0.0, 7.0, 0.0], atol=1e-13)


@pytest.mark.parametrize('seed', range(5))
def test_multisine_has_the_root_mean_square_of_a_sine_of_its_amplitude(seed):
    signal = multisine(100.0, (5.0, 300.0), 2.0, np.random.default_rng(seed))
    force = signal.on_grid(0.0, 2.0 / 4096, 4096)  # one whole period
    assert np.sqrt(np.mean(force**2)) == pytest.approx(100.0 / np.sqrt(2), rel=1e-12)


def test_multisine_has_equal_lines_at_all_multiples_within_the_band_and_nothing_else():
    force = multisine(10.0, (5.0, 9.0), 2.0, np.random.default_rng(1)).on_grid(0.0, 1 / 64, 128)
    lines = np.abs(np.fft.rfft(force)) / 64
    expected = np.zeros(65)
    expected[10:19] = 10.0 / 3.0  # 5, 5.5, ... 9 Hz: nine lines
    np.testing.assert_allclose(lines, expected, atol=1e-12)


@pytest.mark.parametrize('period', [0.1, 0.3, 0.7, 1.1, 3.0])
def test_rounding_does_not_lose_a_line_at_the_border_of_the_band(period):
    signal = multisine(1.0, (3 / period, 12 / period), period, np.random.default_rng(0))
    np.testing.assert_allclose(signal.frequencies * period, np.arange(3, 13), rtol=1e-12)


def test_multisine_repeats_after_its_period_and_not_before():
    signal = multisine(10.0, (2.0, 40.0), 0.5, np.random.default_rng(2))
    first, second = (signal.on_grid(start, 1e-3, 500) for start in (0.1, 0.6))
    np.testing.assert_allclose(first, second, atol=1e-10)
    assert np.abs(signal.on_grid(0.35, 1e-3, 500) - first).max() > 1.0


def test_same_generator_state_gives_the_same_phases_and_another_seed_others():
    phases = [
        multisine(1.0, (1.0, 9.0), 1.0, np.random.default_rng(seed)).phases for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(phases[0], phases[1])
    assert np.all(phases[0] != phases[2])


def test_band_without_a_line_is_refused():
    with pytest.raises(DataError, match=r'no multiple of 2 Hz lies between 4\.5 and 5\.5 Hz'):
        multisine(1.0, (4.5, 5.5), 0.5, np.random.default_rng(0))


def test_momentum_of_a_blow_is_two_amplitude_width_over_pi():
    blows = Impulses(500.0, 0.004, 0.1)
    momentum = quad(lambda t: at(blows, t), 0.002, 0.006, epsabs=0, epsrel=1e-12)[0]
    assert momentum == pytest.approx(2 * 500 * 0.004 / np.pi, rel=1e-10)


def test_blows_repeat_after_the_interval_with_silence_between():
    blows = Impulses(500.0, 0.004, 0.1)
    force = blows.on_grid(0.0, 1e-4, 3000)
    assert at(blows, 0.004) == pytest.approx(500.0)
    np.testing.assert_allclose(force[:1000], force[1000:2000], atol=1e-9)
    assert np.count_nonzero(np.abs(force[:1000]) > 1e-9) == 39
    assert force.min() > -1e-9


def test_frequency_of_a_sweep_rises_linearly_over_its_band():
    sweep = Sweep(3.0, (10.0, 50.0), 4.0)
    rate = 20000.0
    force = sweep.on_grid(0.0, 1 / rate, 80001)[:-1]
    rises = np.flatnonzero((force[:-1] < 0) & (force[1:] >= 0))
    crossings = (rises - force[rises] / (force[rises + 1] - force[rises])) / rate
    middle = (crossings[:-1] + crossings[1:]) / 2
    found = 1 / np.diff(crossings)
    # Mean frequency over a cycle = frequency at the cycle's middle, for a linear sweep.
    np.testing.assert_allclose(found, 10 + 10 * middle, rtol=1e-4)
    assert np.abs(force).max() == pytest.approx(3.0, rel=1e-5)


def test_sweep_begins_anew_after_its_duration():
    sweep = Sweep(3.0, (10.0, 50.0), 4.0)
    first, second = (sweep.on_grid(start, 1e-3, 900) for start in (0.5, 4.5))
    np.testing.assert_allclose(first, second, atol=1e-10)


@pytest.mark.parametrize('rate', [10.0, 1e3, 1e4, 48000.0, 51200.0, 44100.0])
@pytest.mark.parametrize('count', [4, 5, 22, 100, 1001])
def test_recorded_force_passes_through_all_its_samples(rate, count):
    samples = np.random.default_rng(count).uniform(1, 2, count)
    found = RecordedForce(samples, rate).on_grid(0.0, 1 / rate, count)
    np.testing.assert_allclose(found, samples, rtol=1e-12)


@pytest.mark.parametrize('size', [4, 5, 6, 9, 10, 11, 40])
def test_recorded_polynomial_is_found_again_up_to_the_ninth_degree(size):
    degree = min(9, (size - 2) // 2 * 2 + 1)
    place = np.linspace(0, 1, size)
    between = np.linspace(0, 1, 3 * size)
    found = RecordedForce(place**degree, size - 1.0).on_grid(0.0, 1 / (3 * size - 1), 3 * size)
    np.testing.assert_allclose(found, between**degree, atol=1e-12)


@pytest.mark.parametrize(('cycles_per_sample', 'error'), [(0.1, 1e-9), (0.03, 1e-13)])
def test_recorded_sine_is_found_again_between_its_samples(cycles_per_sample, error):
    omega = 2 * np.pi * cycles_per_sample
    force = RecordedForce(np.sin(omega * np.arange(400) + 0.3), 1.0)
    found = force.on_grid(50.0, 0.1, 3000)
    expected = np.sin(omega * (50 + 0.1 * np.arange(3000)) + 0.3)
    np.testing.assert_allclose(found, expected, atol=error)


def test_recorded_force_is_zero_outside_its_record():
    force = RecordedForce(np.full(10, 3.0), 10.0)
    np.testing.assert_array_equal(force.on_grid(0.91, 0.1, 5), 0.0)
    np.testing.assert_array_equal(force.on_grid(-0.55, 0.1, 5), 0.0)


@pytest.mark.parametrize('samples', [np.ones(3), np.array([1.0, 2.0, np.nan, 3.0, 4.0])])
def test_record_too_short_or_with_holes_is_refused(samples):
    with pytest.raises(DataError, match='at least four finite'):
        RecordedForce(samples, 10.0)


def test_odd_multisine_leaves_the_even_multiples_silent():
    signal = multisine(10.0, (5.0, 40.0), 1.0, np.random.default_rng(2), odd=True)
    spectrum = np.abs(np.fft.rfft(signal.on_grid(0.0, 1e-3, 1000))) / 500
    lines = np.arange(5, 41, 2)
    np.testing.assert_allclose(spectrum[lines], 10 / np.sqrt(lines.size), rtol=1e-10)
    np.testing.assert_allclose(np.delete(spectrum, lines), 0, atol=1e-10)


def test_chosen_lines_are_those_of_the_multisine():
    signal = multisine_of(3.0, np.array([7.0, 11.0, 13.0]), np.random.default_rng(3))
    samples = signal.on_grid(0.0, 1e-3, 1000)
    spectrum = np.abs(np.fft.rfft(samples)) / 500
    assert set(np.flatnonzero(spectrum > 1e-9)) == {7, 11, 13}
    assert np.sqrt(np.mean(samples**2)) == pytest.approx(3 / np.sqrt(2))
