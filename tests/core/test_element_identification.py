# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Elements are found by the weak estimator from noisy sensors."""

from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.estimation.identifier import identifier_for
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.weak.rough_start import rough_start
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
from identnl_ros.storage.state_file import load_state, save_state
import numpy as np
import pytest

from tests.core.element_cases import CASES, element
from tests.core.machines import (
    blocks_of,
    deviations_of,
    known,
    line_layout,
    motion_of,
    oscillator,
    truth_of,
    unknown,
    values_of,
)
from tests.core.weak_runs import (
    A,
    D,
    exact,
    feed,
    forgetful,
    identifier_of,
    LAYOUT,
    NOISE,
    noisy,
    RATE,
    statuses,
    V,
)


def estimated(model):
    identifier = identifier_for(forgetful(model), 'weak')
    for motion in motion_of(model, LAYOUT, blocks_of(noisy(exact(model)), RATE)):
        identifier.add(motion)
    return identifier.estimate()


@pytest.mark.parametrize('name', CASES)
def test_coefficient_is_found_within_its_standard_error(name):
    case = CASES[name]
    one = element(case.kind, unknown(case.coefficient), **case.numbers)
    model = assemble(oscillator(None, unknown(4e5), unknown(200.0), more_joints=(one,)))
    estimate = estimated(model)
    assert statuses(estimate) == {EstimateStatus.OK}
    error = abs(values_of(estimate) - truth_of(model))
    assert (error < 4 * deviations_of(estimate)).all()
    assert (deviations_of(estimate) < 0.01 * truth_of(model)).all()


def test_gap_of_backlash_is_found_as_well():
    truth = element('backlash', unknown(3e5), gap=unknown(4e-6))
    model = assemble(oscillator(None, unknown(4e5), unknown(200.0), more_joints=(truth,)))
    start = model.values
    start[[one.inner for one in model.parameters]] = 3e-6
    identifier = identifier_for(forgetful(model.with_values(start)), 'weak')
    for motion in motion_of(model, LAYOUT, blocks_of(noisy(exact(model)), RATE)):
        identifier.add(motion)
    estimate = identifier.estimate()
    error = abs(values_of(estimate) - truth_of(model))
    assert (error < 4 * deviations_of(estimate)).all()


# --- hysteresis over several chunks -----------------------------------------------------------

# The state is half of its limit where the record begins, and passes the limit later.
HYSTERETIC = assemble(
    oscillator(
        None, unknown(4e5), unknown(200.0),
        more_joints=(element('hysteresis', unknown(4e4), limit=1e-4, exponent=1.0),),
    )
)  # fmt: skip
SAMPLES = 3000
RUNS = 4


@pytest.fixture(scope='module')
def hysteretic():
    return exact(HYSTERETIC, count=SAMPLES)


@pytest.mark.parametrize(('memory', 'error'), [(None, 1e-6), (0.5, 1e-5)])
def test_hysteresis_is_found_exactly_by_perfect_sensors(hysteretic, memory, error):
    layout = line_layout(kinds=(D, A), noise=0.0)
    found = identifier_of(hysteretic, HYSTERETIC, layout, memory=memory).estimate()
    assert statuses(found) == {EstimateStatus.OK}
    np.testing.assert_allclose(values_of(found), truth_of(HYSTERETIC), rtol=error)


@pytest.mark.parametrize('memory', [None, 0.5])
def test_hysteresis_is_the_same_however_the_stream_arrives(hysteretic, memory):
    samples = noisy(hysteretic)
    whole, parts = (
        identifier_of(samples, HYSTERETIC, sizes=sizes, memory=memory).estimate()
        for sizes in ((), [37, 900, 513, 1, 700])
    )
    np.testing.assert_array_equal(values_of(parts), values_of(whole))
    np.testing.assert_array_equal(deviations_of(parts), deviations_of(whole))


def test_intervals_of_hysteresis_hold(hysteretic):
    scores = []
    for seed in range(RUNS):
        found = identifier_of(noisy(hysteretic, seed=seed), HYSTERETIC).estimate()
        assert statuses(found) == {EstimateStatus.OK}
        scores.append((values_of(found) - truth_of(HYSTERETIC)) / deviations_of(found))
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_hysteresis_goes_on_from_a_saved_state_amid_the_motion(hysteretic, tmp_path):
    samples = noisy(hysteretic)
    before = identifier_of(samples[:1500], HYSTERETIC)
    save_state(tmp_path / 'state.npz', before.state)
    after = WeakIdentifier(forgetful(HYSTERETIC))
    after.restore(load_state(tmp_path / 'state.npz'))
    feed(after, samples[1500:], HYSTERETIC, stream_id=2)
    found = after.estimate()
    assert statuses(found) == {EstimateStatus.OK}
    error = abs(values_of(found) - truth_of(HYSTERETIC))
    assert (error < 4 * deviations_of(found)).all()
    assert (deviations_of(found) < 0.9 * deviations_of(before.estimate())).all()


# --- the start --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('known_element', 'kinds'),
    [(False, (D,)), (False, (D, V)), (True, (D,))],
    ids=['unknown', 'unknown, rate measured', 'known'],
)
@pytest.mark.parametrize('name', CASES)
def test_windows_give_a_start_beside_elements(name, known_element, kinds):
    case = CASES[name]
    coefficient = (known if known_element else unknown)(case.coefficient)
    one = element(case.kind, coefficient, **case.numbers)
    model = assemble(oscillator(None, unknown(4e5), unknown(200.0), more_joints=(one,)))
    layout = line_layout(kinds=kinds, noise=NOISE)
    samples = noisy(exact(model, layout, count=1600), layout)
    found = rough_start(forgetful(model), MeasuredRecord(layout, RATE, samples))
    relative = found.values[list(model.estimated)] / truth_of(model)
    np.testing.assert_allclose(relative[:2], 1.0, atol=0.02)
    np.testing.assert_allclose(relative[2:], 1.0, atol=0.3)
