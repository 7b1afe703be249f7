# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The weak identifier: at the Cramer-Rao bound, with intervals that hold, streamed."""

from dataclasses import replace

from identnl_ros.core.design.fisher import expected_information
from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine, sine
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
from identnl_ros.storage.state_file import load_state, save_state
import numpy as np
import pytest
from scipy.stats import binom

from tests.core.machines import (
    blocks_of,
    deviations_of,
    line_layout,
    motion_of,
    truth_of,
    values_of,
)
from tests.core.weak_runs import (
    A,
    D,
    exact,
    forgetful,
    identifier_of,
    LAYOUT,
    MULTISINE,
    NOISE,
    noisy,
    OSCILLATOR,
    RATE,
    SETTLING,
    SINE,
    SLIDING,
    statuses,
    V,
)
from tests.reference_machines import complete_layout, knee_and_column

OK, DOUBT = EstimateStatus.OK, EstimateStatus.MODEL_IN_DOUBT
TRUTH = truth_of(OSCILLATOR)
RUNS = 50


def studied(model, layout, signal, declared=None):
    """Errors over Cramer-Rao, z-scores and the number of doubts of many noisy runs."""
    samples = exact(model, layout, signal)
    truth = truth_of(model)
    errors, scores, doubts = [], [], 0
    for seed in range(RUNS):
        found = identifier_of(noisy(samples, layout, seed), model, declared or layout).estimate()
        assert statuses(found) <= {OK, DOUBT}
        doubts += DOUBT in statuses(found)
        errors.append(values_of(found) - truth)
        scores.append(errors[-1] / deviations_of(found))
    bound = expected_information(
        model, layout, (signal,), RATE, len(samples) / RATE, SETTLING / RATE
    ).solve().inverse  # fmt: skip
    return np.array(errors) / np.sqrt(np.diag(bound)), np.array(scores), doubts


def assert_intervals_hold(scores, doubts):
    inside = (np.abs(scores) < 1.96).sum(axis=0)
    low, high = binom.ppf([5e-4, 1 - 5e-4], RUNS, 0.95)
    assert np.all((low <= inside) & (inside <= high)), inside / RUNS
    assert np.all(np.abs(scores.mean(axis=0)) < 4 * scores.std(axis=0) / np.sqrt(RUNS))
    assert doubts <= binom.ppf(0.999, RUNS, 0.01)


@pytest.mark.parametrize(
    ('model', 'kinds', 'signal'),
    [
        (OSCILLATOR, (D, A), MULTISINE),
        (OSCILLATOR, (D,), MULTISINE),
        (OSCILLATOR, (D, V, A), SINE),
        (SLIDING, (D,), SINE),
    ],
    ids=['cubic', 'displacement', 'velocity, sine', 'slideway, displacement, sine'],
)
def test_errors_are_those_of_the_cramer_rao_bound_and_intervals_hold(model, kinds, signal):
    ratios, scores, doubts = studied(model, line_layout(kinds=kinds, noise=NOISE), signal)
    # The root mean square of 50 errors is itself good to 10 %.
    efficiency = np.sqrt((ratios**2).mean(axis=0))
    assert np.all((efficiency > 0.65) & (efficiency < 1.4)), efficiency
    assert 0.85 < np.sqrt((ratios**2).mean()) < 1.15
    assert_intervals_hold(scores, doubts)


def test_intervals_hold_where_the_noise_is_not_stated():
    unstated = Layout(tuple(replace(one, noise=np.nan) for one in LAYOUT.sensors))
    _, scores, doubts = studied(OSCILLATOR, LAYOUT, MULTISINE, unstated)
    assert_intervals_hold(scores, doubts)


# --- knee and column --------------------------------------------------------------------------


def knee_estimate(signal, coupled=False, noise=(1e-8, 1e-2), count=4000):
    machine = knee_and_column(coupled)
    model, layout = assemble(machine), complete_layout(machine, *noise, kinds=(D, A))
    samples = exact(model, layout, signal, count, 1e4)
    found = identifier_of(noisy(samples, layout), model, layout, rate=1e4).estimate()
    return found, truth_of(model)


