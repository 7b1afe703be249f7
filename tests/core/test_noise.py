# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Noise found from the samples themselves, against noise of known size."""

from math import factorial

from identnl_ros.core.estimation.residual_statistics import ResidualStatistics
from identnl_ros.core.measurement.noise import CORRELATION, NoiseEstimate
from identnl_ros.core.synchronisation.resampling import Grid, resample
import numpy as np
import pytest


def found(*blocks):
    estimate = NoiseEstimate(blocks[0].shape[1])
    for block in blocks:
        estimate.add(block)
    return estimate.standard_deviation


@pytest.mark.parametrize('seed', range(5))
def test_white_noise_is_found_whatever_smooth_motion_it_rides_on(seed):
    count = 20000
    sizes = np.array([1e-9, 1.0, 3e4])
    noise = np.random.default_rng(seed).standard_normal((count, 3)) * sizes
    wave = np.sin(2 * np.pi * 0.05 * np.arange(count))[:, np.newaxis] * 1e3 * sizes
    # Neighbouring values share samples.
    np.testing.assert_allclose(found(noise + wave + 7 * sizes), sizes, rtol=0.05)


def test_motion_at_a_tenth_of_the_sample_rate_leaves_little():
    wave = np.sin(2 * np.pi * 0.1 * np.arange(5016))[:, np.newaxis]
    # Gains: of a difference 2 sin(pi f), of a sum 2 cos(pi f). Power that 14 and 2 of them make of
    # white noise, from the mean of powers of sine and cosine (Euler's beta integral).
    gain = (2 * np.sin(0.1 * np.pi)) ** 14 * (2 * np.cos(0.1 * np.pi)) ** 2
    power = factorial(28) * factorial(4) / (factorial(14) * factorial(2) * factorial(16))
    expected = gain / np.sqrt(power) / np.sqrt(2)
    assert found(wave)[0] == pytest.approx(expected, rel=1e-3)
    assert expected < 3e-6


@pytest.mark.parametrize('apart', [0.0, 0.25, 0.5])
def test_noise_that_was_interpolated_has_the_density_that_it_had(apart):
    # Between two samples the interpolation takes away up to all of what lies above 0.94 of half
    # the sample rate; below, the noise is what it was.
    noise = np.random.default_rng(3).standard_normal((20200, 16))
    between = resample(noise, Grid(100.0 + apart, 1.0), 20000)
    size = np.sqrt(np.mean(found(between) ** 2))
    # 320000 samples, worth a quarter.
    assert size == pytest.approx(1.0, abs=4 * np.sqrt(CORRELATION / 2 / 320000))


def test_the_estimate_varies_as_from_fewer_samples_by_the_stated_factor():
    noise = np.random.default_rng(4).standard_normal((400, 4000))
    variance = np.var(found(noise) ** 2)
    # The variance of a variance: known to a fiftieth; 16 samples at the ends count less.
    assert variance == pytest.approx(2 * CORRELATION / 384, rel=0.08)


@pytest.mark.parametrize('apart', [0.0, 0.5])
def test_averages_of_interpolated_noise_are_as_small_as_noise_makes_them(apart):
    noise = np.random.default_rng(5).standard_normal((20200, 16))
    statistics = ResidualStatistics(16, 4)
    statistics.add(resample(noise, Grid(100.0 + apart, 1.0), 20000))
    ratio, deviation = statistics.slow_excess(0)
    assert deviation < 0.01
    assert ratio == pytest.approx(1.0, abs=3 * deviation)
    # With a slow motion of a twentieth of the power of the noise they are not.
    statistics = ResidualStatistics(16, 4)
    slow = 0.3 * np.sin(0.05 * np.arange(20200))[:, np.newaxis]
    statistics.add(resample(noise + slow, Grid(100.0 + apart, 1.0), 20000))
    ratio, deviation = statistics.slow_excess(0)
    assert ratio > 1 + 5 * deviation


def test_polynomials_are_no_noise():
    time = np.linspace(-1, 1, 300)
    assert found(time[:, np.newaxis] ** np.arange(10))[1:].max() < 1e-13


def test_lost_samples_are_left_out():
    noise = np.random.default_rng(1).standard_normal((20000, 2))
    noise[::100, 0] = np.nan
    np.testing.assert_allclose(found(noise), 1.0, rtol=0.05)


def test_nothing_is_known_before_seventeen_samples_in_a_row():
    assert np.isnan(found(np.ones((16, 2)))).all()
    assert np.isfinite(found(np.ones((17, 2)))).all()


def test_blocks_of_ten_samples_tell_the_noise_as_one_block_does():
    noise = np.random.default_rng(2).standard_normal((20000, 1))
    np.testing.assert_allclose(found(*np.split(noise, 2000)), found(noise), rtol=1e-9)


@pytest.mark.parametrize('size', [1, 3, 15, 16, 17, 997])
def test_blocks_of_any_size_tell_the_noise_as_one_block_does(size):
    noise = np.random.default_rng(5).standard_normal((2000, 2)) * [1e-9, 1e5]
    noise[700] = np.nan
    parts = np.split(noise, range(size, 2000, size))
    np.testing.assert_allclose(found(*parts), found(noise), rtol=1e-12)


def test_nothing_is_taken_across_a_restart():
    # A step as large as could be between two runs, each as smooth as could be.
    estimate = NoiseEstimate(1)
    for level in (0.0, 1e9, -1e9):
        estimate.restart()
        for _ in range(3):
            estimate.add(np.full((7, 1), level))
    assert estimate.standard_deviation[0] == 0.0
    estimate.add(np.full((1, 1), 1e9))
    assert estimate.standard_deviation[0] > 0


def test_samples_taken_are_not_kept_hold_of():
    samples = np.random.default_rng(6).standard_normal((50, 1))
    estimate, other = NoiseEstimate(1), NoiseEstimate(1)
    for part in (samples[:20].copy(), samples[20:].copy()):
        estimate.add(part)
        part[:] = 1e9
        other.add(samples[:20] if len(part) == 20 else samples[20:])
    np.testing.assert_array_equal(estimate.standard_deviation, other.standard_deviation)
