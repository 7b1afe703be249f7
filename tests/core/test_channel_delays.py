# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Late channels: the right ones are told, and no good one, whatever else is wrong."""

from dataclasses import replace

from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.synchronisation.channel_delays import channel_delays
from identnl_ros.core.synchronisation.late_channels import late_channels
import numpy as np
import pytest
from scipy.stats import binom

from tests.core.test_synchronisation_delays import A, BLOCK, D, noisy, RATE, readings, V
from tests.reference_machines import complete_layout, knee_and_column

MACHINE = assemble(knee_and_column())
NOISE = {D: 1e-8, V: 2e-6, A: 1e-2}
KINDS = (D, D, V, A, A, A)
SIX = Layout(
    tuple(Sensor(f's{i}', kind, 'block', noise=NOISE[kind]) for i, kind in enumerate(KINDS))
)
RUNS = 40


def judged(samples, layout=SIX, model=BLOCK):
    """Late channels of the only group, and what was found."""
    found = channel_delays(model, MeasuredRecord(layout, RATE, samples))
    assert np.all(found.groups == found.groups[0])
    return late_channels(found.delays, found.covariance), found


@pytest.mark.parametrize('delays', [{}, {4: 100e-6}, {0: -80e-6, 3: 30e-6}])
def test_late_channels_are_told_no_other_is_and_deviations_hold(delays):
    truth = np.array([delays.get(i, 0.0) for i in range(6)])
    clean = readings(BLOCK, SIX, truth)
    scores = []
    for seed in range(RUNS):
        result, found = judged(noisy(clean, SIX, seed))
        assert result.late == frozenset(delays)
        assert not result.rivals
        assert np.all(found.widened == 1)
        scores.append((result.delays - truth) / result.standard_deviations)
    inside = (np.abs(scores) < 1.96).sum(axis=0)
    low, high = binom.ppf([1e-3, 1 - 1e-3], RUNS, 0.95)
    assert np.all((inside >= low) & (inside <= max(high, RUNS))), inside
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.2


def test_two_against_two_are_told_as_such():
    layout = replace(SIX, sensors=SIX.sensors[:2] + SIX.sensors[4:])
    clean = readings(BLOCK, layout, np.array([0.0, 0.0, 1e-4, 1e-4]))
    result, _ = judged(noisy(clean, layout, 1), layout)
    assert {result.late, *result.rivals} == {frozenset({0, 1}), frozenset({2, 3})}


def test_the_fewest_are_late_however_precise_they_are():
    # Two sensors of a thousandth of the noise weigh more than all others together.
    covariance = np.diag([1e-6] * 4 + [1e-9] * 2) ** 2
    delays = np.array([0.0, 0.4e-6, -0.5e-6, 0.2e-6, 50e-6, 50e-6])
    centred = np.eye(6) - 1 / 6
    result = late_channels(centred @ delays, centred @ covariance @ centred)
    assert result.late == {4, 5}
    np.testing.assert_allclose(result.delays[4:], 50e-6, atol=3e-6)
    np.testing.assert_allclose(result.standard_deviations[4:], 0.5e-6, rtol=1e-2)


@pytest.mark.parametrize('channel', [1, 4])
def test_hum_makes_no_channel_late(channel):
    clean = readings(BLOCK, SIX, np.zeros(6))
    line = 2 * np.pi * 50 * np.arange(len(clean)) / RATE
    for seed in range(10):
        samples = noisy(clean, SIX, seed)
        hum = 5 * NOISE[KINDS[channel]]
        samples[:, channel] += hum * np.sin(line + seed)
        result, found = judged(samples)
        assert not result.late
        assert np.all(found.widened > 1)


def test_a_late_channel_is_found_through_noise_that_is_stated_too_small():
    clean = readings(BLOCK, SIX, np.array([0, 0, 0, 0, 1e-4, 0]))
    loud = replace(SIX, sensors=tuple(replace(one, noise=2 * one.noise) for one in SIX.sensors))
    scores = []
    for seed in range(RUNS):
        result, _ = judged(noisy(clean, loud, seed))
        assert result.late == {4}
        scores.append((result.delays[4] - 1e-4) / result.standard_deviations[4])
    assert np.sqrt(np.mean(np.square(scores))) < 1.2


def test_gains_that_are_a_per_cent_off_make_no_channel_late():
    layout = complete_layout(MACHINE.machine, 1e-8, 1e-2, kinds=(D, A))
    clean = readings(MACHINE, layout, np.zeros(len(layout.sensors)), count=1500)
    for seed in range(4):
        gains = 1 + 0.01 * np.random.default_rng(100 + seed).standard_normal(clean.shape[1])
        record = MeasuredRecord(layout, RATE, noisy(clean * gains, layout, seed))
        found = channel_delays(MACHINE, record)
        assert np.all(found.unexplained < 0.1)
        for group in np.unique(found.groups):
            own = np.flatnonzero(found.groups == group)
            result = late_channels(found.delays[own], found.covariance[np.ix_(own, own)])
            assert not result.late


def test_an_inverted_channel_is_unexplained():
    clean = readings(BLOCK, SIX, np.zeros(6)) * np.array([1, 1, 1, 1, -1, 1])
    _, found = judged(noisy(clean, SIX, 1))
    assert found.unexplained[4] > 0.5


def test_a_late_channel_is_found_among_its_neighbours():
    layout = complete_layout(MACHINE.machine, 1e-8, 1e-2, kinds=(D, A))
    delays = np.zeros(len(layout.sensors))
    delays[5] = 25e-6
    clean = readings(MACHINE, layout, delays, count=1500)
    found = channel_delays(MACHINE, MeasuredRecord(layout, RATE, noisy(clean, layout, 1)))
    body = [name.partition('_')[0] for name in found.names]
    truth = delays[1:].copy()
    for name in set(body):
        own = np.array([one == name for one in body])
        truth[own] -= truth[own].mean()
    scores = (found.delays - truth) / found.standard_deviations
    assert np.abs(scores).max() < 4.5
    assert 0.6 < np.sqrt(np.mean(scores**2)) < 1.4
    assert found.names[int(np.argmax(found.delays))] == layout.sensors[5].name


def test_what_no_other_sensor_sees_has_no_delay():
    model = assemble(knee_and_column())
    whole = complete_layout(model.machine, 1e-8, 1e-2, kinds=(D, A))
    # The knee has displacement sensors alone, six that are just enough.
    knee = [one for one in whole.sensors if one.body == 'knee' and one.kind is D]
    few = [one for one in knee if one.name[-2:] in {'0x', '0y', '0z', '1y', '1z', '2x'}]
    layout = Layout((*(one for one in whole.sensors if one.body != 'knee'), *few))
    clean = readings(model, layout, np.zeros(len(layout.sensors)), count=1500)
    found = channel_delays(model, MeasuredRecord(layout, RATE, noisy(clean, layout, 1)))
    alone = np.array([name.startswith('knee') for name in found.names])
    assert np.isinf(found.standard_deviations[alone]).all()
    assert np.isfinite(found.standard_deviations[~alone]).all()
