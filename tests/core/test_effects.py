# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Effects of the library: what they say they add is what a stand that has them does."""

from dataclasses import replace

from identnl_ros.core.discrepancy.circumstances import Course, Scale
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Hypothesis, Place
from identnl_ros.core.discrepancy.features import Features
from identnl_ros.core.discrepancy.library import EFFECTS
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_force import measured_forces
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.joints import Slideway, SpringDamper
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.simulation import Simulation, steps_per_sample
from identnl_ros.storage.layout_file import read_layout
from identnl_ros.storage.layout_writing import layout_text
from identnl_ros.storage.machine_file import read_machine
from identnl_ros.storage.machine_writing import machine_text
import numpy as np
import pytest
from scipy.signal import lsim

from tests.reference_machines import complete_layout, knee_and_column

RATE = 4000.0
COUNT = 1200
MASS, DAMPING, STIFFNESS = 20.0, 800.0, 4e6
BY_NAME = {effect.name: effect for effect in EFFECTS}
FORCE = multisine(30.0, (20.0, 200.0), 0.5, np.random.default_rng(3))


def table_machine():
    """One body on springs, pushed along x."""
    rail = SpringDamper(
        'rail', 'table', 'ground', np.zeros(3),
        stiffness=(Coefficient(STIFFNESS, True), Coefficient(5e6), Coefficient(6e6)),
        damping=(Coefficient(DAMPING, True), Coefficient(900.0), Coefficient(1000.0)),
    )  # fmt: skip
    table = Body(
        'table', Coefficient(MASS), np.zeros(3), None,
        ('translation_1', 'translation_2', 'translation_3'),
    )  # fmt: skip
    shaker = ExcitationPoint(
        'shaker', 'table', np.zeros(3), np.array([1.0, 0.0, 0.0]), band=(20.0, 200.0)
    )
    return Machine('table', (table,), (rail,), (shaker,))


@pytest.fixture
def description():
    """Sensors of all kinds on the table; two cells of different noise at the shaker."""
    machine = table_machine()
    sensors = [
        one
        for one in complete_layout(machine, 1e-9, 1e-2, 1e-6).sensors
        if one.kind is not SensorKind.FORCE
    ]
    cells = [
        Sensor(name, SensorKind.FORCE, excitation='shaker', noise=noise)
        for name, noise in (('cell_1', 0.1), ('cell_2', 0.2))
    ]
    return Description(machine, Layout((*cells, *sensors)))


def course_of(description, acceleration=None, force=None):
    model = assemble(description.machine)
    time = np.arange(COUNT) / RATE
    nothing = np.zeros((COUNT, len(model.coordinates)))
    return Course(
        description, model, time, nothing, nothing,
        nothing if acceleration is None else acceleration,
        np.zeros((COUNT, 1)) if force is None else force,
    )  # fmt: skip


def simulated(machine, signals=(FORCE,)):
    model = assemble(machine)
    rest = static_equilibrium(model)
    steps = steps_per_sample(model, rest[np.newaxis], 1 / RATE)
    run = Simulation(model, signals, 1 / RATE, rest, np.zeros_like(rest), steps)
    return tuple(one[0] for one in run.advance(COUNT))


def chain_response(mass, frequency, damping_ratio, finer=16):
    """Motion of the table along x with an oscillator on it, without this package."""
    rate = 2 * np.pi * frequency
    spring, damper = mass * rate**2, 2 * damping_ratio * mass * rate
    masses = np.diag([1 / MASS, 1 / mass])
    springs = masses @ [[STIFFNESS + spring, -spring], [-spring, spring]]
    dampers = masses @ [[DAMPING + damper, -damper], [-damper, damper]]
    matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-springs, -dampers]])
    time = np.arange(COUNT * finer) / (RATE * finer)
    push = np.array([0.0, 0.0, 1 / MASS, 0.0])[:, np.newaxis]
    force = FORCE.on_grid(0.0, 1 / (RATE * finer), time.size)
    _, motion, _ = lsim((matrix, push, np.eye(4)[:2], np.zeros((2, 1))), force, time)
    return motion[::finer]


