# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Noise found from the samples themselves, against noise of known size."""

from identnl_ros.core.measurement.noise import NoiseEstimate
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
    # Differences share samples: about three independent ones for ten.
    np.testing.assert_allclose(found(noise + wave + 7 * sizes), sizes, rtol=0.05)


def test_motion_at_a_tenth_of_the_sample_rate_leaves_its_tenth_difference():
    wave = np.sin(2 * np.pi * 0.1 * np.arange(5010))[:, np.newaxis]
    # Gain of a difference: 2 sin(pi f); the sum of its squared weights is binom(20, 10).
    expected = (2 * np.sin(0.1 * np.pi)) ** 10 / np.sqrt(184756) / np.sqrt(2)
    assert found(wave)[0] == pytest.approx(expected, rel=1e-3)
    assert expected < 2e-5


def test_polynomials_are_no_noise():
    time = np.linspace(-1, 1, 300)
    assert found(time[:, np.newaxis] ** np.arange(10))[1:].max() < 1e-13


def test_lost_samples_are_left_out():
    noise = np.random.default_rng(1).standard_normal((20000, 2))
    noise[::100, 0] = np.nan
    np.testing.assert_allclose(found(noise), 1.0, rtol=0.05)


def test_nothing_is_known_before_eleven_samples_in_a_row():
    assert np.isnan(found(np.ones((10, 2)))).all()
    assert np.isfinite(found(np.ones((11, 2)))).all()


def test_blocks_of_ten_samples_tell_the_noise_as_one_block_does():
    noise = np.random.default_rng(2).standard_normal((20000, 1))
    np.testing.assert_allclose(found(*np.split(noise, 2000)), found(noise), rtol=1e-9)


@pytest.mark.parametrize('size', [1, 3, 9, 10, 11, 997])
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
