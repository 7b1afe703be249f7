# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What data contradict puts the result of the weak identifier in doubt, and says what."""

from dataclasses import replace
import re

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.estimation.alternatives import KindDelay, KindGain, OtherMass
from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.estimation.residual_statistics import ResidualStatistics
from identnl_ros.core.estimation.score_tests import score_tests, ScoreNoise
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
from identnl_ros.storage.state_file import load_state, save_state
import numpy as np
import pytest
from scipy.stats import binom

from tests.core.machines import deviations_of, known, oscillator, truth_of, unknown, values_of
from tests.core.weak_runs import (
    exact,
    F,
    forgetful,
    identifier_of,
    LAYOUT,
    noisy,
    OSCILLATOR,
    RATE,
    SETTLING,
    SINE,
    statuses,
)

OK, DOUBT = EstimateStatus.OK, EstimateStatus.MODEL_IN_DOUBT
CLEAN = exact(count=4000)
FORCE = [sensor.kind for sensor in LAYOUT.sensors].index(F)


def with_force(samples, gain=1.0, delay=0.0):
    """Change the readings of the force cell; a delay in samples, of a periodic force."""
    changed = samples.copy()
    lines = np.fft.rfft(samples[:, FORCE])
    turn = np.exp(-2j * np.pi * np.arange(len(lines)) * delay / len(samples))
    changed[:, FORCE] = gain * np.fft.irfft(lines * turn, len(samples))
    return changed


# --- sensors that are stated to be perfect ----------------------------------------------------

PERFECT = LAYOUT.with_noise_times(0.0)


@pytest.mark.parametrize('noise', [0.0, 1.0])
@pytest.mark.parametrize('error', [{'gain': 1.005}, {'gain': 1.001}, {'delay': 0.02}])
def test_wrong_force_is_doubted_where_sensors_are_stated_to_be_perfect(error, noise):
    samples = noisy(with_force(CLEAN, **error), LAYOUT.with_noise_times(noise))
    found = identifier_of(samples, layout=PERFECT).estimate()
    assert statuses(found) == {DOUBT}
    assert any('slow part of the residual' in note for note in found.notes)


def test_noise_of_sensors_that_are_stated_to_be_perfect_is_told_and_counted():
    truth = truth_of(OSCILLATOR)
    found = identifier_of(noisy(CLEAN), layout=PERFECT).estimate()
    assert statuses(found) == {DOUBT}
    # The weights are wrong; the errors are still those of that noise, not of none.
    assert np.all(np.abs(values_of(found) - truth) < 5 * deviations_of(found))
    assert any('without noise, but' in note for note in found.notes)
    unstated = Layout(tuple(replace(one, noise=np.nan) for one in LAYOUT.sensors))
    assert statuses(identifier_of(noisy(CLEAN), layout=unstated).estimate()) == {OK}


# --- what may be wrong, each by itself ----------------------------------------------------------


def test_score_is_the_estimate_of_the_alternative_beside_the_unknowns_over_its_error():
    generator = np.random.default_rng(1)
    table = generator.standard_normal((200, 6))
    table[:, 5] = table[:, :3] @ (1.0, 2.0, 3.0)  # the unknowns imitate it
    target = table @ (1.0, -2.0, 0.5, 0.0, 0.3, 0.0) + generator.standard_normal(200)
    information = Information.empty(6).with_rows(table, target)
    alternatives = [KindGain(0), KindDelay(0), KindGain(1)]
    found = score_tests(information, 3, alternatives, ScoreNoise(1.0, 0.0, None, 24))
    for place, one in zip((3, 4), found, strict=False):
        whole = table[:, [0, 1, 2, place]]
        inverse = np.linalg.inv(whole.T @ whole)
        values = inverse @ whole.T @ target
        without = np.linalg.lstsq(table[:, :3], target)[0]
        assert one.size == pytest.approx(values[3], rel=1e-9)
        assert one.deviation == pytest.approx(np.sqrt(inverse[3, 3]), rel=1e-9)
        np.testing.assert_allclose(one.effect * values[3], values[:3] - without, rtol=1e-9)
    assert np.isinf(found[2].deviation)
    assert found[2].score == 0


LINEAR = assemble(oscillator(None, unknown(4e5), unknown(200.0)))
MASS_TOO = assemble(oscillator(unknown(10.0), unknown(4e5), unknown(200.0)))
BROADBAND = exact(LINEAR, count=4000)
HEAVIER = exact(assemble(oscillator(known(10.0006), unknown(4e5), unknown(200.0))), count=4000)


