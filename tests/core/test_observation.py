# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a sensor layout sees: exact inversion, named blind spots, covariance by Monte Carlo."""

from dataclasses import replace

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.observation import observe_force, observe_motion, sensor_matrix
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.principal_axes import principal_axes
import numpy as np
import pytest

from tests.core.machines import line_layout, oscillator, skew_machine, X, Y, Z
from tests.reference_machines import complete_layout

MACHINE = skew_machine()
MODEL = assemble(MACHINE)
DISPLACEMENT = SensorKind.DISPLACEMENT


def observed(sensors, kind=DISPLACEMENT, model=MODEL):
    return observe_motion(model, Layout(tuple(sensors)), kind)


def noise_of(sensors):
    return np.array([sensor.noise for sensor in sensors])


def random_sensors(seed=0, per_body=9, noise=0.0):
    generator = np.random.default_rng(seed)
    noises = np.full(99, noise) if np.isscalar(noise) else noise
    return [
        Sensor(
            f'{body.name}_{i}', DISPLACEMENT, body.name,
            body.centre_of_mass + generator.uniform(-0.4, 0.4, 3),
            generator.standard_normal(3), noise=noises[i],
        )
        for body in MACHINE.bodies for i in range(per_body)
    ]  # fmt: skip


def on_body(body, points_and_directions, kind=DISPLACEMENT, **settings):
    return [
        Sensor(f'{body}_{i}', kind, body, np.asarray(point, float), direction, **settings)
        for i, (point, direction) in enumerate(points_and_directions)
    ]


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('noise', [0.0, np.nan, 1e-8])
def test_motion_is_recovered_exactly_from_enough_sensors(seed, noise):
    sensors = random_sensors(seed, noise=noise)
    motion = np.random.default_rng(seed).standard_normal(12)
    # Readings from kinematics alone.
    readings = []
    for sensor in sensors:
        number = [body.name for body in MACHINE.bodies].index(sensor.body)
        body = MACHINE.bodies[number]
        _, axes = principal_axes(body.inertia)
        shift, turn = axes @ motion[6 * number :][:3], axes @ motion[6 * number + 3 :][:3]
        readings.append(
            sensor.direction @ (shift + np.cross(turn, sensor.point - body.centre_of_mass))
        )
    found = observed(sensors)
    assert found.unseen == ()
    np.testing.assert_allclose(found.matrix @ readings, motion, atol=1e-12)
    np.testing.assert_allclose(found.seen, np.eye(12), atol=1e-12)


@pytest.mark.parametrize('seed', range(3))
def test_covariance_is_the_spread_of_many_noisy_readings(seed):
    generator = np.random.default_rng(seed)
    noises = generator.uniform(0.5, 3.0, 9) * 1e-8
    sensors = random_sensors(seed, noise=noises)
    found = observed(sensors)
    count = 40000
    sizes = noise_of(sensors)
    covariance = found.covariance(sizes**2)
    spread = np.cov(found.matrix @ (sizes[:, np.newaxis] * generator.standard_normal((18, count))))
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    np.testing.assert_allclose(spread / scale, covariance / scale, atol=5 * np.sqrt(2 / count))


def test_variance_of_a_sensor_enters_by_its_place_in_the_whole_layout():
    # Sensors of the other kinds stand before, between and behind those that are used.
    sensors = random_sensors(1, noise=1e-8)
    others = [replace(sensor, kind=SensorKind.VELOCITY) for sensor in random_sensors(4)]
    mixed = [sensor for pair in zip(others, sensors, strict=True) for sensor in pair]
    layout = Layout(tuple(replace(sensor, name=f'{i}') for i, sensor in enumerate(mixed)))
    variance = np.linspace(0.5, 2.0, len(sensors)) * 1e-16
    everyone = np.full(len(mixed), np.nan)
    everyone[1::2] = variance
    found = observe_motion(MODEL, layout, DISPLACEMENT)
    assert found.channels == tuple(range(1, len(mixed), 2))
    alone = observed(sensors)
    expected = sum(
        one * np.outer(column, column)
        for one, column in zip(variance, alone.matrix.T, strict=True)
    )
    for covariance in (found.covariance(everyone), alone.covariance(variance)):
        np.testing.assert_allclose(covariance, expected, rtol=1e-10, atol=1e-14 * expected.max())


