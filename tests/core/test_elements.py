# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Friction, quadratic damping, backlash, gaps, hysteresis: simulation against independent ones."""

from dataclasses import replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.elements import Element
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.hidden_states import hidden_motion
from identnl_ros.core.mechanics.laws import Law, LawKind
from identnl_ros.core.simulation.excitation import multisine, sine
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.simulation.simulation import Simulation, steps_per_sample
import numpy as np
import pytest

from tests.core.element_cases import (
    CASES,
    DAMPING,
    element,
    independent,
    MASS,
    simulated,
    STIFFNESS,
)
from tests.core.machines import known, ORIGIN, oscillator, skew_machine, unknown

SIGNAL = multisine(5.0, (5.0, 60.0), 0.5, np.random.default_rng(3))
LAWS = [
    Law(LawKind.COULOMB, transition=0.4),
    Law(LawKind.STRIBECK, transition=0.3, fading=1.2),
    Law(LawKind.QUADRATIC_DAMPING),
    Law(LawKind.BACKLASH, gap=0.7),
    Law(LawKind.BILINEAR, gap=-0.5, rest_force=0.5),
]


@pytest.mark.parametrize('law', LAWS, ids=lambda law: law.kind.name)
def test_slopes_are_the_derivatives_of_the_force(law):
    deformation = np.array([-2.3, -1.1, -0.4, 0.1, 0.9, 3.0])
    rate, step = deformation[::-1], 1e-4
    for found, (place, speed) in (
        (law.stiffness(deformation), (step, 0.0)),
        (law.rate_slope(rate), (0.0, step)),
    ):
        high, low = (law.force(deformation + s * place, rate + s * speed) for s in (1, -1))
        np.testing.assert_allclose(found, (high - low) / (2 * step), atol=1e-7)


@pytest.mark.parametrize('law', LAWS, ids=lambda law: law.kind.name)
def test_nothing_acts_at_rest(law):
    still = np.zeros(1)
    assert law.force(still, still) == 0.0


@pytest.mark.parametrize('name', CASES)
def test_simulation_follows_an_independent_integrator(name):
    case = CASES[name]
    expected = independent(case, SIGNAL, 200)
    *found, run = simulated(case.model(), SIGNAL, 200)
    for part, column in zip(found, expected.T, strict=False):
        np.testing.assert_allclose(part, column, atol=5e-6 * np.abs(column).max())
    if name == 'hysteresis':
        assert np.abs(expected[:, 2]).max() > 0.9 * 5e-6  # the loop comes near its limit
        assert abs(run.hidden[0]) <= 5e-6


@pytest.mark.parametrize(
    ('name', 'coefficient', 'steps'), [('quadratic_damping', 2e7, 30), ('hysteresis', 4e7, 30)]
)
def test_steep_elements_take_no_more_steps_than_they_need(name, coefficient, steps):
    # Of the hysteretic one the state stays far below its limit.
    case = replace(CASES[name], coefficient=coefficient)
    displacement, velocity, run = simulated(case.model(), SIGNAL, 200)
    assert run.steps < steps
    expected = independent(case, SIGNAL, 200)
    for found, column in zip((displacement, velocity), expected.T, strict=False):
        np.testing.assert_allclose(found, column, atol=5e-6 * np.abs(column).max())


@pytest.mark.parametrize('name', CASES)
def test_every_element_matters_in_these_runs(name):
    with_it, without = (
        simulated(model, SIGNAL, 200)[0] for model in (CASES[name].model(), assemble(oscillator()))
    )
    assert np.abs(with_it - without).max() > 0.05 * np.abs(without).max()


@pytest.mark.parametrize('name', CASES)
def test_motion_with_sensitivities_is_the_same(name):
    model = CASES[name].model()
    found = VariedSimulation(model, (SIGNAL,), 1e-3, np.zeros(1), np.zeros(1)).advance(200)
    expected = simulated(model, SIGNAL, 200)[0]
    np.testing.assert_allclose(found.motion[:, 0, 0], expected, atol=4e-5 * np.abs(expected).max())


@pytest.mark.parametrize('name', CASES)
def test_pieces_agree_with_one_go(name):
    model = CASES[name].model()
    whole = simulated(model, SIGNAL, 120)[2].steps
    runs = [Simulation(model, (SIGNAL,), 1e-3, np.zeros(1), np.zeros(1), whole) for _ in range(2)]
    expected = runs[0].advance(120, (0.0, 0.5))
    pieces = [runs[1].advance(count, (0.0, 0.5)) for count in (1, 50, 69)]
    for i, part in enumerate(expected):
        joined = np.concatenate([piece[i] for piece in pieces], axis=1)
        np.testing.assert_allclose(joined, part, atol=1e-10 * np.abs(part).max())
    np.testing.assert_allclose(runs[1].hidden, runs[0].hidden, rtol=1e-9)


