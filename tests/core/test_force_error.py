# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Forces that a model lacks, read off the measured motion, are those of the machine as it is."""

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.effects.joint_element import joint_places
from identnl_ros.core.discrepancy.held_out import held_out_error
from identnl_ros.core.discrepancy.hidden_effect import choose_place, relative_size
from identnl_ros.core.discrepancy.library import EFFECTS
from identnl_ros.core.discrepancy.restoring_force import residual_along, restoring_force
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.core.test_diagnosis import small_machine
from tests.reference_machines import complete_layout

RATE = 4000.0
BY_NAME = {effect.name: effect for effect in EFFECTS}
NOISES = 10e-9, 0.01, 2e-6
SHARE = 0.05


def description(noise=1.0):
    machine = small_machine()
    return Description(machine, complete_layout(machine, *(noise * one for one in NOISES)))


def signals():
    return (multisine(30.0, (20.0, 400.0), 0.5, np.random.default_rng(3)),)


def hidden(believed, name, place):
    """Choose an effect as strong as a share of the exciters."""
    (hypothesis,) = choose_place(BY_NAME[name], believed, place)
    hypothesis, whole = relative_size(believed, hypothesis, signals(), RATE)
    return hypothesis, SHARE * whole


def errors(believed, hypothesis: Hypothesis, size):
    """Measure the stand as it is; compare it with the model without the effect and with it."""
    truth = hypothesis.applied(believed, size)
    stand = SimulatedStand(
        assemble(truth.machine), truth.layout, signals(), RATE, 5, 1,
        declared_layout=believed.layout,
    )  # fmt: skip
    record = MeasuredRecord(believed.layout, RATE, stand.read(3000).samples[952:])
    models = [assemble(one.machine) for one in (believed, truth)]
    found = [
        held_out_error(one, model, record).force
        for one, model in zip((believed, truth), models, strict=True)
    ]
    return models, found


@pytest.mark.parametrize(
    ('name', 'place'),
    [
        ('coulomb_friction', 'rail.axis_1'),
        ('cubic_stiffness', 'rail.axis_2'),
        ('backlash', 'rail.axis_3'),
        ('viscous_damping', 'rail.axis_1'),
    ],
)
def test_force_error_is_the_strength_of_what_is_missing(name, place):
    believed = description()
    (before, after) = errors(believed, *hidden(believed, name, place))[1]
    assert before.relative == pytest.approx(SHARE, rel=0.2)
    assert after.relative == pytest.approx(after.noise_floor, rel=0.1)
    assert after.noise_floor < 0.2 * SHARE


def test_noise_floor_grows_with_the_noise():
    floors = []
    for noise in (1.0, 3.0):
        believed = description(noise)
        floors.append(errors(believed, *hidden(believed, 'backlash', 'rail.axis_2'))[1][1])
    assert floors[1].noise_floor == pytest.approx(3 * floors[0].noise_floor, rel=0.2)
    assert floors[1].relative == pytest.approx(floors[1].noise_floor, rel=0.1)


@pytest.mark.parametrize('name', ['cubic_stiffness', 'backlash', 'coulomb_friction'])
def test_force_of_the_joint_is_reconstructed_without_knowing_what_is_missing(name):
    believed = description(1e-3)
    hypothesis, size = hidden(believed, name, 'rail.axis_2')
    models, found = errors(believed, hypothesis, size)
    measured = restoring_force(models[0], found[0], hypothesis.place)
    true = restoring_force(models[1], found[1], hypothesis.place)
    reconstructed = measured.elastic + measured.damping + measured.missing
    expected = true.elastic + true.damping
    missing = expected - measured.elastic - measured.damping
    off = (reconstructed - reconstructed.mean()) - (expected - expected.mean())
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.sqrt(np.mean((missing - missing.mean()) ** 2))


def test_model_without_the_effect_has_no_law_of_it():
    believed = description(1e-3)
    hypothesis, size = hidden(believed, 'cubic_stiffness', 'rail.axis_2')
    models, found = errors(believed, hypothesis, size)
    before = restoring_force(models[0], found[0], hypothesis.place)
    after = restoring_force(models[1], found[1], hypothesis.place)
    np.testing.assert_allclose(before.elastic, 5e6 * before.deformation)
    np.testing.assert_allclose(before.damping, 900.0 * before.rate)
    law = 5e6 * after.deformation + size * after.deformation**3
    np.testing.assert_allclose(after.elastic, law)


def test_residual_is_largest_where_the_effect_is_missing():
    believed = description()
    models, found = errors(believed, *hidden(believed, 'coulomb_friction', 'rail.axis_2'))
    shares = {
        place.label: residual_along(models[0], found[0], place)[0]
        for place in joint_places(believed)
    }
    assert max(shares, key=shares.get) == 'rail.axis_2'
    assert shares['rail.axis_2'] == pytest.approx(found[0].relative, rel=0.05)
