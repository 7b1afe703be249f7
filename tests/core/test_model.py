# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The assembled equations of motion: rigid-body facts, energy, derivatives, a chain by hand."""

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.principal_axes import principal_axes
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from tests.core.machines import chain, oscillator, skew_machine, turned, unknown, X, Y, Z
from tests.reference_machines import knee_and_column

MACHINES = {
    'skew': skew_machine,
    'decoupled': knee_and_column,
    'coupled': lambda: knee_and_column(coupled=True),
}
each_machine = pytest.mark.parametrize('machine', MACHINES)


def rigid_motion(machine, shift, turn):
    """Coordinates when all bodies move together, from kinematics alone."""
    motion = []
    for body in machine.bodies:
        _, axes = principal_axes(body.inertia)
        motion.extend(axes.T @ (shift + np.cross(turn, body.centre_of_mass)))
        motion.extend(axes.T @ turn)
    return np.array(motion)


def mass_and_stiffness(model):
    return np.diag(model.mass_diagonal()), model.tangent_stiffness(
        np.zeros(len(model.coordinates))
    )


@each_machine
@pytest.mark.parametrize('seed', range(5))
def test_moving_all_bodies_together_deforms_no_joint_between_bodies(machine, seed):
    machine = MACHINES[machine]()
    shift, turn = np.random.default_rng(seed).standard_normal((2, 3))
    model = assemble(machine)
    deformation = model.lines @ rigid_motion(machine, shift, turn)
    between = np.array(
        [not name.startswith('pad') for name in model.line_joints]
    )  # pads stand on the ground
    np.testing.assert_allclose(deformation[between], 0.0, atol=1e-13)
    assert np.abs(deformation[~between]).max() > 0.01


@pytest.mark.parametrize('seed', range(5))
def test_deformation_is_the_motion_of_the_points_seen_from_the_joint(seed):
    machine = skew_machine()
    model = assemble(machine)
    motion = np.random.default_rng(seed).standard_normal(12)
    seen = {}
    for number, body in enumerate(machine.bodies):
        _, axes = principal_axes(body.inertia)
        seen[body.name] = (
            body.centre_of_mass,
            axes @ motion[6 * number : 6 * number + 3],
            axes @ motion[6 * number + 3 : 6 * number + 6],
        )
    seen['ground'] = (np.zeros(3),) * 3
    for joint in machine.joints:
        relative = np.zeros(6)
        for name, sign in ((joint.body, 1), (joint.other_body, -1)):
            centre, shift, turn = seen[name]
            relative[:3] += sign * (shift + np.cross(turn, joint.point - centre))
            relative[3:] += sign * turn
        local = np.concatenate((joint.axes.T @ relative[:3], joint.axes.T @ relative[3:]))
        found = {
            term.direction.tobytes(): term.direction @ local for term in joint.terms()
        }.values()
        rows = [i for i, name in enumerate(model.line_joints) if name == joint.name]
        np.testing.assert_allclose(model.lines[rows] @ motion, list(found), rtol=1e-12)


def test_machine_that_stands_on_nothing_has_six_zero_frequencies():
    mass, stiffness = mass_and_stiffness(assemble(skew_machine(grounded=False)))
    values = eigh(stiffness, mass, eigvals_only=True)
    assert np.abs(values[:6]).max() < 1e-11 * values[-1]
    assert values[6] > 1e-6 * values[-1]


@each_machine
@pytest.mark.parametrize('seed', range(4))
def test_natural_frequencies_do_not_depend_on_the_machine_frame(machine, seed):
    machine = MACHINES[machine]()
    rotation = Rotation.from_quat(np.random.default_rng(seed).standard_normal(4)).as_matrix()
    values = [
        eigh(*reversed(mass_and_stiffness(assemble(one))), eigvals_only=True)
        for one in (machine, turned(machine, rotation))
    ]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-9, atol=1e-12 * values[0][-1])
    dampings = [
        eigh(assemble(one).damping_matrix(), mass_and_stiffness(assemble(one))[0],
             eigvals_only=True)
        for one in (machine, turned(machine, rotation))
    ]  # fmt: skip
    np.testing.assert_allclose(dampings[0], dampings[1], rtol=1e-9, atol=1e-12 * dampings[0][-1])


def random_states(model, seed, count):
    """Displacements of a few tenths of a micrometre (and microradians)."""
    return np.random.default_rng(seed).uniform(-1.5e-6, 1.5e-6, (count, len(model.coordinates)))


@each_machine
@pytest.mark.parametrize('seed', range(3))
def test_joints_without_damping_do_no_work_on_a_closed_path(machine, seed):
    model = assemble(MACHINES[machine]())
    corners = random_states(model, seed, 3)
    nodes, weights = np.polynomial.legendre.leggauss(400)
    work, effort = 0.0, 0.0
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        path = start + np.outer((nodes + 1) / 2, end - start)
        power = model.joint_force(path, np.zeros_like(path)) @ (end - start)
        work += weights / 2 @ power
        effort += weights / 2 @ np.abs(power)
    # The second derivative of the force jumps where a contact opens or changes side.
    assert abs(work) < 1e-6 * effort


