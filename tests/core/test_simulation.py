# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The compiled integrator against closed forms and against independent integrators."""

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.joints import SpringDamper
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.simulation.excitation import Impulses, multisine, sine, Sweep
from identnl_ros.core.simulation.integrator import integrate, NODES
from identnl_ros.core.simulation.simulation import (
    equations_of,
    LARGEST_MOTION,
    Simulation,
    STEP_LIMIT,
    steps_per_sample,
)
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from tests.core.machines import chain, known, oscillator, skew_machine, slideway, X, Z


def simulation(model, signal, interval, steps=None, displacement=None):
    rest = np.zeros(len(model.coordinates)) if displacement is None else displacement
    if steps is None:
        steps = steps_per_sample(model, np.zeros((1, len(rest))), interval)
    return Simulation(model, (signal,), interval, rest, np.zeros_like(rest), steps)


def independent(model, signal, times, displacement=None, method='Radau', tolerance=1e-11):
    """Integrate the equations in their uncompiled form with an implicit method of scipy."""
    n = len(model.coordinates)
    inverse_mass = 1 / model.mass_diagonal()
    start = np.zeros(n) if displacement is None else displacement
    size = np.concatenate((np.full(n, 1e-6), np.full(n, 1e-4)))  # micrometres, mm/s

    def rates(time, scaled):
        state = scaled * size
        force = signal.on_grid(time, 1.0, 1)[0] * model.excitation_directions[0]
        joints = model.joint_force(state[np.newaxis, :n], state[np.newaxis, n:])[0]
        return np.concatenate(
            (state[n:], inverse_mass * (force + model.constant_load() - joints))
        ) / size  # fmt: skip

    solution = solve_ivp(
        rates, (0, times[-1]), np.concatenate((start, np.zeros(n))) / size,
        method=method, t_eval=times, rtol=tolerance, atol=tolerance,
    )  # fmt: skip
    assert solution.success
    return (solution.y.T * size)[:, :n], (solution.y.T * size)[:, n:]


def contact_block():
    """Block on a coupled slideway that opens, with a quadratic and cubic spring aside."""
    body = Body('block', known(50.0), np.array([0.02, 0.0, 0.1]), np.diag([0.6, 0.9, 1.1]))
    spring = SpringDamper(
        'spring', 'block', 'ground', np.array([0.0, 0.0, 0.1]), np.eye(3),
        (known(1e7), known(1e7), known(1e7)), (known(1e3),) * 3,
        (known(0.0), known(0.0), known(2e12)), (known(5e18),),
    )  # fmt: skip
    slide = slideway(
        width=0.2, normal_stiffness=known(1e14),
        normal_damping=known(1e4), tangential_damping=known(1e4),
    )  # fmt: skip
    exciter = ExcitationPoint('exciter', 'block', np.array([0.1, 0.05, 0.15]), X + 2 * Z)
    return assemble(Machine('contact', (body,), (spring, slide), (exciter,)))


def test_linear_chain_under_a_sine_follows_the_matrix_exponential():
    model = assemble(chain())
    omega = 2 * np.pi * 37.0
    interval, count = 1e-3, 400
    # The sine as two more states: the whole system is autonomous and linear.
    system = np.zeros((6, 6))
    system[:2, 2:4] = np.eye(2)
    system[2:4, :2] = -np.diag([1 / 5, 1 / 3]) @ [[3e5, -1e5], [-1e5, 1e5]]
    system[2:4, 2:4] = -np.diag([1 / 5, 1 / 3]) @ [[80.0, -30.0], [-30.0, 30.0]]
    system[2, 4] = 120.0 / 5
    system[4, 5], system[5, 4] = omega, -omega
    state = np.array([0, 0, 0, 0, 0, 1.0])
    transition = expm(system * interval)
    expected = []
    for _ in range(count):
        expected.append(np.concatenate((state[:4], (system @ state)[2:4])))
        state = transition @ state
    expected = np.array(expected)
    found = simulation(model, sine(120.0, 37.0), interval).advance(count)
    for columns, part in zip((slice(0, 2), slice(2, 4), slice(4, 6)), found, strict=True):
        scale = np.abs(expected[:, columns]).max()
        np.testing.assert_allclose(part[0], expected[:, columns], atol=1e-10 * scale)