def test_weighted_map_has_the_least_variance_of_all_unbiased_ones():
    noises = np.array([1, 1, 1, 1, 1, 1, 20, 20, 20]) * 1e-8
    sensors = random_sensors(2, noise=noises)
    sizes = noise_of(sensors)
    weighted = observed(sensors).covariance(sizes**2)
    equal = observed([replace(sensor, noise=float('nan')) for sensor in sensors])
    # Gauss and Markov: the difference of the covariances is positive semidefinite.
    assert (
        np.linalg.eigvalsh(equal.covariance(sizes**2) - weighted).min() > -1e-12 * weighted.max()
    )
    assert np.all(np.diag(weighted) < np.diag(equal.covariance(sizes**2)))
    rows = sensor_matrix(MODEL, tuple(sensors))
    bound = np.linalg.inv(rows.T @ (rows / sizes[:, np.newaxis] ** 2))
    np.testing.assert_allclose(weighted, bound, rtol=1e-9, atol=1e-12 * bound.max())


def test_unknown_noise_gives_an_unknown_covariance():
    sensors = random_sensors(3, noise=1e-8)
    sensors[4] = replace(sensors[4], noise=float('nan'))
    assert np.isnan(observed(sensors).covariance(noise_of(sensors) ** 2)).all()


def test_rotation_about_the_line_of_all_sensors_is_named_as_unseen():
    machine = oscillator()
    body = replace(
        machine.bodies[0], name='knee', inertia=np.diag([3.0, 4.0, 5.0]),
        degrees_of_freedom=(
            'translation_1', 'translation_2', 'translation_3',
            'rotation_1', 'rotation_2', 'rotation_3',
        ),
    )  # fmt: skip
    model = assemble(replace(machine, bodies=(body,), joints=(), excitations=()))
    on_axis_3 = [((0, 0, z), direction) for z in (-0.2, 0.3) for direction in (X, Y, Z)]
    found = observed(on_body('knee', on_axis_3), model=model)
    assert found.unseen == ('rotation 3 of knee',)


def test_body_without_sensors_is_unseen_in_all_its_motions():
    sensors = [sensor for sensor in random_sensors() if sensor.body == 'bed']
    assert observed(sensors).unseen == tuple(
        f'{motion} {axis} of saddle'
        for motion in ('translation', 'rotation')
        for axis in (1, 2, 3)
    )


def test_quantity_that_no_sensor_measures_is_unseen_altogether():
    found = observed(random_sensors(), SensorKind.VELOCITY)
    assert len(found.unseen) == 12
    assert found.matrix.shape == (12, 0)
    np.testing.assert_array_equal(found.seen, 0.0)
    np.testing.assert_array_equal(found.covariance(np.ones(18)), 0.0)


@pytest.mark.parametrize('count', range(1, 6))
def test_what_is_seen_of_too_few_sensors_is_right_and_the_rest_named(count):
    sensors = [sensor for sensor in random_sensors(5) if sensor.body == 'bed'][:count]
    sensors += [sensor for sensor in random_sensors(6) if sensor.body == 'saddle']
    found = observed(sensors)
    assert found.unseen
    assert all(name.endswith('bed') for name in found.unseen)
    motion = np.random.default_rng(9).standard_normal(12)
    rows = sensor_matrix(MODEL, tuple(sensors))
    np.testing.assert_allclose((found.matrix @ (rows @ motion))[6:], motion[6:], atol=1e-11)
    # What is given for seen and unseen together leaves the readings as they are.
    np.testing.assert_allclose(rows @ found.seen, rows, atol=1e-12)
    np.testing.assert_allclose(found.seen @ found.seen, found.seen, atol=1e-11)


def test_relative_probes_see_the_difference_of_two_bodies_at_their_point():
    point, direction = np.array([0.15, 0.1, 0.5]), np.array([1.0, 2.0, 3.0])
    probe = Sensor('probe', DISPLACEMENT, 'saddle', point, direction, reference_body='bed')
    row = sensor_matrix(MODEL, (probe,))[0]
    single = [
        sensor_matrix(MODEL, (Sensor('one', DISPLACEMENT, body, point, direction),))[0]
        for body in ('saddle', 'bed')
    ]
    np.testing.assert_allclose(row, single[0] - single[1], atol=1e-15)