def stored_energy(model, displacement):
    """Elastic energy from the antiderivatives of the laws, minus the work of locked-in forces."""
    energy = 0.0
    for joint in model.machine.joints:
        rows = [i for i, name in enumerate(model.line_joints) if name == joint.name]
        order = {}
        for term in joint.terms():
            order.setdefault(term.direction.tobytes(), len(order))
        for term in joint.terms():
            x = model.lines[rows[order[term.direction.tobytes()]]] @ displacement
            m, rest = term.law.exponent, term.law.preload
            match term.law.kind.name:
                case 'LINEAR':
                    part = x**2 / 2
                case 'POLYNOMIAL':
                    part = x ** (m + 1) / (m + 1)
                case 'SIGNED_POWER':
                    part = abs(rest + x) ** (m + 1) / (m + 1) - rest**m * x
                case 'CONTACT':
                    part = max(rest + x, 0.0) ** (m + 1) / (m + 1) - rest**m * x
                case 'VISCOUS':
                    part = 0.0
            energy += term.coefficient.value * term.factor * part
    return energy


@each_machine
def test_joint_force_is_the_gradient_of_the_stored_energy(machine):
    model = assemble(MACHINES[machine]())
    n = len(model.coordinates)
    for displacement in random_states(model, 7, 3):
        gradient = np.empty(n)
        for i in range(n):
            slopes = []
            for step in (4e-8, 2e-8):
                shift = step * np.eye(n)[i]
                slopes.append(
                    (stored_energy(model, displacement + shift)
                     - stored_energy(model, displacement - shift)) / (2 * step)
                )  # fmt: skip
            gradient[i] = (4 * slopes[1] - slopes[0]) / 3
        force = model.joint_force(displacement[np.newaxis], np.zeros((1, n)))[0]
        np.testing.assert_allclose(force, gradient, rtol=1e-6, atol=1e-5 * np.abs(force).max())


@each_machine
def test_tangent_stiffness_is_the_derivative_of_the_joint_force(machine):
    model = assemble(MACHINES[machine]())
    n = len(model.coordinates)
    for displacement in (np.zeros(n), *random_states(model, 3, 3)):
        steps = 1e-10 * np.eye(n)
        states = np.vstack((displacement + steps, displacement - steps))
        forces = model.joint_force(states, np.zeros_like(states))
        expected = (forces[:n] - forces[n:]).T / 2e-10
        found = model.tangent_stiffness(displacement)
        np.testing.assert_allclose(found, found.T, atol=1e-12 * np.abs(found).max())
        np.testing.assert_allclose(found, expected, atol=2e-4 * np.abs(found).max())


@each_machine
def test_damping_matrix_is_the_derivative_by_velocity_and_takes_energy(machine):
    model = assemble(MACHINES[machine]())
    n = len(model.coordinates)
    still = model.joint_force(np.zeros((n, n)), np.zeros((n, n)))
    expected = (model.joint_force(np.zeros((n, n)), np.eye(n)) - still).T
    found = model.damping_matrix()
    np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(found).max())
    assert np.linalg.eigvalsh(found).min() > -1e-12 * np.abs(found).max()


@each_machine
def test_nothing_acts_in_the_state_of_rest(machine):
    model = assemble(MACHINES[machine]())
    zero = np.zeros((1, len(model.coordinates)))
    np.testing.assert_array_equal(model.joint_force(zero, zero), 0.0)


def test_matrices_of_a_chain_are_those_of_the_textbook():
    model = assemble(chain())
    np.testing.assert_array_equal(model.mass_diagonal(), [5.0, 3.0])
    np.testing.assert_allclose(
        model.tangent_stiffness(np.zeros(2)), [[3e5, -1e5], [-1e5, 1e5]], rtol=1e-15
    )
    np.testing.assert_allclose(model.damping_matrix(), [[80.0, -30.0], [-30.0, 30.0]])
    np.testing.assert_array_equal(model.excitation_directions, [[1.0, 0.0]])


@pytest.mark.parametrize('seed', range(5))
def test_power_of_an_exciter_is_force_times_relative_velocity_of_its_points(seed):
    machine = skew_machine()
    model = assemble(machine)
    point = machine.excitations[0]
    velocity = np.random.default_rng(seed).standard_normal(12)
    relative = sum(
        model.motion_of_point('saddle', point.point, axis) @ velocity * axis
        - model.motion_of_point('bed', point.reaction_point, axis) @ velocity * axis
        for axis in (X, Y, Z)
    )
    assert model.excitation_directions[0] @ velocity == pytest.approx(point.direction @ relative)
    assert np.linalg.norm(point.direction) == pytest.approx(1.0)


def test_weight_does_no_work_in_turning_about_the_centre_and_pulls_all_bodies_alike():
    gravity = np.array([1.0, -2.0, -9.0])
    machine = skew_machine(gravity=gravity)
    load = assemble(machine).constant_load()
    for number, body in enumerate(machine.bodies):
        _, axes = principal_axes(body.inertia)
        np.testing.assert_allclose(
            axes @ load[6 * number : 6 * number + 3], body.mass.value * gravity, rtol=1e-13
        )
        np.testing.assert_allclose(load[6 * number + 3 : 6 * number + 6], 0.0, atol=1e-12)


def test_machine_without_a_number_cannot_be_simulated():
    with pytest.raises(MachineError, match=r'spring\.damping: no value'):
        assemble(oscillator(damping=unknown())).require_values()


def test_point_on_no_body_is_refused():
    with pytest.raises(MachineError, match='"tower" is no body'):
        assemble(oscillator()).motion_of_point('tower', X, X)
