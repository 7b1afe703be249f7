# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensitivities against a closed form and against simulations with other values."""

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine, sine
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.simulation.simulation import Simulation
import numpy as np
import pytest

from tests.core.machines import known, oscillator, unknown
from tests.reference_machines import knee_and_column

INTERVAL = 1e-4
SIGNAL = multisine(1000.0, (5.0, 300.0), 1.0, np.random.default_rng(4))


def simulated(model, displacement, velocity, count=200, signal=SIGNAL, **settings):
    simulation = VariedSimulation(
        model, (signal,), INTERVAL, displacement.copy(), velocity.copy(), **settings
    )
    return simulation.advance(count)


@pytest.fixture(scope='module', params=[False, True], ids=['decoupled', 'coupled'])
def machine(request):
    return assemble(knee_and_column(coupled=request.param))


def state(size=12):
    generator = np.random.default_rng(8)
    return 1e-7 * generator.standard_normal(size), 1e-5 * generator.standard_normal(size)


def test_free_vibration_of_a_linear_oscillator_has_its_closed_form():
    mass, stiffness, damping = 10.0, 4e5, 200.0
    model = assemble(oscillator(known(mass), unknown(stiffness), unknown(damping)))
    start = np.array([2e-6]), np.array([3e-4])
    found = simulated(model, *start, signal=sine(0.0, 1.0), step_limit=0.05)
    time = INTERVAL * np.arange(200)

    def exact(k, c, place, rate):
        decay = c / (2 * mass)
        omega = np.sqrt(k / mass - decay**2)
        shift = (rate + decay * place) / omega
        return np.exp(-decay * time) * (
            place * np.cos(omega * time) + shift * np.sin(omega * time)
        )

    at = (stiffness, damping, *(float(one[0]) for one in start))
    np.testing.assert_allclose(found.motion[:, 0, 0], exact(*at), atol=1e-16)
    for column, value in enumerate(at):
        # The closed form at complex values gives its derivative to rounding.
        moved = [complex(one) for one in at]
        moved[column] += 1e-30j * value
        expected = np.imag(exact(*moved)) / (1e-30 * value)
        np.testing.assert_allclose(
            found.derivatives[:, 0, 0, column], expected, atol=1e-9 * np.abs(expected).max()
        )


def test_motion_is_that_of_the_simulation(machine):
    start = state()
    simulation = Simulation(machine, (SIGNAL,), INTERVAL, *(one.copy() for one in start), 4)
    found = simulated(machine, *start, steps=4, sensitive=False)
    for order, expected in enumerate(simulation.advance(200)):
        size = np.abs(expected).max()
        np.testing.assert_allclose(found.motion[:, order], expected[0], atol=1e-9 * size)
    assert found.derivatives.shape == (200, 3, 12, 0)


def test_derivatives_are_those_of_the_computed_motion(machine):
    # Also with steps so large that the motion itself is not exact.
    start = state()
    found = simulated(machine, *start, steps=2, step_limit=2.0)
    values = machine.values

    def changed(column, change):
        moved, displacement, velocity = values.copy(), *(one.copy() for one in start)
        if column < 16:
            moved[machine.estimated[column]] += change
        else:
            (displacement if column < 28 else velocity)[(column - 16) % 12] += change
        return simulated(
            machine.with_values(moved), displacement, velocity, steps=2, step_limit=2.0,
            sensitive=False,
        ).motion  # fmt: skip

    for column in (0, 1, 2, 3, 11, 12, 16, 20, 27, 28, 39):
        size = values[machine.estimated[column]] if column < 16 else (1e-6, 1e-4)[column >= 28]
        change = 2e-4 * size
        expected = (changed(column, change) - changed(column, -change)) / (2 * change)
        for order in range(3):
            np.testing.assert_allclose(
                found.derivatives[:, order, :, column], expected[:, order],
                atol=2e-6 * np.abs(expected[:, order]).max(),
            )  # fmt: skip


def test_pieces_join_without_a_seam(machine):
    whole = simulated(machine, *state(), count=30)
    simulation = VariedSimulation(machine, (SIGNAL,), INTERVAL, *state())
    parts = [simulation.advance(count) for count in (1, 9, 20)]
    for name in ('motion', 'derivatives'):
        joined = np.concatenate([getattr(part, name) for part in parts])
        expected = getattr(whole, name)
        size = np.abs(expected).max(axis=0)
        assert np.all(np.abs(joined - expected) <= 1e-9 * size)


def test_unknown_mass_acts_through_the_acceleration():
    model = assemble(oscillator(unknown(10.0), known(4e5), known(200.0), None, known(1e15)))
    start = np.array([2e-6]), np.array([3e-4])
    found = simulated(model, *start, signal=sine(100.0, 60.0))
    high, low = (
        simulated(
            model.with_values(np.where(np.arange(4) == model.estimated[0], mass, model.values)),
            *start, signal=sine(100.0, 60.0), sensitive=False, steps=2,
        ).motion
        for mass in (10.001, 9.999)
    )  # fmt: skip
    expected = (high - low)[:, 0, 0] / 0.002
    np.testing.assert_allclose(
        found.derivatives[:, 0, 0, 0], expected, atol=1e-5 * np.abs(expected).max()
    )


def test_smaller_steps_are_taken_where_the_limit_asks_for_them(machine):
    steps = []
    for limit in (1.2, 0.3):
        simulation = VariedSimulation(machine, (SIGNAL,), INTERVAL, *state(), step_limit=limit)
        simulation.advance(10)
        steps.append(simulation.steps)
    assert steps[0] in (1, 2)
    assert steps[1] >= 3 * steps[0]


def test_motion_without_bound_is_refused():
    model = assemble(oscillator(known(10.0), known(-4e5), known(-2e5)))
    with pytest.raises(MachineError, match='grows without bound'):
        simulated(model, np.array([1.0]), np.array([0.0]), count=5000)