@pytest.mark.parametrize(('frequency', 'damping_ratio'), [(40.0, 0.1), (90.0, 0.02), (250.0, 0.1)])
def test_reaction_of_an_oscillator_is_what_it_changes(description, frequency, damping_ratio):
    small = 1e-4
    course = course_of(description, simulated(description.machine)[2])
    series, direction = BY_NAME['hidden_oscillator'].force(
        course, Place('table', 1), {'frequency': frequency, 'damping_ratio': damping_ratio}
    )
    np.testing.assert_array_equal(direction, [1.0, 0.0, 0.0])
    _, response, _ = lsim(([1.0], [MASS, DAMPING, STIFFNESS]), series, course.time)
    without = chain_response(1e-12, frequency, damping_ratio)[:, 0]
    change = (chain_response(small, frequency, damping_ratio)[:, 0] - without) / small
    np.testing.assert_allclose(response, change, rtol=0, atol=0.02 * np.abs(change).max())


def test_machine_with_an_oscillator_moves_as_a_chain_of_two_masses(description):
    one = Hypothesis(
        BY_NAME['hidden_oscillator'], Place('table', 1), {'frequency': 90.0, 'damping_ratio': 0.03}
    )
    displacement, _, _ = simulated(one.applied(description, 1.5).machine)
    expected = chain_response(1.5, 90.0, 0.03)
    np.testing.assert_allclose(
        displacement[:, [0, 3]], expected, rtol=0, atol=1e-3 * np.abs(expected).max()
    )


@pytest.mark.parametrize('axis', [1, 2, 3])
def test_frequency_is_read_off_mass_and_stiffness(description, axis):
    effect, place = BY_NAME['hidden_oscillator'], Place('table', axis)
    tried = {'frequency': 90.0, 'damping_ratio': 0.03}
    model = assemble(effect.applied(description, place, tried, 1.5).machine)
    values = {one.name: one.value for one in model.parameters}
    assert effect.fitted_inner(place, tried, values) == pytest.approx(tried)
    halved = {name: value / (1 + name.endswith('.mass')) for name, value in values.items()}
    found = effect.fitted_inner(place, tried, halved)
    assert found['frequency'] == pytest.approx(90 * np.sqrt(2))
    assert found['damping_ratio'] == pytest.approx(0.03 * np.sqrt(2))


def test_weight_of_an_oscillator_is_in_its_reaction(description):
    gravity = np.array([0.0, 0.0, -9.81])
    description = replace(description, machine=replace(description.machine, gravity=gravity))
    one = Hypothesis(
        BY_NAME['hidden_oscillator'], Place('table', 3), {'frequency': 90.0, 'damping_ratio': 0.03}
    )
    series, direction = one.effect.force(course_of(description), one.place, one.inner)
    sag = [
        static_equilibrium(assemble(each.machine))[:3]
        for each in (one.applied(description, 0.5), description)
    ]
    expected = 0.5 * series[-1] * direction / [STIFFNESS, 5e6, 6e6]
    np.testing.assert_allclose(sag[0] - sag[1], expected, rtol=1e-9, atol=1e-18)


def test_oscillators_are_looked_for_where_bodies_move(description):
    effect = BY_NAME['hidden_oscillator']
    (table,) = description.machine.bodies
    fixed = replace(table, degrees_of_freedom=('translation_2',))
    fixed = replace(description, machine=replace(description.machine, bodies=(fixed,)))
    assert [place.label for place in effect.places(fixed)] == ['table.axis_2']
    (place,) = effect.places(fixed)
    variants = effect.variants(fixed, place, Scale({}, {}))
    frequencies = {one['frequency'] for one in variants}
    assert min(frequencies) < 20 < 200 < max(frequencies)
    finer = sorted(
        {one['frequency'] for one in effect.finer_variants(fixed, place, Scale({}, {}))}
    )
    assert (finer[0], finer[-1]) == pytest.approx((min(frequencies), max(frequencies)))
    assert np.diff(np.log(finer)).max() < 0.04
    after = effect.applied(fixed, place, variants[0], 0.1)
    assert [one.label for one in effect.places(after)] == ['table.axis_2']
    assert effect.hidden_in(after, place)
    assert not effect.hidden_in(fixed, place)