def test_relative_probes_with_sensors_on_one_body_see_both():
    relative = [
        replace(sensor, reference_body='bed')
        for sensor in random_sensors(1) if sensor.body == 'saddle'
    ]  # fmt: skip
    absolute = [sensor for sensor in random_sensors(2) if sensor.body == 'bed']
    motion = np.random.default_rng(3).standard_normal(12)
    sensors = (*absolute, *relative)
    found = observed(sensors)
    assert found.unseen == ()
    readings = sensor_matrix(MODEL, sensors) @ motion
    np.testing.assert_allclose(found.matrix @ readings, motion, atol=1e-11)
    assert len(observed(relative).unseen) == 12


def test_mixing_noisy_and_noiseless_sensors_of_a_kind_is_refused():
    sensors = random_sensors(0, noise=1e-8)
    sensors[3] = replace(sensors[3], noise=0.0)
    with pytest.raises(LayoutError, match=f'{sensors[3].name}: noise is 0 while other'):
        observed(sensors)


def test_sensor_on_the_ground_is_refused():
    with pytest.raises(LayoutError, match='sensor ground_0: sits on the ground'):
        observed(on_body('ground', [((0, 0, 0), X)]))


def test_sensor_on_no_body_is_refused_by_name():
    with pytest.raises(LayoutError, match='sensor tower_0: "tower" is no body'):
        observed(on_body('tower', [((0, 0, 0), X)]))


def force_layout(*noises, excitation='exciter'):
    return Layout(tuple(
        Sensor(f'cell_{i}', SensorKind.FORCE, excitation=excitation, noise=noise)
        for i, noise in enumerate(noises)
    ))  # fmt: skip


def test_two_force_cells_on_one_exciter_are_averaged_by_inverse_variance():
    found = observe_force(MODEL, force_layout(1.0, 2.0))
    direction = MODEL.excitation_directions[0]
    np.testing.assert_allclose(found.matrix, np.outer(direction, [0.8, 0.2]), rtol=1e-12)
    covariance = found.covariance(np.array([1.0, 4.0]))
    np.testing.assert_allclose(covariance, 0.8 * np.outer(direction, direction), rtol=1e-12)


def test_exciter_without_cell_and_cell_without_exciter_are_refused():
    with pytest.raises(LayoutError, match='cell_0: measures excitation "hammer"'):
        observe_force(MODEL, force_layout(0.0, excitation='hammer'))
    without = Layout(complete_layout(MACHINE).sensors[1:])
    with pytest.raises(LayoutError, match='no force sensor measures excitation "exciter"'):
        observe_force(MODEL, without)


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        ({'gain': 0.0}, 'gain'),
        ({'noise': -1.0}, 'noise'),
        ({'delay': np.nan}, 'delay'),
        ({'direction': np.zeros(3)}, 'direction'),
        ({'dropout_probability': 1.0}, 'dropout_probability'),
        ({'reference_body': 'block'}, 'against itself'),
        ({'body': ''}, 'body it sits on'),
        ({'kind': SensorKind.ACCELERATION, 'reference_body': 'other'}, 'only displacement'),
        ({'kind': SensorKind.FORCE}, 'excitation point'),
    ],
)
def test_sensor_that_cannot_be_is_refused(changes, says):
    sensor = line_layout().sensors[1]
    with pytest.raises(LayoutError, match=f'sensor block_displacement.*{says}'):
        replace(sensor, **changes)


def test_recorded_numbers_and_si_are_each_other_s_inverse():
    sensor = replace(line_layout().sensors[1], gain=-2.5e6, offset=0.7, drift=0.1)
    quantity, time = np.array([1e-6, -3e-6, 0.0]), np.array([0.0, 1.0, 5.0])
    np.testing.assert_allclose(sensor.to_recorded(quantity, time), [-1.8, 8.3, 1.2])
    again = sensor.to_si(sensor.to_recorded(quantity, time), time)
    np.testing.assert_allclose(again, quantity, atol=1e-20)