def test_machine_with_opening_contact_follows_an_independent_integrator():
    model = contact_block()
    signal = multisine(10.0, (20.0, 200.0), 0.5, np.random.default_rng(4))
    times = np.arange(200) / 5000
    displacement, velocity = independent(model, signal, times, None, 'LSODA', 1e-12)
    # The contact opens at some place: the slideway's rays reach beyond the preload.
    rays = [i for i, name in enumerate(model.line_joints) if name == 'slide']
    assert (displacement @ model.lines[rays].T).min() < -2e-6
    found = simulation(model, signal, 1 / 5000).advance(200)
    for part, expected in zip(found, (displacement, velocity), strict=False):
        scale = np.abs(expected).max(axis=0)
        assert (np.abs(part[0] - expected).max(axis=0) / scale).max() < 1e-7


@pytest.mark.parametrize(('method', 'tolerance'), [('Radau', 1e-9), ('LSODA', 1e-12)])
def test_nonlinear_oscillator_follows_implicit_integrators(method, tolerance):
    model, signal = duffing(), multisine(0.05, (5.0, 60.0), 0.5, np.random.default_rng(6))
    times = np.arange(60) / 500
    start = np.array([3e-6])
    displacement, velocity = independent(model, signal, times, start, method, tolerance)
    found = simulation(model, signal, 1 / 500, None, start).advance(60)
    for part, expected in zip(found, (displacement, velocity), strict=False):
        np.testing.assert_allclose(part[0], expected, atol=1e-7 * np.abs(expected).max())


def test_two_body_machine_with_skew_axes_follows_an_independent_integrator():
    model = assemble(skew_machine())
    signal = multisine(50.0, (20.0, 150.0), 0.5, np.random.default_rng(2))
    times = np.arange(50) / 4000
    displacement, velocity = independent(model, signal, times, None, 'LSODA', 1e-12)
    found = simulation(model, signal, 1 / 4000).advance(50)
    for part, expected in zip(found, (displacement, velocity), strict=False):
        scale = np.abs(expected).max(axis=0)
        assert (np.abs(part[0] - expected).max(axis=0) / scale).max() < 1e-8


def test_acceleration_given_out_satisfies_the_equations_of_motion():
    model = contact_block()
    signal = multisine(10.0, (20.0, 200.0), 0.5, np.random.default_rng(4))
    displacement, velocity, acceleration = (
        part[0] for part in simulation(model, signal, 1e-4).advance(300)
    )
    force = np.outer(signal.on_grid(0.0, 1e-4, 300), model.excitation_directions[0])
    left = model.mass_diagonal() * acceleration + model.joint_force(displacement, velocity)
    np.testing.assert_allclose(left, force, atol=1e-9 * np.abs(force).max())


def duffing(damping=30.0):
    return assemble(oscillator(known(1.0), known(1e4), known(damping), known(1e9), known(5e14)))


def with_steps(model, signal, interval, steps, count, start):
    """Return the displacement of the first coordinate with just so many steps."""
    step = interval / steps
    forces = [signal.on_grid(node * step, step, count * steps) for node in NODES]
    return integrate(
        start, 0 * start, np.zeros(0), step, steps,
        np.ascontiguousarray(np.transpose(forces)[..., np.newaxis]), *equations_of(model).arrays,
    )[0][:, 0]  # fmt: skip


def test_error_falls_with_the_eighth_power_of_the_step():
    model, signal = duffing(), sine(0.05, 20.0)
    start = np.array([3e-6])
    times = np.arange(41) * 0.02
    # The kernel itself: a run would take more steps by itself.
    finals = [with_steps(model, signal, 0.02, steps, 41, start) for steps in (6, 12, 24, 64)]
    errors = [np.abs(final - finals[-1]).max() for final in finals[:-1]]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 7.3) & (orders < 9.2)), (errors, orders)
    outside, _ = independent(model, signal, times, start, 'DOP853', 1e-13)
    np.testing.assert_allclose(finals[-1], outside[:, 0], atol=1e-11 * 3e-6)


