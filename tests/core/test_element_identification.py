# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Elements are found by the weak estimator from noisy sensors."""

from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.estimation.identifier import identifier_for
from identnl_ros.core.mechanics.assembly import assemble
import pytest

from tests.core.element_cases import CASES, element
from tests.core.machines import (
    blocks_of,
    deviations_of,
    motion_of,
    oscillator,
    truth_of,
    unknown,
    values_of,
)
from tests.core.weak_runs import exact, forgetful, LAYOUT, noisy, RATE, statuses


def estimated(model):
    identifier = identifier_for(forgetful(model), 'weak')
    for motion in motion_of(model, LAYOUT, blocks_of(noisy(exact(model)), RATE)):
        identifier.add(motion)
    return identifier.estimate()


@pytest.mark.parametrize('name', [name for name in CASES if name != 'hysteresis'])
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
