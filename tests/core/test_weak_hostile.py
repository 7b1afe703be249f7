# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The weak identifier on bad data and wrong models: doubted, never confidently wrong."""

from dataclasses import replace

from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.core.machines import (
    deviations_of,
    line_layout,
    oscillator,
    truth_of,
    unknown,
    values_of,
)
from tests.core.weak_runs import (
    A,
    D,
    exact,
    F,
    identifier_of,
    LAYOUT,
    MULTISINE,
    NOISE,
    noisy,
    OSCILLATOR,
    RATE,
    SETTLING,
    statuses,
)

OK, DOUBT = EstimateStatus.OK, EstimateStatus.MODEL_IN_DOUBT
TRUTH = truth_of(OSCILLATOR)
RECORD = noisy(exact(count=6000))


def assert_right(found, truth=TRUTH):
    assert statuses(found) == {OK}
    assert np.all(np.abs(values_of(found) - truth) < 4.5 * deviations_of(found))


@pytest.mark.parametrize('share', [0.05, 0.2])
def test_missing_readings_of_motion_cost_information_only(share):
    samples = RECORD.copy()
    lost = np.random.default_rng(2).random((len(samples), 2)) < share
    samples[:, 1:][lost] = np.nan
    found = identifier_of(samples).estimate()
    assert_right(found)
    kept = (1 - share) ** 2
    assert found.samples == pytest.approx(len(samples) * kept, rel=0.02)


def test_missing_readings_of_force_cut_the_record():
    samples = RECORD.copy()
    samples[[900, 2500, 2501, 4000], 0] = np.nan
    found = identifier_of(samples).estimate()
    assert_right(found)
    assert found.rejected_samples == 4


@pytest.mark.parametrize('part', [slice(None, 2500), slice(3000, None)], ids=['first', 'last'])
def test_a_sensor_that_is_silent_for_a_long_time_costs_that_time_only(part):
    samples = RECORD.copy()
    samples[part, 1] = np.nan
    assert_right(identifier_of(samples).estimate())


@pytest.mark.parametrize(
    'samples',
    [
        0 * RECORD,
        noisy(0 * RECORD),
        np.zeros_like(RECORD) + RECORD[100],
        np.where([True, False, True], RECORD, np.nan),
        RECORD[:1],
        RECORD[:30],
        RECORD[:100],
    ],
    ids=['zero', 'noise alone', 'constant', 'no displacement', 'one', 'thirty', 'hundred'],
)
def test_data_that_tell_nothing_give_no_number(samples):
    found = identifier_of(samples).estimate()
    assert statuses(found) == {EstimateStatus.UNKNOWN}
    assert np.isnan(values_of(found)).all()


def test_motion_drowned_in_a_millimetre_of_noise_gives_no_number():
    layout = line_layout(kinds=(D, A), noise={**NOISE, D: 1e-3, A: 100.0})
    found = identifier_of(noisy(exact(), layout), layout=layout).estimate()
    assert OK not in statuses(found)


def test_motion_without_a_force_that_explains_it_is_not_believed():
    samples = noisy(exact())
    samples[:, 0] = 0.0
    assert OK not in statuses(identifier_of(samples).estimate())


def test_force_beyond_all_bounds_is_survived():
    samples = RECORD.copy()
    samples[3000:, 0] *= 1e6
    assert OK not in statuses(identifier_of(samples).estimate())


def test_short_records_of_strongly_nonlinear_motion_are_followed_from_their_beginnings():
    # The cubic force is five times the linear one: a simulation from the weak-form start
    # leaves the measured motion long before the end of the record.
    hard = assemble(oscillator(None, unknown(4e5), unknown(200.0), None, unknown(5e16)))
    for force in (5.0, 20.0):
        signal = multisine(force, (5.0, 80.0), 0.5, np.random.default_rng(3))
        assert_right(identifier_of(noisy(exact(hard, signal=signal)), hard).estimate(),
                     truth_of(hard))  # fmt: skip


class Late:
    """A force that sets in smoothly after a while."""

    def __init__(self, signal, start, rise):
        self._signal, self._start, self._rise = signal, start, rise

    def on_grid(self, start, step, count):
        share = np.clip((start + step * np.arange(count) - self._start) / self._rise, 0, 1)
        smooth = share**4 * (35 - 84 * share + 70 * share**2 - 20 * share**3)
        return self._signal.on_grid(start, step, count) * smooth


@pytest.mark.parametrize('silence', [1.5, 18.0])
def test_excitation_may_set_in_late(silence):
    count = round((silence + 2.5) * RATE) - SETTLING
    samples = noisy(exact(signal=Late(MULTISINE, silence, 0.3), count=count))
    assert_right(identifier_of(samples, sizes=[500] * 100).estimate())


def changed(kind, **values):
    """Layout with the sensors of a kind changed."""
    return Layout(tuple(
        replace(one, **values) if one.kind is kind else one for one in LAYOUT.sensors
    ))  # fmt: skip


def read_by(actual, count=6000):
    """Return what imperfect sensors read where LAYOUT is believed."""
    stand = SimulatedStand(OSCILLATOR, actual, (MULTISINE,), RATE, 1, 1, 0, LAYOUT)
    return stand.read(count + SETTLING).samples[SETTLING:]


@pytest.mark.parametrize(
    'actual',
    [
        changed(A, gain=1.02),
        changed(A, gain=0.99),
        changed(D, gain=1.02),
        changed(A, gain=-1.0),
        changed(A, delay=25e-6),
        changed(F, delay=100e-6),
        LAYOUT.with_noise_times(3.0),
    ],
    ids=['acceleration gain 2 %', 'acceleration gain 1 %', 'displacement gain 2 %', 'polarity',
         'acceleration 25 us late', 'force 100 us late', 'three times the noise'],
)  # fmt: skip
def test_wrong_layout_is_doubted(actual):
    assert OK not in statuses(identifier_of(read_by(actual)).estimate())


def test_gain_of_the_force_cell_is_doubted_where_the_mass_is_known():
    assert OK not in statuses(identifier_of(read_by(changed(F, gain=1.02))).estimate())


@pytest.mark.parametrize('share', [1.0, 0.1])
def test_cubic_spring_that_the_model_lacks_is_doubted(share):
    true = assemble(
        oscillator(None, unknown(4e5), unknown(200.0), None, unknown(share * 5e15))
    )  # fmt: skip
    linear = assemble(oscillator(None, unknown(4e5), unknown(200.0)))
    assert OK not in statuses(identifier_of(noisy(exact(true)), linear).estimate())