def test_chosen_steps_are_exact_to_1e_11_on_a_linear_machine():
    model = assemble(oscillator(known(1.0), known(1e4), known(0.0)))
    found = simulation(model, sine(0.0, 1.0), 1e-3, None, np.array([1e-6])).advance(2000)
    expected = 1e-6 * np.cos(100.0 * 1e-3 * np.arange(2000))
    np.testing.assert_allclose(found[0][0, :, 0], expected, atol=1e-11 * 1e-6)


def test_undamped_nonlinear_machine_keeps_its_energy():
    model = duffing(damping=0.0)
    run = simulation(model, sine(0.0, 1.0), 1e-3, None, np.array([4e-6]))
    displacement, velocity, _ = (part[0, :, 0] for part in run.advance(20000))
    energy = (
        velocity**2 / 2 + 1e4 * displacement**2 / 2
        + 1e9 * displacement**3 / 3 + 5e14 * displacement**4 / 4
    )  # fmt: skip
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)


def test_hardening_beyond_the_stiffness_at_rest_costs_no_accuracy():
    # At rest nearly nothing holds the block; in motion the cubic spring makes about 110 Hz.
    model = assemble(oscillator(known(1.0), known(1.0), known(0.0), known(0.0), known(1e18)))
    start = np.array([1e-6])
    times = np.arange(100) / 1000
    expected, _ = independent(model, sine(0.0, 1.0), times, start, 'DOP853', 1e-13)
    found = simulation(model, sine(0.0, 1.0), 1e-3, None, start).advance(100)[0][0]
    np.testing.assert_allclose(found, expected, atol=1e-6 * 1e-6)


SIGNALS = {
    'sine': sine(50.0, 33.0),
    'multisine': multisine(50.0, (20.0, 150.0), 0.5, np.random.default_rng(2)),
    'sweep': Sweep(50.0, (20.0, 90.0), 0.11),
    'blows': Impulses(300.0, 0.002, 0.05),
}


@pytest.mark.parametrize('signal', SIGNALS)
def test_pieces_agree_with_one_go_to_rounding(signal):
    model = assemble(skew_machine())
    whole = simulation(model, SIGNALS[signal], 1e-3).advance(300, (0.0, 0.4))
    run = simulation(model, SIGNALS[signal], 1e-3)
    pieces = [run.advance(count, (0.0, 0.4)) for count in (1, 2, 61, 100, 136)]
    for i, part in enumerate(whole):
        joined = np.concatenate([piece[i] for piece in pieces], axis=1)
        np.testing.assert_allclose(joined, part, atol=1e-11 * np.abs(part).max())


def test_same_run_gives_the_same_bits_again():
    model = assemble(skew_machine())
    runs = [
        simulation(model, SIGNALS['multisine'], 1e-3).advance(50, (0.0, 0.25)) for _ in range(2)
    ]
    for first, second in zip(*runs, strict=True):
        np.testing.assert_array_equal(first, second)


def test_outputs_between_the_samples_lie_on_the_same_motion():
    model = contact_block()
    signal = multisine(10.0, (20.0, 200.0), 0.5, np.random.default_rng(4))
    coarse = simulation(model, signal, 1e-3).advance(30, (0.0, 0.25, 0.5))
    fine = simulation(model, signal, 2.5e-4).advance(120)
    for part, expected in zip(coarse, fine, strict=True):
        for row, offset in enumerate((0, 1, 2)):
            scale = np.abs(expected).max()
            np.testing.assert_allclose(part[row], expected[0, offset::4], atol=3e-7 * scale)
    fraction = 0.3711
    times = (np.arange(30) + fraction) * 1e-3
    outside, _ = independent(model, signal, times, None, 'LSODA', 1e-12)
    inside = simulation(model, signal, 1e-3).advance(30, (0.0, fraction))[0][1]
    np.testing.assert_allclose(inside, outside, atol=1e-6 * np.abs(outside).max())


