# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of motions with friction, backlash, hysteresis against simulations nearby."""

from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.simulation.tangent_response import TangentResponse
import numpy as np
import pytest

from tests.core.element_cases import CASES, element
from tests.core.machines import known, oscillator, unknown

SIGNAL = multisine(5.0, (5.0, 60.0), 0.5, np.random.default_rng(3))
INTERVAL, COUNT = 5e-4, 300
KNOWN_NUMBERS = 'limit', 'exponent'
# Largest error of displacement and velocity, relative to the largest derivative. The sensitivities
# are those of the discrete motion to the last digit where a law is smooth; a kink makes them
# jump wherever a stage of the integration passes it.
EXACT = {
    'coulomb_friction': 1e-4, 'stribeck_friction': 1e-4, 'quadratic_damping': 1e-5,
    'backlash': 0.03, 'bilinear_stiffness': 0.03, 'hysteresis': 0.01,
}  # fmt: skip
# Root mean square error of the derivatives at the samples alone.
AT_SAMPLES = {
    'coulomb_friction': 0.05, 'stribeck_friction': 0.1, 'quadratic_damping': 0.003,
    'backlash': 0.03, 'bilinear_stiffness': 0.02, 'hysteresis': 0.08,
}  # fmt: skip


def model_of(name):
    """Build an oscillator whose element has all that can be estimated unknown."""
    case = CASES[name]
    numbers = {
        key: (known if key in KNOWN_NUMBERS else unknown)(value)
        for key, value in case.numbers.items()
    }
    one = element(case.kind, unknown(case.coefficient), **numbers)
    return assemble(oscillator(more_joints=(one,)))


def run_of(model, steps=1, sensitive=True, **state):
    at = {'displacement': np.zeros(1), 'velocity': np.zeros(1)} | state
    return VariedSimulation(
        model, (SIGNAL,), INTERVAL, **at, steps=steps, sensitive=sensitive
    )  # fmt: skip


def differences(name):
    """Return the model, the steps and finite differences: (n_samples, 3, n_columns)."""
    model = model_of(name)
    probe = run_of(model)
    probe.advance(COUNT)
    steps = probe.steps + 1  # so that all runs take the same
    columns = []
    for parameter in model.estimated:
        change = 1e-3 * model.values[parameter]
        moved = []
        for sign in (1, -1):
            values = model.values
            values[parameter] += sign * change
            moved.append(run_of(model.with_values(values), steps, False).advance(COUNT).motion)
        columns.append((moved[0] - moved[1])[:, :, 0] / (2 * change))
    for key, change in (('displacement', 1e-8), ('velocity', 1e-6)):
        moved = [
            run_of(model, steps, False, **{key: np.array([sign * change])}).advance(COUNT).motion
            for sign in (1, -1)
        ]
        columns.append((moved[0] - moved[1])[:, :, 0] / (2 * change))
    return model, steps, np.stack(columns, axis=2)


@pytest.fixture(scope='module', params=CASES)
def case(request):
    return request.param, *differences(request.param)


def test_sensitivities_are_those_of_simulations_nearby(case):
    name, model, steps, expected = case
    found = run_of(model, steps).advance(COUNT).derivatives[:, :, 0]
    for order in range(2):
        size = np.abs(expected[:, order]).max(axis=0)
        error = np.abs(found[:, order] - expected[:, order]).max(axis=0) / size
        assert error.max() < EXACT[name], error


def test_sensitivities_in_pieces_are_those_in_one_go(case):
    _, model, steps, _ = case
    whole = run_of(model, steps).advance(60)
    run = run_of(model, steps)
    joined = [run.advance(count) for count in (1, 20, 39)]
    for name in ('motion', 'derivatives', 'hidden'):
        expected = getattr(whole, name)
        found = np.concatenate([getattr(one, name) for one in joined])
        scale = np.abs(expected).max(axis=0)
        assert np.all(np.abs(found - expected) <= 1e-8 * scale)


def test_response_at_the_samples_is_near_them(case):
    name, model, steps, expected = case
    run = run_of(model, steps)
    parts = [run.advance(count).motion for count in (100, 200, 1)]
    motion = np.concatenate(parts)[:, :, 0]
    response = TangentResponse(model, INTERVAL)
    found = []
    for first, end in ((0, 100), (100, 300)):
        piece = motion[first : end + 1, :, np.newaxis]
        found.append(response.advance(piece[:, 0], piece[:, 1], piece[:, 2]))
    difference = np.concatenate(found)[:, :, 0] - expected
    for order in range(2):
        error = np.sqrt((difference[:, order] ** 2).mean(axis=0))
        size = np.sqrt((expected[:, order] ** 2).mean(axis=0))
        limits = np.full(error.shape, AT_SAMPLES[name])
        limits[-2:] = 0.2  # friction at the standstill it starts from
        assert (error < limits * size).all(), error / size


def test_response_takes_hysteretic_states_that_are_given():
    model = model_of('hysteresis')
    varied = run_of(model, 8).advance(101)
    motion = varied.motion
    results = []
    for hidden in (None, varied.hidden):
        response = TangentResponse(model, INTERVAL)
        results.append(response.advance(motion[:, 0], motion[:, 1], motion[:, 2], hidden=hidden))
        assert response.present_hidden.shape == (1, 3)
    np.testing.assert_allclose(results[0], results[1], atol=2e-3 * np.abs(results[1]).max())


def test_response_to_the_initial_hysteretic_state_is_that_of_simulations_nearby():
    model = model_of('hysteresis')
    change = 1e-8
    run, *nearby = (
        run_of(model, 40, False, hidden=np.array([2e-6 + shift])) for shift in (0, change, -change)
    )
    varied, high, low = (one.advance(151) for one in (run, *nearby))
    motion = varied.motion
    response = TangentResponse(model, INTERVAL, hidden_start=True)
    found = response.advance(motion[:, 0], motion[:, 1], motion[:, 2], hidden=varied.hidden)
    usual = TangentResponse(model, INTERVAL)
    same = usual.advance(motion[:, 0], motion[:, 1], motion[:, 2], hidden=varied.hidden)
    np.testing.assert_array_equal(found[..., :-1], same)
    for order, limit in enumerate((0.02, 0.05, 0.1)):
        expected = (high.motion - low.motion)[:150, order, 0] / (2 * change)
        error = np.sqrt(np.mean((found[:, order, 0, -1] - expected) ** 2))
        assert error < limit * np.sqrt(np.mean(expected**2))
    last = (high.hidden - low.hidden)[-1] / (2 * change)
    np.testing.assert_allclose(response.present_hidden[:, -1], last, atol=0.02)


@pytest.mark.parametrize('name', CASES)
def test_force_derivatives_are_those_of_the_joint_force(name):
    model = model_of(name)
    generator = np.random.default_rng(2)
    displacement = 6e-6 * generator.standard_normal((50, 1))
    velocity = 5e-4 * generator.standard_normal((50, 1))
    hidden = 3e-6 * generator.standard_normal((50, len(model.hidden_columns)))
    found = ForceDerivatives(model).of_motion(displacement, velocity, 0 * velocity, hidden)
    for column, parameter in enumerate(model.estimated):
        change = 1e-5 * model.values[parameter]
        forces = []
        for sign in (1, -1):
            values = model.values
            values[parameter] += sign * change
            forces.append(model.with_values(values).joint_force(displacement, velocity, hidden))
        expected = (forces[0] - forces[1]) / (2 * change)
        np.testing.assert_allclose(
            found[:, :, column], expected, atol=1e-6 * np.abs(expected).max()
        )
