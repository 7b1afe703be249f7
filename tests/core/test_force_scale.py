# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Where everything is unknown but the force, it alone sets the scale; doubt spares no value."""

from dataclasses import replace

from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus, ParameterEstimate
from identnl_ros.core.estimation.force_scale import force_scale_remarks
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.machine import ConstantForce
import numpy as np
import pytest

from tests.core.machines import known, ORIGIN, oscillator, slideway, unknown, X, Z
from tests.reference_machines import knee_and_column

MASS, SPRING, DAMPING = unknown(10.0), unknown(4e5), unknown(200.0)
SLIDE = slideway(
    normal=X, longitudinal=Z, normal_stiffness=unknown(4e11), normal_damping=unknown(400.0),
    tangential_stiffness=known(0.0), coupled=False, preload=3e-6,
)  # fmt: skip


@pytest.mark.parametrize(
    ('machine', 'free'),
    [
        (oscillator(MASS, SPRING, DAMPING), True),
        (oscillator(MASS, SPRING, DAMPING, more_joints=(SLIDE,)), True),
        (oscillator(MASS, SPRING, DAMPING, gravity=9.81 * X), True),
        (oscillator(known(10.0), SPRING, DAMPING), False),
        (oscillator(MASS, known(4e5), DAMPING), False),
        (
            oscillator(
                MASS, SPRING, DAMPING,
                forces=(ConstantForce('hose', 'block', ORIGIN, X, known(3.0)),),
            ),
            False,
        ),
        (knee_and_column(), False),
    ],
    ids=['all', 'slideway', 'weight', 'mass', 'spring', 'constant force', 'knee and column'],
)  # fmt: skip
def test_force_sets_the_scale_only_where_no_number_is_known(machine, free):
    assert bool(force_scale_remarks(assemble(machine))) is free


def test_equations_of_a_free_machine_are_those_of_a_scaled_one_under_a_scaled_force():
    model = assemble(oscillator(MASS, SPRING, DAMPING, more_joints=(SLIDE,)))
    values = model.values[list(model.estimated)]
    motion = np.random.default_rng(0).standard_normal((2, 50, 1)) * 1e-6
    scaled = model.with_unknowns(1.03 * values)
    np.testing.assert_allclose(scaled.mass_diagonal(), 1.03 * model.mass_diagonal())
    np.testing.assert_allclose(scaled.joint_force(*motion), 1.03 * model.joint_force(*motion))


@pytest.mark.parametrize('status', list(EstimateStatus))
def test_contradictions_put_every_value_in_doubt(status):
    one = ParameterEstimate('k', 'k', 'N/m', 1.0, 0.1, status, 'why')
    estimate = Estimate('weak', (one,), np.eye(1), 10, 0, 1.0, 1.0)
    (doubted,) = estimate.doubted(['a1 contradicts.']).parameters
    without = EstimateStatus.UNKNOWN, EstimateStatus.NOT_IDENTIFIABLE
    assert doubted.status is (status if status in without else EstimateStatus.MODEL_IN_DOUBT)
    assert replace(doubted, status=status) == one