@pytest.mark.parametrize('name', CASES)
def test_acceleration_given_out_satisfies_the_equations_of_motion(name):
    # The hysteretic state is found anew from the motion here.
    model = CASES[name].model()
    displacement, velocity, _ = simulated(model, SIGNAL, 1000, 2e-4)
    run = Simulation(model, (SIGNAL,), 2e-4, np.zeros(1), np.zeros(1), 40)
    acceleration = run.advance(1000)[2][0]
    force = SIGNAL.on_grid(0.0, 2e-4, 1000)[:, np.newaxis]
    left = MASS * acceleration + model.joint_force(displacement[:, None], velocity[:, None])
    np.testing.assert_allclose(left, force, atol=2e-3 * np.abs(force).max())


def work_per_cycle(name, coefficient, amplitude=2e-4, frequency=10.0, **numbers):
    """Return the energy that one element takes from a sinusoidal motion in one cycle."""
    case = element(name, known(coefficient), **numbers)
    model = assemble(oscillator(stiffness=known(0.0), damping=known(0.0), more_joints=(case,)))
    phase = np.linspace(0, 2 * np.pi, 20001)
    omega = 2 * np.pi * frequency
    displacement = amplitude * np.sin(phase)
    velocity = omega * amplitude * np.cos(phase)
    force = model.joint_force(displacement[:, None], velocity[:, None])[:, 0]
    return np.trapezoid(force, displacement), amplitude, omega


def test_coulomb_friction_takes_four_times_force_times_amplitude_per_cycle():
    work, amplitude, _ = work_per_cycle('coulomb_friction', 40.0, transition_velocity=1e-5)
    assert work == pytest.approx(4 * 40.0 * amplitude, rel=1e-3)


def test_quadratic_damping_takes_the_energy_of_its_closed_form_per_cycle():
    work, amplitude, omega = work_per_cycle('quadratic_damping', 2e4)
    assert work == pytest.approx(8 / 3 * 2e4 * omega**2 * amplitude**3, rel=1e-6)


def test_free_vibration_under_coulomb_friction_loses_the_same_height_every_half_cycle():
    # 2 F / k per half cycle.
    friction = element('coulomb_friction', known(1.0), transition_velocity=1e-6)
    model = assemble(oscillator(damping=known(0.0), more_joints=(friction,)))
    displacement, _, _ = simulated(model, sine(0.0, 1.0), 640, 2.5e-4, (4e-5, 0.0))
    omega = np.sqrt(STIFFNESS / MASS)
    for half in range(1, 6):
        expected = (-1) ** half * (4e-5 - half * 2 * 1.0 / STIFFNESS)
        found = np.interp(half * np.pi / omega, np.arange(640) * 2.5e-4, displacement)
        assert found == pytest.approx(expected, abs=2e-7)


def test_backlash_leaves_a_spring_that_begins_behind_the_gap():
    gap = 4e-6
    play = element('backlash', known(STIFFNESS), gap=gap)
    model = assemble(oscillator(damping=known(0.0), more_joints=(play,)))
    deformation = np.linspace(-2e-5, 2e-5, 81)[:, None]
    found = model.joint_force(deformation, 0 * deformation)
    beyond = np.sign(deformation) * np.maximum(np.abs(deformation) - gap, 0.0)
    np.testing.assert_allclose(found, STIFFNESS * beyond, atol=1e-12)


@pytest.mark.parametrize(('exponent', 'close'), [(1.0, 0.9), (2.0, 0.99), (40.0, 0.999)])
def test_hysteretic_state_stays_within_its_limit_and_reaches_it(exponent, close):
    one = element('hysteresis', known(1e6), limit=3e-6, exponent=exponent)
    model = assemble(oscillator(more_joints=(one,)))
    phase = np.linspace(0, 8 * np.pi, 801)
    states = hidden_motion(model, 1e-5 * np.sin(phase)[:, None], 1e-3 * np.cos(phase)[:, None])
    assert close * 3e-6 < np.abs(states).max() <= 3e-6 * (1 + 1e-6)
    # The second and the third cycle are the same loop.
    np.testing.assert_allclose(states[200:400], states[400:600], atol=3e-6 * 2e-3)


def test_hysteretic_state_of_a_large_exponent_is_that_of_a_spring_behind_dry_friction():
    one = element('hysteresis', known(1e6), limit=3e-6, exponent=200.0)
    model = assemble(oscillator(more_joints=(one,)))
    phase = np.linspace(0, 5 * np.pi, 2001)
    path = 1e-5 * np.sin(phase)
    states = hidden_motion(model, path[:, None], 1e-3 * np.cos(phase)[:, None])[:, 0]
    expected = np.zeros_like(path)
    for i, change in enumerate(np.diff(path)):
        expected[i + 1] = np.clip(expected[i] + change, -3e-6, 3e-6)
    np.testing.assert_allclose(states, expected, atol=3e-6 * 0.02)


