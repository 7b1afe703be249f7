# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is hidden in simulated data is found, named and measured; where nothing is, nothing is."""

from dataclasses import replace

from identnl_ros.core.discrepancy.circumstances import Course, Scale
from identnl_ros.core.discrepancy.comparison import Comparison
from identnl_ros.core.discrepancy.consistent_motion import consistent_motion
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.diagnosis import diagnose, Verdict
from identnl_ros.core.discrepancy.effect import AddedPart, ChangedMachine, Hypothesis, Place
from identnl_ros.core.discrepancy.features import Features
from identnl_ros.core.discrepancy.held_out import held_out_error
from identnl_ros.core.discrepancy.hidden_effect import choose_place, HiddenEffect, relative_size
from identnl_ros.core.discrepancy.library import EFFECTS, hypotheses_about
from identnl_ros.core.discrepancy.nominal_motion import corrected, NominalMotion
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.joints import SpringDamper
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.mechanics.slideway import Slideway
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.reference_machines import complete_layout

RATE = 4000.0
COUNT = 3072
BY_NAME = {effect.name: effect for effect in EFFECTS}


def small_machine():
    """One body on a spring per direction, stiffness and damping along x unknown."""
    stiffness = [Coefficient(value) for value in (4e6, 5e6, 6e6)]
    damping = [Coefficient(value) for value in (800.0, 900.0, 1000.0)]
    stiffness[0], damping[0] = Coefficient(4e6, True), Coefficient(800.0, True)
    rail = SpringDamper(
        'rail', 'table', 'ground', np.zeros(3), stiffness=tuple(stiffness), damping=tuple(damping)
    )
    table = Body(
        'table', Coefficient(20.0), np.zeros(3), None,
        ('translation_1', 'translation_2', 'translation_3'),
    )  # fmt: skip
    shaker = ExcitationPoint(
        'shaker', 'table', np.zeros(3), np.array([1.0, 0.6, 0.4]), amplitude=30.0, band=(20, 400)
    )
    return Machine('small', (table,), (rail,), (shaker,))


@pytest.fixture(scope='module')
def description():
    machine = small_machine()
    return Description(machine, complete_layout(machine, 10e-9, 0.01, 2e-6))


def signals():
    return (multisine(30.0, (20.0, 400.0), 0.5, np.random.default_rng(3)),)


def recorded(description, truth, seed, count=COUNT, skip=1000):
    """Run the stand as it is and read it as it is described."""
    stand = SimulatedStand(
        assemble(truth.machine), truth.layout, signals(), RATE, seed, 1,
        declared_layout=description.layout,
    )  # fmt: skip
    samples = stand.read(skip + count).samples[skip:]
    return MeasuredRecord(description.layout, RATE, samples, first_index=skip)


def hidden(description, name, place, share):
    (hypothesis,) = choose_place(BY_NAME[name], description, place)
    hypothesis, whole = relative_size(description, hypothesis, signals(), RATE)
    return HiddenEffect(hypothesis, share * whole)


def diagnosed(description, truth, seed):
    model = assemble(description.machine)
    start = model.with_unknowns(1.2 * model.values[list(model.estimated)])
    return diagnose(description, start, recorded(description, truth, seed))


@pytest.mark.parametrize(
    ('name', 'place'),
    [
        ('coulomb_friction', 'rail.axis_1'),
        ('quadratic_damping', 'rail.axis_2'),
        ('cubic_stiffness', 'rail.axis_1'),
        ('linear_stiffness', 'rail.axis_3'),
        ('backlash', 'rail.axis_2'),
        ('added_mass', 'table'),
        ('hysteresis', 'rail.axis_1'),
        ('drifting_stiffness', 'rail.axis_2'),
        ('hidden_oscillator', 'table.axis_1'),
        ('periodic_force', 'table.axis_2'),
    ],
)
def test_hidden_effect_is_named_and_measured(description, name, place):
    one = hidden(description, name, place, 0.05)
    truth = one.truth(description)
    found = diagnosed(description, truth, 11)
    assert found.verdict is Verdict.EXPLAINED
    assert [each.hypothesis.key for each in found.named] == [(name, place)]
    assert found.named[0].size == pytest.approx(one.size, rel=0.05)
    fresh = recorded(description, truth, 12, 2048)
    before = held_out_error(description, found.before.model, fresh)
    corrected = found.after.description
    after = held_out_error(corrected, found.after.model, reread(fresh, corrected.layout))
    assert after.response < 1.2 * after.noise_floor < before.response