@pytest.mark.parametrize('coupled', [False, True], ids=['decoupled', 'coupled'])
@pytest.mark.parametrize('excitation', ['multisine', 'sine'])
@pytest.mark.parametrize('noise', [(1e-8, 1e-2), (1e-7, 1e-1)], ids=['nominal', 'rough'])
def test_sixteen_parameters_lie_within_their_errors(excitation, coupled, noise):
    signal = (
        sine(1000.0, 40.0) if excitation == 'sine'
        else multisine(1000.0, (5.0, 300.0), 1.0, np.random.default_rng(3))
    )  # fmt: skip
    found, truth = knee_estimate(signal, coupled, noise)
    assert statuses(found) == {OK}
    assert np.all(np.abs(values_of(found) - truth) < 4.5 * deviations_of(found))


def test_sixteen_parameters_return_from_clean_data_to_1e_9():
    signal = multisine(1000.0, (5.0, 300.0), 1.0, np.random.default_rng(3))
    found, truth = knee_estimate(signal, noise=(0.0, 0.0), count=3000)
    assert statuses(found) == {OK}
    assert np.abs(values_of(found) / truth - 1).max() < 1e-9


# --- streaming --------------------------------------------------------------------------------

RECORD = noisy(exact(count=6000))


def assert_same_bits(first, second):
    np.testing.assert_array_equal(values_of(first), values_of(second))
    np.testing.assert_array_equal(first.covariance, second.covariance)
    assert first == replace(second, covariance=first.covariance)


@pytest.mark.parametrize('sizes', [[1] * 6000, [777] * 8, [3000, 2, 1], [5000]])
@pytest.mark.parametrize('stated', [True, False])
def test_cutting_the_record_into_blocks_does_not_change_a_bit(sizes, stated):
    layout = LAYOUT if stated else line_layout(kinds=(D, A), noise=np.nan)
    whole, parts = (identifier_of(RECORD, layout=layout, sizes=cut) for cut in ((), sizes))
    assert_same_bits(whole.estimate(), parts.estimate())


def test_asking_for_an_estimate_or_a_state_changes_nothing():
    asked, silent = (WeakIdentifier(forgetful(OSCILLATOR)) for _ in range(2))
    for motion in motion_of(OSCILLATOR, LAYOUT, blocks_of(RECORD, RATE, [700] * 8)):
        for one in (asked, silent):
            one.add(motion)
        if asked.estimate().samples > 3000:
            assert asked.state.samples == asked.samples
    assert_same_bits(asked.estimate(), silent.estimate())


def test_repeated_and_foreign_blocks_do_not_count():
    once, twice = (WeakIdentifier(forgetful(OSCILLATOR)) for _ in range(2))
    motions = motion_of(OSCILLATOR, LAYOUT, blocks_of(RECORD, RATE, [2000, 2000]))
    assert [once.add(motion) for motion in motions] == [True] * 3
    foreign = replace(motions[0], stream_id=9)
    order = (motions[0], motions[0], foreign, motions[1], motions[0], motions[2])
    assert [twice.add(motion) for motion in order] == [True, False, False, True, False, True]
    assert_same_bits(once.estimate(), twice.estimate())


@pytest.mark.parametrize('pause', [1, 2, 3])
def test_saved_and_restored_identifier_agrees_with_one_that_went_on(tmp_path, pause):
    motions = motion_of(OSCILLATOR, LAYOUT, blocks_of(RECORD, RATE, [2400, 1200, 1200]))
    steady, stopped, restored = (WeakIdentifier(forgetful(OSCILLATOR)) for _ in range(3))
    for motion in motions:
        steady.add(motion)
    for motion in motions[:pause]:
        stopped.add(motion)
    save_state(tmp_path / 'state.npz', stopped.state)
    restored.restore(load_state(tmp_path / 'state.npz'))
    assert restored.estimate().parameters == stopped.estimate().parameters
    for motion in motions:
        restored.add(motion)
    first, second = steady.estimate(), restored.estimate()
    assert second.samples == first.samples
    deviations = deviations_of(first)
    # The state at the pause is not saved: what it would have told is lost, so that the two differ
    # by as much as the variances do.
    lost = np.sqrt(np.maximum(deviations_of(second) ** 2 - deviations**2, 0.0))
    difference = np.abs(values_of(first) - values_of(second))
    assert np.all(difference < 4.5 * lost + 0.3 * deviations)
    assert np.all(deviations_of(second) > 0.99 * deviations)
    assert np.all(deviations_of(second) < 1.6 * deviations)
