# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Clocks from jittering stamps: at the Cramer-Rao bound, robust, streaming, steps found."""

from identnl_ros.core.errors import DataError
from identnl_ros.core.synchronisation.clock_fit import ClockFit, fit_clock
import numpy as np
import pytest

RATE = 1e4
SKEW, OFFSET, JITTER = 40e-6, 3e-3, 5e-4
EPOCH = 1_700_000_000_000_000_000
RUNS = 60


def stamps_of(generator, count, late=0.0, jitter=JITTER):
    """Stamp every hundredth sample; a share arrives up to tens of milliseconds late."""
    index = np.arange(count) * 100
    noise = generator.normal(0, jitter, count)
    noise += np.where(generator.random(count) < late, generator.exponential(5e-3, count), 0.0)
    time = OFFSET + index / RATE * (1 + SKEW) + noise
    return index, EPOCH + np.round(time * 1e9).astype(np.int64)


def streamed(index, stamps, tolerance=np.inf):
    fit = ClockFit(RATE, tolerance)
    for one, stamp in zip(index.tolist(), stamps.tolist(), strict=True):
        fit.add(one, stamp)
    return fit


def errors_of(clock, middle):
    """Errors of the time in the middle and of the skew, and their standard deviations."""
    origin = (clock.origin_ns - EPOCH) / 1e9
    time = OFFSET + middle / RATE * (1 + SKEW)
    return (
        (origin + float(clock.time(middle)) - time, clock.skew - SKEW),
        (float(clock.standard_deviation(middle)), np.sqrt(clock.covariance[1, 1])),
    )


@pytest.mark.parametrize('fit', [
    lambda *stamps: fit_clock(RATE, *stamps, np.inf),
    lambda *stamps: streamed(*stamps).clock,
], ids=['whole record', 'stream'])  # fmt: skip
def test_clock_is_at_the_cramer_rao_bound(fit):
    count = 200
    errors, deviations = [], []
    for seed in range(RUNS):
        index, stamps = stamps_of(np.random.default_rng(seed), count)
        error, deviation = errors_of(fit(index, stamps), index.mean())
        errors.append(error)
        deviations.append(deviation)
    time = (index - index.mean()) / RATE
    bound = JITTER / np.sqrt([count, (time**2).sum()])
    found = np.sqrt(np.mean(np.square(errors), axis=0)) / bound
    assert np.all((found > 0.75) & (found < 1.25))
    np.testing.assert_allclose(np.mean(deviations, axis=0) / bound, 1, atol=0.05)
    inside = np.mean(np.abs(errors) < 1.96 * np.array(deviations), axis=0)
    assert np.all(inside >= 0.85)


def test_stream_and_whole_record_agree():
    index, stamps = stamps_of(np.random.default_rng(5), 500, late=0.05)
    whole, stream = fit_clock(RATE, index, stamps), streamed(index, stamps, 1e-4).clock
    (error, deviation), (other, _) = (errors_of(one, index.mean()) for one in (whole, stream))
    assert np.all(np.abs(np.subtract(error, other)) < 2 * np.array(deviation))


def test_late_arrivals_cost_little_and_are_no_steps():
    scores, offsets = [], []
    for seed in range(20):
        index, stamps = stamps_of(np.random.default_rng(seed), 400, late=0.1)
        fit = streamed(index, stamps)
        assert not fit.steps
        error, deviation = errors_of(fit.clock, index.mean())
        scores.append(error[1] / deviation[1])
        offsets.append(error[0])
    assert np.sqrt(np.mean(np.square(scores))) < 1.6
    # A tenth of the stamps late by 5 ms on average moves plain least squares by 0.5 ms.
    assert np.sqrt(np.mean(np.square(offsets))) < 0.3e-3


def test_no_step_is_seen_in_long_clean_stamps():
    assert not streamed(*stamps_of(np.random.default_rng(1), 20000)).steps


@pytest.mark.parametrize('lost', [30, 500])
def test_lost_samples_are_found_and_the_rate_kept(lost):
    index, stamps = stamps_of(np.random.default_rng(3), 600)
    stamps[400:] += round(lost / RATE * 1e9)
    fit = streamed(index, stamps)
    (step,) = fit.steps
    assert abs(step.index - index[400]) <= 500
    assert step.lost_samples == pytest.approx(lost, abs=4 * step.standard_deviation * RATE)
    assert step.standard_deviation < 3 * JITTER
    (_, skew), (_, deviation) = errors_of(fit.clock, 0.0)
    assert abs(skew) < 4 * deviation
    with pytest.raises(DataError, match=r'samples lost; cut the record there'):
        fit_clock(RATE, index, stamps)


def test_memory_of_a_stream_is_bounded():
    fit = streamed(*stamps_of(np.random.default_rng(1), 3000))
    assert len(fit._first) <= 32
    assert all(len(one.stamps) <= 513 for one in fit._suspicions)


def test_exact_stamps_give_the_clock_to_their_rounding():
    index, stamps = stamps_of(np.random.default_rng(1), 300, jitter=0.0)
    (offset, skew), _ = errors_of(fit_clock(RATE, index, stamps), 0.0)
    assert abs(offset) < 1e-9
    assert abs(skew) < 1e-9


def test_tolerance_of_the_crystal_bounds_what_few_stamps_tell():
    index, stamps = stamps_of(np.random.default_rng(1), 20)
    clock = fit_clock(RATE, index, stamps, 1e-4)
    assert abs(clock.skew) < 3e-4
    assert np.sqrt(clock.covariance[1, 1]) <= 1.01e-4


def test_misuse_is_told():
    fit = ClockFit(RATE)
    fit.add(100, EPOCH)
    with pytest.raises(DataError, match='in the order of the samples'):
        fit.add(100, EPOCH + 1)
    with pytest.raises(DataError, match='too few'):
        _ = fit.clock
    with pytest.raises(DataError, match='must be positive'):
        ClockFit(0.0)