@pytest.mark.parametrize(
    ('name', 'place', 'size'),
    [
        ('sensor_gain', 'table_displacement_0x', 0.02),
        ('sensor_delay', 'table_acceleration_1y', 50e-6),
        ('sensor_offset', 'table_velocity_2z', 20e-6),
        ('swapped_polarity', 'table_displacement_1x', 1.0),
        ('exchanged_channels', 'table_displacement_0x+table_displacement_0y', 1.0),
    ],
)
def test_faulty_sensor_is_named(description, name, place, size):
    (hypothesis,) = choose_place(BY_NAME[name], description, place)
    found = diagnosed(description, hypothesis.applied(description, size), 21)
    assert found.verdict is Verdict.EXPLAINED
    assert [each.hypothesis.key for each in found.named] == [(name, place)]
    assert found.named[0].size == pytest.approx(size, rel=0.05)


class HoseStiffness(AddedPart):
    """As the documentation shows how to add an effect."""

    name, title, size_name = 'hose_stiffness', 'the stiffness of the hose', 'stiffness'
    sign = 1

    def unit(self, place):
        return 'N/m'

    def places(self, description):
        return [Place('table', 3, words='the clamp of the hose')]

    def part(self, description, place, inner, coefficient, name):
        along = (Coefficient(0.0), Coefficient(0.0), coefficient)
        return SpringDamper(name, 'table', 'ground', np.zeros(3), np.eye(3), stiffness=along)


def test_effect_made_outside_the_package_is_named(description):
    (hypothesis,) = choose_place(HoseStiffness(), description, '')
    record = recorded(description, hypothesis.applied(description, 2e5), 61)
    model = assemble(description.machine)
    found = diagnose(description, model, record, effects=(HoseStiffness(), *EFFECTS))
    assert [each.hypothesis.key for each in found.named] == [('hose_stiffness', 'table.axis_3')]
    assert found.named[0].size == pytest.approx(2e5, rel=0.02)
    # Here a spring of the rail in this direction does the same.
    assert ('linear_stiffness', 'rail.axis_3') in {
        one.key for one in found.named[0].finding.rivals
    }


def test_limit_of_hysteresis_is_fitted(description):
    (place,) = choose_place(BY_NAME['hysteresis'], description, 'rail.axis_2')
    hypothesis, whole = relative_size(description, place, signals(), RATE)
    inner = {'limit': 0.6 * hypothesis.inner['limit'], 'exponent': 4.0}
    truth = replace(hypothesis, inner=inner).applied(description, 0.1 * whole)
    found = diagnosed(description, truth, 51)
    assert [each.hypothesis.key for each in found.named] == [('hysteresis', 'rail.axis_2')]
    for one in found.named[0].inner:
        assert abs(one.value - inner[one.name]) < 5 * one.deviation < 0.1 * inner[one.name]


@pytest.mark.parametrize(('name', 'size'), [('force_gain', 0.05), ('force_delay', 2e-4)])
def test_faulty_force_cell_is_named(description, name, size):
    (hypothesis,) = choose_place(BY_NAME[name], description, '')
    found = diagnosed(description, hypothesis.applied(description, size), 22)
    assert found.verdict is Verdict.EXPLAINED
    assert [each.hypothesis.key for each in found.named] == [hypothesis.key]
    assert found.named[0].size == pytest.approx(size, rel=0.02)


def test_lines_beyond_the_band_do_not_get_into_the_nominal_motion():
    time = np.arange(4000) / RATE
    still = NominalMotion(*(np.zeros((4000, 1)) for _ in range(3)))
    high, low = (np.sin(2 * np.pi * one * time)[:, np.newaxis] for one in (1500.0, 100.0))
    noise = np.random.default_rng(2).standard_normal((4000, 1))
    deviation = noise + 5 * high + 5 * low
    found = corrected(still, deviation, np.eye(1), RATE, 400.0).displacement
    error = found[200:-200] - 5 * low[200:-200]
    assert np.sqrt(np.mean(error**2)) < 0.3
    assert abs(np.mean(found * high)) < 1e-12


def test_two_effects_are_named(description):
    first = hidden(description, 'coulomb_friction', 'rail.axis_2', 0.05)
    second = hidden(description, 'cubic_stiffness', 'rail.axis_1', 0.05)
    found = diagnosed(description, second.truth(first.truth(description)), 31)
    assert found.verdict is Verdict.EXPLAINED
    assert {each.hypothesis.key for each in found.named} == {
        ('coulomb_friction', 'rail.axis_2'),
        ('cubic_stiffness', 'rail.axis_1'),
    }


def test_nothing_is_found_where_nothing_is_hidden(description):
    # Six records at a false-alarm rate of 1 %: two alarms have a probability of 0.15 %.
    verdicts = [diagnosed(description, description, seed).verdict for seed in range(100, 106)]
    assert sum(one is not Verdict.COMPLETE for one in verdicts) <= 1