def test_hysteretic_state_found_from_samples_is_that_of_the_simulation():
    model = CASES['hysteresis'].model()
    displacement, velocity, run = simulated(model, SIGNAL, 301)
    shorter = simulated(model, SIGNAL, 300)[2].hidden
    found = hidden_motion(model, displacement[:, None], velocity[:, None])
    assert found[300, 0] == pytest.approx(shorter[0], abs=5e-6 * 2e-3)
    begun = hidden_motion(model, displacement[100:, None], velocity[100:, None], found[100])
    # Only what is guessed of the time between samples differs.
    np.testing.assert_allclose(begun[-1], found[300], atol=5e-6 * 1e-4)
    assert run.hidden.shape == (1,)


def test_equilibrium_is_found_without_friction_and_hysteresis():
    friction = element('coulomb_friction', known(50.0), 'rubbing', transition_velocity=1e-5)
    loop = element('hysteresis', known(4e7), 'loop', limit=1e-6)
    bump = element('bilinear_stiffness', known(4e5), 'bump', gap=1e-4)
    gravity = np.array([9.81, 0.0, 0.0])
    model = assemble(oscillator(gravity=gravity, more_joints=(friction, loop, bump)))
    weight = MASS * 9.81
    # 4e5 d + 4e5 (d - 1e-4) = weight
    expected = (weight + 4e5 * 1e-4) / 8e5
    np.testing.assert_allclose(static_equilibrium(model), [expected], rtol=1e-9)


def test_element_about_an_axis_acts_on_the_rotation():
    machine = skew_machine()
    rail = next(joint for joint in machine.joints if joint.name == 'rail')
    one = Element(
        'turning', rail.body, rail.other_body, rail.point, rail.axes, 'quadratic_damping', 5,
        unknown(30.0),
    )  # fmt: skip
    model = assemble(type(machine)('m', machine.bodies, (rail, one), machine.excitations))
    parameter = model.parameters[model.estimated[0]]
    assert (parameter.name, parameter.unit) == ('turning.damping', 'N*m*s^2')
    velocity = np.random.default_rng(1).standard_normal((1, 12))
    still = np.zeros_like(velocity)
    without = assemble(type(machine)('m', machine.bodies, (rail,), machine.excitations))
    found = model.joint_force(still, velocity) - without.joint_force(still, velocity)
    row = next(
        line for line, name in zip(model.lines, model.line_joints, strict=True)
        if name == 'turning'
    )  # fmt: skip
    speed = float(velocity[0] @ row)
    np.testing.assert_allclose(found[0], 30.0 * speed * abs(speed) * row, rtol=1e-9, atol=1e-9)
    # About an axis of the rail: pure rotation, the same as its sixth row of six springs.
    rows = [line for line, name in zip(model.lines, model.line_joints, strict=True)
            if name == 'rail']  # fmt: skip
    np.testing.assert_array_equal(row, rows[4])


def test_steps_see_the_steepest_slope_of_friction_at_rest():
    steep = element('coulomb_friction', known(40.0), transition_velocity=1e-5)
    model = assemble(oscillator(more_joints=(steep,)))
    decay = 40.0 / 1e-5 / MASS
    assert steps_per_sample(model, np.zeros((1, 1)), 1e-4) >= int(0.9 * 1e-4 * decay / 0.3)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'axis': 0}, 'axis is 0'),
        ({'axis': 7}, 'axis is 7'),
        ({'kind': 'glue'}, '"glue" is no kind of element'),
        ({'transition_velocity': 0.0}, 'transition_velocity is 0.0, expected more than 0'),
        ({'transition_velocity': np.inf}, 'transition_velocity is inf'),
        ({'gap': 1.0}, 'has no gap'),
        ({'kind': 'hysteresis', 'limit': 1.0, 'exponent': 0.5}, 'exponent is 0.5, expected at'),
        ({'kind': 'hysteresis', 'limit': unknown(1.0)}, 'limit must be known'),
        ({'kind': 'hysteresis'}, 'limit is missing'),
    ],
)
def test_impossible_elements_are_refused(changes, words):
    kind = changes.pop('kind', 'coulomb_friction')
    numbers = {'transition_velocity': 1e-5} if kind == 'coulomb_friction' else {}
    with pytest.raises(MachineError, match=words):
        element(kind, known(1.0), **(numbers | changes))


def test_damping_of_the_oscillator_remains_that_of_its_damper():
    np.testing.assert_array_equal(CASES['coulomb_friction'].model().damping_matrix(), [[DAMPING]])
    assert ORIGIN.shape == (3,)