def record_of(description, actual):
    """Record the force with cells as another description has them."""
    time = np.arange(COUNT) / RATE
    samples = np.zeros((COUNT, len(description.layout.sensors)))
    pairs = zip(description.layout.sensors, actual.layout.sensors, strict=True)
    for i, (told, true) in enumerate(pairs):
        if told.kind is SensorKind.FORCE:
            quantity = FORCE.on_grid(time[0] - true.delay, 1 / RATE, COUNT)
            samples[:, i] = told.to_si(true.to_recorded(quantity, time), time)
    return MeasuredRecord(description.layout, RATE, samples)


@pytest.mark.parametrize('name', ['force_gain', 'force_delay'])
@pytest.mark.parametrize('cell', ['cell_1', 'cell_2'])
def test_force_fault_is_the_true_force_less_the_measured(description, name, cell):
    size = 1e-4 if name == 'force_gain' else 1e-6
    (place,) = [one for one in BY_NAME[name].places(description) if one.part == cell]
    fault = Hypothesis(BY_NAME[name], place)
    record = record_of(description, fault.applied(description, size))
    model = assemble(description.machine)
    inside = slice(20, -20)
    true, measured = (
        signal.on_grid(0.0, 1 / RATE, COUNT) for signal in (FORCE, *measured_forces(model, record))
    )
    course = course_of(description, force=measured[:, np.newaxis])
    series, direction = fault.effect.force(course, place, {})
    np.testing.assert_array_equal(direction, model.excitation_directions[0])
    lacking = (true - measured)[inside] / size
    atol = 2e-3 * np.abs(lacking).max()
    np.testing.assert_allclose(series[inside], lacking, rtol=0, atol=atol)


@pytest.mark.parametrize(
    ('name', 'size'), [('force_gain', 0.3), ('force_gain', 2.0), ('force_delay', 2.1e-4)]
)
def test_record_read_with_the_corrected_layout_has_the_true_force(description, name, size):
    first, _, *motion = description.layout.sensors
    lone = replace(description, layout=Layout((first, *motion)))
    fault = Hypothesis(BY_NAME[name], Place(first.name))
    assert fault.effect.admits(size, 0.0)
    actual = fault.applied(lone, size)
    record = reread(record_of(lone, actual), actual.layout)
    (signal,) = measured_forces(assemble(lone.machine), record)
    true, found = (one.on_grid(0.0, 1 / RATE, COUNT)[20:-20] for one in (FORCE, signal))
    np.testing.assert_allclose(found, true, rtol=0, atol=1e-6 * np.abs(true).max())


def test_share_of_the_reading_that_is_too_much_is_found_exactly(description):
    first, _, *motion = description.layout.sensors
    lone = replace(description, layout=Layout((first, *motion)))
    fault = Hypothesis(BY_NAME['force_gain'], Place(first.name))
    record = record_of(lone, fault.applied(lone, -0.7))
    measured = record.samples[:, :1]
    series, _ = fault.effect.force(course_of(lone, force=measured), fault.place, {})
    true = FORCE.on_grid(0.0, 1 / RATE, COUNT)
    np.testing.assert_allclose(measured[:, 0] - 0.7 * series, true, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize('coupled', [False, True])
def test_contact_without_preload_bears_pressure_only(coupled):
    block = Body('block', Coefficient(50.0), np.zeros(3), None, ('translation_1',))
    way = Slideway(
        'way', 'block', 'ground', np.zeros(3), np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 0.0, 1.0]), 0.4, 0.06, Coefficient(3e15, True), Coefficient(1e8),
        Coefficient(0.0), Coefficient(0.0), preload=Coefficient(1e-6), coupled=coupled,
    )  # fmt: skip
    machine = Machine('block', (block,), (way,))
    description = Description(machine, complete_layout(machine))
    effect = BY_NAME['contact_opening']
    (place,) = effect.places(description)
    assert not effect.hidden_in(description, place)
    opened = effect.applied(description, place, {}, 1.0)
    assert not effect.places(opened)
    motion = np.linspace(-2e-6, 2e-6, 9)[:, np.newaxis]
    still = np.zeros_like(motion)
    before, after = (
        assemble(one.machine).joint_force(motion, still) for one in (description, opened)
    )
    np.testing.assert_allclose(after, 3e15 * np.maximum(motion, 0) ** 2, rtol=1e-9)
    one = Hypothesis(effect, place)
    course = Course(
        description, assemble(machine), np.zeros(9), motion, still, still, np.zeros((9, 0))
    )
    added = Features(course, [one]).forces([0], 0, 9)
    np.testing.assert_allclose(added[:, :, 0], before - after, rtol=1e-9)


