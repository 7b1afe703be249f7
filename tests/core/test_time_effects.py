# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Effects that depend on time: where they can be, what they add, how a stand looks with them."""

from identnl_ros.core.discrepancy.circumstances import Course, Scale, Signals
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effects.drifting_stiffness import DriftingStiffness
from identnl_ros.core.discrepancy.effects.sensor_drift import SensorDrift
from identnl_ros.core.discrepancy.effects.unmeasured_periodic_force import (
    UnmeasuredPeriodicForce,
)
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.storage.machine_file import read_machine
from identnl_ros.storage.machine_writing import machine_text
import numpy as np
import pytest

from tests.core.machines import line_layout, oscillator, skew_machine

TIME = np.arange(50) / 500
TURNING = Description(skew_machine(), line_layout())
STRAIGHT = Description(oscillator(), line_layout())


def scale_of(description, frequencies=()):
    """Let every joint move."""
    keys = [(one.name, axis) for one in description.machine.joints for axis in range(1, 7)]
    return Scale(dict.fromkeys(keys, 1e-6), dict.fromkeys(keys, 1e-3), frequencies)


def course_of(description):
    model = assemble(description.machine)
    still = np.zeros((len(TIME), len(model.coordinates)))
    return Course(description, model, TIME, still, still, still, np.zeros((len(TIME), 1)))


def test_periodic_force_is_where_bodies_move():
    effect = UnmeasuredPeriodicForce()
    assert [place.label for place in effect.places(STRAIGHT)] == ['block.axis_1']
    axes = {place.axis for place in effect.places(TURNING)}
    assert axes == {1, 2, 3, 4, 5, 6}


def test_periodic_force_tries_the_frequencies_it_is_told():
    effect = UnmeasuredPeriodicForce()
    (place,) = effect.places(STRAIGHT)
    assert effect.variants(STRAIGHT, place, scale_of(STRAIGHT)) == ()
    variants = effect.variants(STRAIGHT, place, scale_of(STRAIGHT, (37.0, 50.0)))
    for frequency in (37.0, 50.0):
        phases = [one['phase'] for one in variants if one['frequency'] == frequency]
        # A wave of any phase, either sign, resembles one of them.
        for phase in np.linspace(0, np.pi, 50):
            assert max(np.abs(np.cos(np.array(phases) - phase))) > 0.96
    assert {one['frequency'] for one in variants} == {37.0, 50.0}
    assert [effect.inner_unit(name, place) for name in variants[0]] == ['Hz', 'rad']


@pytest.mark.parametrize('phase', [0.0, 0.7, np.pi / 2])
def test_force_along_a_motion_is_that_of_the_corrected_machine(phase):
    effect = UnmeasuredPeriodicForce()
    inner = {'frequency': 37.0, 'phase': phase}
    course = course_of(TURNING)
    for place in effect.places(TURNING):
        series, direction = effect.force(course, place, inner)
        corrected = effect.applied(TURNING, place, inner, 2.5)
        expected = assemble(corrected.machine).periodic_load(TIME)
        np.testing.assert_allclose(2.5 * np.outer(series, direction), expected, atol=1e-12)
        assert effect.unit(place) == ('N' if place.axis < 4 else 'N m')
        assert effect.hidden_in(corrected, place)
        assert not effect.hidden_in(TURNING, place)
        written = read_machine(machine_text(corrected.machine, {}, ''), 'written')
        np.testing.assert_allclose(assemble(written).periodic_load(TIME), expected, atol=1e-12)


def test_amplitudes_and_frequency_are_to_be_estimated():
    effect = UnmeasuredPeriodicForce()
    (place,) = effect.places(STRAIGHT)
    inner = {'frequency': 37.0, 'phase': 0.0}
    names = []
    for size in (1.0, 0.0):
        model = assemble(effect.applied(STRAIGHT, place, inner, size).machine)
        names.append([model.parameters[i].name.split('.')[1] for i in model.estimated])
    assert names == [['cosine', 'sine', 'frequency'], ['cosine', 'sine']]


def test_drifting_stiffness_is_an_element_at_a_joint():
    effect = DriftingStiffness()
    (place,) = [one for one in effect.places(STRAIGHT) if one.axis == 1]
    (inner,) = effect.variants(STRAIGHT, place, scale_of(STRAIGHT))
    corrected = effect.applied(STRAIGHT, place, inner, -2e5)
    model = assemble(corrected.machine)
    assert [model.parameters[i].name for i in model.estimated] == [
        f'{effect.part_name(place)}.{effect.size_name}'
    ]
    motion = np.full((len(TIME), 1), 1e-6)
    still = np.zeros_like(motion)
    force = model.joint_force(motion, still, time=TIME)
    expected = (4e5 - 2e5 * TIME) * 1e-6
    np.testing.assert_allclose(force[:, 0], expected, rtol=1e-12)


def test_drift_of_a_sensor_is_in_the_layout():
    effect = SensorDrift()
    place = effect.places(STRAIGHT)[0]
    signals = Signals(TIME, {}, {}, {}, {}, {})
    np.testing.assert_array_equal(effect.deviation(signals, place)[place.part], TIME)
    before = STRAIGHT.sensor(place.part)
    after = effect.applied(STRAIGHT, place, {}, 3e-6).sensor(place.part)
    quantity = np.zeros_like(TIME)
    recorded = after.to_recorded(quantity, TIME)
    np.testing.assert_allclose(before.to_si(recorded, TIME), 3e-6 * TIME, rtol=1e-12)