def test_score_of_a_mass_is_that_of_its_estimate_where_it_is_unknown():
    identifier = identifier_of(noisy(HEAVIER), LINEAR)
    score = next(one for one in identifier.tests() if isinstance(one.alternative, OtherMass))
    mass = identifier_of(noisy(HEAVIER), MASS_TOO).estimate().parameters[0]
    assert mass.name == 'block.mass'
    assert score.deviation == pytest.approx(mass.standard_deviation, rel=0.05)
    assert abs(score.size - (mass.value - 10.0)) < 0.1 * mass.standard_deviation


@pytest.mark.parametrize(
    ('samples', 'named'),
    [
        (HEAVIER, r'block\.mass of 10\.0\d+ \+- 0\.0\d+ kg instead of 10 kg'),
        (with_force(BROADBAND, gain=1.00006), r'force that reads 0\.\d+ \+- 0\.\d+ % too much'),
        (with_force(BROADBAND, delay=0.0006), r'force that is \d+\.\d+ \+- \d+\.\d+ us late'),
    ],
    ids=['mass', 'gain', 'delay'],
)
def test_errors_too_small_for_the_residual_as_a_whole_are_doubted_and_named(samples, named):
    found = identifier_of(noisy(samples), LINEAR).estimate()
    assert statuses(found) == {DOUBT}
    assert any(re.search(named, note) for note in found.notes), found.notes
    assert not any('slow part' in note for note in found.notes)


def test_tests_survive_saving(tmp_path):
    identifier = identifier_of(noisy(HEAVIER), LINEAR)
    save_state(tmp_path / 'state.npz', identifier.state)
    restored = WeakIdentifier(forgetful(LINEAR))
    restored.restore(load_state(tmp_path / 'state.npz'))
    assert [one.score for one in restored.tests()] == pytest.approx(
        [one.score for one in identifier.tests()], rel=1e-6
    )
    assert statuses(restored.estimate()) == {DOUBT}


def test_few_of_the_tests_are_false_alarms():
    samples = exact(LINEAR, count=1600)
    doubts = sum(
        DOUBT in statuses(identifier_of(noisy(samples, seed=seed), LINEAR).estimate())
        for seed in range(20)
    )
    assert doubts <= binom.ppf(0.999, 20, 0.01)


@pytest.mark.parametrize('rest', [0, 400])
def test_rest_does_not_hide_what_shows_in_motion(rest):
    generator = np.random.default_rng(2)
    statistics = ResidualStatistics(2, 8)
    for chunk in range(rest + 5):
        residuals = generator.standard_normal((512, 2))
        if chunk < 5:
            residuals += 0.3 * np.sin(np.arange(512) / 40)[:, np.newaxis]
        statistics.add(residuals, energy=1e4 if chunk < 5 else 1e-6)
    ratio, deviation = statistics.moving_excess(0)
    assert ratio - 1 > 4 * deviation
    ratio, deviation = statistics.slow_excess(0)
    assert (ratio - 1 > 4 * deviation) == (not rest)


# --- what nothing in the data contradicts -------------------------------------------------------

REST = 2000
SETTLED = exact(LINEAR, signal=SINE, count=REST + 4000)[REST:]
LATE = 25e-6


def unseen(found):
    return [note for note in found.notes if note.startswith('Nothing in these data')]


def test_settled_sine_says_what_it_cannot_contradict_and_what_that_would_change():
    good = identifier_of(noisy(SETTLED), LINEAR).estimate()
    assert statuses(good) == {OK}
    (note,) = unseen(good)
    told = re.search(r'force that is 25 us late \(it would change (\S+) by (\S+) %\)', note)
    assert told, note
    # The same reading of a force that is in truth as late.
    force = SINE.on_grid((SETTLING + REST) / RATE - LATE, 1 / RATE, len(SETTLED))
    samples = SETTLED.copy()
    samples[:, FORCE] = force
    late = identifier_of(noisy(samples), LINEAR).estimate()
    assert statuses(late) == {OK}
    names = [one.name for one in good.parameters]
    change = (values_of(late) / values_of(good) - 1)[names.index(told[1])]
    assert abs(change) == pytest.approx(float(told[2]) / 100, rel=0.1)


def test_broadband_excitation_leaves_nothing_unseen():
    assert not unseen(identifier_of(noisy(BROADBAND), LINEAR).estimate())


def test_gain_of_the_force_is_not_seen_where_the_mass_is_unknown():
    (note,) = unseen(identifier_of(noisy(BROADBAND), MASS_TOO).estimate())
    assert 'force that reads 1 % too much' in note
    assert 'No mass is known' in note