def test_hysteresis_is_tried_with_gradual_and_with_abrupt_yielding(description):
    scale = Scale(
        {('rail', axis): 1e-6 for axis in range(1, 7)},
        {('rail', axis): 1e-4 for axis in range(1, 7)},
    )
    effect, place = BY_NAME['hysteresis'], Place('rail', 1)
    assert len(effect.variants(description, place, scale)) <= 6
    variants = effect.finer_variants(description, place, scale)[::6]
    model = assemble(description.machine)
    time = np.linspace(0, 3, 400)[:, np.newaxis]
    forward = np.array([1e-6, 0, 0])
    motion = np.sin(2 * np.pi * time) * forward
    velocity = 2 * np.pi * np.cos(2 * np.pi * time) * forward
    still = np.zeros_like(motion)
    chosen = [Hypothesis(effect, place, one) for one in variants]
    course = Course(
        description, model, time[:, 0], motion, velocity, still, np.zeros((len(time), 1))
    )
    forces = Features(course, chosen).forces(range(len(chosen)), 0, len(time))
    bends = {}
    for i, one in enumerate(chosen):
        added = assemble(one.applied(description, 1.0).machine)
        expected = model.joint_force(motion, velocity) - added.joint_force(motion, velocity)
        tolerance = 1e-6 * np.abs(expected).max()
        np.testing.assert_allclose(forces[:, :, i], expected, rtol=0, atol=tolerance)
        # Pushed from rest up to 0.7 of its limit.
        limit = one.inner['limit']
        path = np.linspace(0, 0.7, 50)[:, np.newaxis] * limit * np.array([1.0, 0, 0])
        rate = np.full_like(path, 1e-4) * [1.0, 0, 0]
        last = added.joint_force(path, rate) - model.joint_force(path, rate)
        bends.setdefault(one.inner['exponent'], []).append(last[-1, 0] / (0.7 * limit))
    # Jenkins' element is still a spring there, Bouc and Wen's gives way: tanh.
    np.testing.assert_allclose(bends[2.0], np.tanh(0.7) / 0.7, rtol=1e-3)
    assert min(bends[10.0]) > 0.99


@pytest.mark.parametrize(
    'name', ['hidden_oscillator', 'contact_opening', 'force_gain', 'force_delay', 'hysteresis']
)
def test_corrected_files_come_back(name):
    machine = knee_and_column()
    description = Description(machine, complete_layout(machine, 1e-9, 1e-2, 1e-6))
    effect = BY_NAME[name]
    place = effect.places(description)[-1]
    joints = [(joint.name, axis) for joint in machine.joints for axis in range(1, 7)]
    scale = Scale(dict.fromkeys(joints, 1e-6), dict.fromkeys(joints, 1e-4))
    inner = effect.variants(description, place, scale)[0]
    for one in inner:
        assert effect.inner_unit(one, place)
    size = 1e-4 if name.startswith('force') else 1.0
    applied = effect.applied(description, place, inner, size)
    machine = read_machine(machine_text(applied.machine, {}, 'written'), 'written')
    model, again = assemble(applied.machine), assemble(machine)
    assert again.parameters == model.parameters
    assert again.terms == model.terms
    np.testing.assert_allclose(again.lines, model.lines, atol=1e-12)
    np.testing.assert_allclose(again.mass_diagonal(), model.mass_diagonal(), rtol=1e-14)
    assert np.linalg.norm(static_equilibrium(again)) == 0.0
    values = {one.name: one.value for one in again.parameters}
    assert effect.fitted_inner(place, inner, values) == pytest.approx(inner)
    layout = read_layout(layout_text(applied.layout, 'written'), 'written')
    for one, other in zip(layout.sensors, applied.layout.sensors, strict=True):
        assert (one.name, one.gain, one.delay) == (other.name, other.gain, other.delay)