def test_what_no_effect_explains_is_left_unnamed(description):
    # A force that nobody measures, at a frequency of its own.
    machine = description.machine
    ghost = ExcitationPoint('ghost', 'table', np.zeros(3), np.array([0.2, 1.0, 0.5]))
    stand = SimulatedStand(
        assemble(replace(machine, excitations=(*machine.excitations, ghost))),
        description.layout,
        (*signals(), multisine(1.5, (90.0, 110.0), 0.37, np.random.default_rng(5))),
        RATE, 41, 1,
    )  # fmt: skip
    samples = stand.read(1000 + COUNT).samples[1000:]
    record = MeasuredRecord(description.layout, RATE, samples)
    found = diagnose(description, assemble(machine), record)
    assert found.verdict is Verdict.UNEXPLAINED
    assert not found.named


def test_features_are_what_an_effect_adds_to_the_equations_of_motion(description):
    generator = np.random.default_rng(0)
    motion = [generator.standard_normal((50, 3)) * size for size in (1e-6, 1e-4, 1e-1)]
    scale = Scale(
        {('rail', axis): 1e-6 for axis in range(1, 7)},
        {('rail', axis): 1e-4 for axis in range(1, 7)},
    )
    chosen = [
        one
        for one in hypotheses_about(description, scale, {})
        if isinstance(one.effect, AddedPart | ChangedMachine)
    ]
    assert len(chosen) > 20
    model = assemble(description.machine)
    time = np.arange(50) / RATE
    course = Course(description, model, time, *motion, np.zeros((50, 1)))
    forces = Features(course, chosen).forces(range(len(chosen)), 0, 50)
    for i, one in enumerate(chosen):
        if one.effect.name == 'hysteresis':
            continue  # depends on the path, which noise does not have
        with_effect = assemble(one.applied(description, 1e-3).machine)
        without = assemble(one.applied(description, 0.0).machine)
        sides = [
            each.mass_diagonal() * motion[2]
            + each.joint_force(motion[0], motion[1], time=time)
            - each.constant_load()
            for each in (with_effect, without)
        ]
        expected = (sides[1] - sides[0]) / 1e-3
        rounding = 1e-14 * np.abs(sides[0]).max() / 1e-3
        tolerance = 1e-6 * np.abs(expected).max() + rounding
        np.testing.assert_allclose(forces[:, :, i], expected, rtol=0, atol=tolerance)


def test_sensors_that_contradict_the_others_are_left_out():
    generator = np.random.default_rng(1)
    rows = generator.standard_normal((9, 6))
    motion = generator.standard_normal((500, 6)) * 100
    noise = np.full(9, 0.5)
    readings = motion @ rows.T + noise * generator.standard_normal((500, 9))
    readings[:, 4] *= -1
    matrix, covariance = consistent_motion(readings, rows, noise)
    assert np.all(matrix[:, 4] == 0)
    error = readings @ matrix.T - motion
    np.testing.assert_allclose(error.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.2)


def test_noise_is_told_from_readings_as_they_came(description):
    # Taking out a delay of part of a sample smooths the noise; its size is that before.
    late = description
    for sensor in description.layout.sensors:
        if sensor.kind is SensorKind.ACCELERATION:
            late = late.with_sensor(replace(sensor, delay=0.43 / RATE))
    samples = recorded(late, late, 71)
    comparison = Comparison(late, assemble(late.machine), samples)
    for sensor, noise in zip(comparison.sensors, comparison.deviation, strict=True):
        assert noise == pytest.approx(sensor.noise, rel=0.1)


def test_effects_that_change_a_slideway_need_no_values_in_the_file():
    way = Slideway(
        'way', 'table', 'ground', np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]),
        0.4, 0.06, Coefficient(3e12, True), Coefficient(1e8), Coefficient(1e4), Coefficient(1e3),
        preload=Coefficient(1e-6),
    )  # fmt: skip
    table = Body('table', Coefficient(20.0), np.zeros(3), None, ('translation_1',))
    machine = Machine('block', (table,), (way,))
    known = Description(machine, complete_layout(machine))
    blank = known.with_joint(replace(way, normal_stiffness=Coefficient(np.nan, True)))
    fitted = assemble(known.machine)
    time = np.arange(200) / RATE
    motion = 1e-7 * np.sin(300 * time)[:, np.newaxis]
    forces = []
    for description in (known, blank):
        course = Course(
            description, fitted, time, motion, 0 * motion, 0 * motion, np.zeros((200, 0))
        )
        chosen = [
            Hypothesis(BY_NAME[name], place)
            for name in ('wrong_exponent', 'wrong_preload', 'contact_opening')
            for place in BY_NAME[name].places(description)
        ]
        assert len(chosen) == 3
        forces.append(Features(course, chosen).forces(range(3), 0, 200))
    assert np.abs(forces[0]).max() > 0
    np.testing.assert_array_equal(forces[1], forces[0])
