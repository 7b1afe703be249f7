# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What data contradict puts the result of the weak identifier in doubt, and says what."""

from dataclasses import replace

from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.layout import Layout
import numpy as np
import pytest

from tests.core.machines import deviations_of, truth_of, values_of
from tests.core.weak_runs import (
    exact,
    F,
    identifier_of,
    LAYOUT,
    noisy,
    OSCILLATOR,
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