@pytest.mark.parametrize(
    'coefficients', [(known(-1e6), known(0.0)), (known(1e6), known(-5e3))], ids=['k', 'c']
)
def test_machine_that_feeds_itself_is_stopped_with_the_time(coefficients):
    model = assemble(oscillator(known(1.0), *coefficients))
    run = simulation(model, sine(1.0, 10.0), 1e-3)
    with pytest.raises(MachineError, match=r'oscillator: the motion grows without bound') as found:
        run.advance(4000)
    # Displacement, velocity and the sine of the force: when does it pass LARGEST_MOTION?
    stiffness, damping = (coefficient.value for coefficient in coefficients)
    omega = 2 * np.pi * 10
    system = np.array(
        [[0, 1, 0, 0], [-stiffness, -damping, 1, 0], [0, 0, 0, omega], [0, 0, -omega, 0]]
    )
    far = [
        abs((expm(system * 1e-3 * index) @ [0, 0, 0, 1.0])[0]) > LARGEST_MOTION
        for index in range(60)
    ]
    time = float(str(found.value).split('about ')[1].split(' s')[0])
    assert time == pytest.approx(1e-3 * far.index(True), abs=1.01e-3)


@pytest.mark.parametrize(
    ('stiffness', 'cubic', 'amplitude', 'frequency', 'interval'),
    [
        (1.0, 1e18, 100.0, 20.0, 1e-3),
        (1.0, 1e20, 100.0, 20.0, 1e-3),
        (1e4, 1e16, 1e3, 5.0, 1e-3),
        (1e3, 1e14, 1e3, 5.0, 2e-3),
    ],
)
def test_machine_that_hardens_very_much_is_not_called_unbounded(
    stiffness, cubic, amplitude, frequency, interval
):
    # With the steps that suit the state of rest the integration breaks down; the motion does not.
    model = assemble(oscillator(known(1.0), known(stiffness), known(10.0), None, known(cubic)))
    signal = sine(amplitude, frequency)
    times = np.arange(30) * interval
    expected, _ = independent(model, signal, times, None, 'DOP853', 1e-12)
    run = simulation(model, signal, interval)
    found = run.advance(30)[0][0]
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


def test_steps_grow_while_the_machine_hardens_and_stay():
    model = assemble(oscillator(known(1.0), known(1.0), known(0.0), known(0.0), known(1e18)))
    run = simulation(model, sine(0.0, 1.0), 1e-3, None, np.array([1e-6]))
    assert run.steps == 1
    displacement = run.advance(10)[0][0]
    # Hertz to steps by hand: omega^2 = k + 3 k3 q^2 at the largest displacement there was.
    omega = np.sqrt(1.0 + 3e18 * np.abs(displacement).max() ** 2)
    assert run.steps == int(np.ceil(1e-3 * omega / STEP_LIMIT)) == 6
    run.advance(500)
    assert run.steps == 6


def test_steps_count_every_spring_at_its_stiffest():
    # Of three states one is the stiffest; the sign of the deformation must not matter.
    model = assemble(oscillator(known(2.0), known(1e4), known(0.0), None, known(1e16)))
    states = np.array([[1e-6], [-4e-6], [0.0]])
    omega = np.sqrt((1e4 + 3e16 * 16e-12) / 2.0)
    for interval in (1e-4, 3e-3, 0.1):
        expected = max(1, int(np.ceil(interval * omega / STEP_LIMIT)))
        assert steps_per_sample(model, states, interval) == expected


def test_constant_force_shifts_the_oscillation_by_its_static_displacement():
    gravity = np.array([9.81, 0.0, 0.0])
    model = assemble(oscillator(known(1.0), known(1e4), known(0.0), gravity=gravity))
    found = simulation(model, sine(0.0, 1.0), 1e-3).advance(500)[0][0, :, 0]
    expected = 9.81 / 1e4 * (1 - np.cos(0.1 * np.arange(500)))
    np.testing.assert_allclose(found, expected, atol=1e-13)
