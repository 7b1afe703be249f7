# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Force cells with a mass in front: what they read, and what every estimator makes of it."""

from dataclasses import replace

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.likelihood.likelihood_estimate import likelihood_estimate
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_force import measured_forces
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.joints import GROUND, SpringDamper
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.simulation.excitation import multisine, RecordedForce
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.validation.agreement import Agreement
from identnl_ros.core.validation.validation import Validation
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
import numpy as np
import pytest

from tests.core.machines import (
    blocks_of,
    deviations_of,
    identified,
    known,
    motion_of,
    ORIGIN,
    truth_of,
    unknown,
    values_of,
    X,
)

RATE = 4000.0
D, V, A, F = (
    SensorKind.DISPLACEMENT,
    SensorKind.VELOCITY,
    SensorKind.ACCELERATION,
    SensorKind.FORCE,
)
NOISE = {F: 0.01, D: 1e-8, V: 2e-6, A: 5e-3}
MASS = 0.12
SIGNAL = multisine(30.0, (10.0, 150.0), 0.5, np.random.default_rng(4))


def slide(mass=5.0):
    """Two bodies along x, the shaker between them."""
    bodies = tuple(
        Body(name, known(value), ORIGIN, None, ('translation_1',))
        for name, value in (('base', 12.0), ('table', mass))
    )
    springs = tuple(
        SpringDamper(
            name, body, other, ORIGIN, np.eye(3), (unknown(stiffness),), (unknown(damping),)
        )
        for name, body, other, stiffness, damping in (
            ('rail', 'table', 'base', 5e5, 120.0),
            ('floor', 'base', GROUND, 2e6, 400.0),
        )
    )
    shaker = ExcitationPoint('shaker', 'table', ORIGIN, -X, 'base')
    return Machine('slide', bodies, springs, (shaker,))


MODEL = assemble(slide())


def layout(mass=MASS, kinds=(D, A), **cell):
    sensors = [Sensor('cell', F, excitation='shaker', noise=NOISE[F], front_mass=mass, **cell)]
    for body in ('base', 'table'):
        for kind in kinds:
            sensors.append(Sensor(f'{body}_{kind.value}', kind, body, noise=NOISE[kind]))
    return Layout(tuple(sensors))


def measured(actual, declared=None, seed=1, count=6000, model=MODEL):
    stand = SimulatedStand(model, actual, (SIGNAL,), RATE, seed, 1, declared_layout=declared)
    return stand.read(count + 400).samples[400:]


def test_a_cell_reads_the_force_that_moves_the_heavier_body():
    # The same motion as without cell, of a body that is heavier by the mass in front and driven
    # by what the cell reads.
    grounded = Machine(
        'block',
        (Body('table', known(5.0), ORIGIN, None, ('translation_1',)),),
        (SpringDamper('rail', 'table', GROUND, ORIGIN, np.eye(3), (known(5e5),), (known(90.0),)),),
        (ExcitationPoint('shaker', 'table', ORIGIN, X),),
    )
    sensors = Layout(tuple(one for one in layout().sensors if 'base' not in one.name))
    samples = (
        SimulatedStand(assemble(grounded), sensors.with_noise_times(0), (SIGNAL,), RATE, 1, 1)
        .read(3000)
        .samples
    )
    heavier = replace(grounded, bodies=(replace(grounded.bodies[0], mass=known(5.0 + MASS)),))
    driven = RecordedForce(samples[:, 0].copy(), RATE)
    again = (
        SimulatedStand(assemble(heavier), sensors.with_noise_times(0), (driven,), RATE, 1, 1)
        .read(3000)
        .samples
    )
    used = slice(0, 2900)
    size = np.abs(samples[used, 1]).max()
    np.testing.assert_allclose(again[used, 1], samples[used, 1], rtol=0, atol=1e-5 * size)
    assert np.abs(samples[:, 0] - SIGNAL.on_grid(0.0, 1 / RATE, 3000)).max() > 1.0


@pytest.mark.parametrize('kinds', [(D, A), (D, V), (D,)], ids=['accelerometers', 'speed', 'D'])
@pytest.mark.parametrize('delay', [0.0, 2.4 / RATE])
def test_force_on_the_structure_is_recovered_by_transform_and_from_records(kinds, delay):
    clean = layout(kinds=kinds, delay=delay).with_noise_times(0)
    clean = replace(clean, sensors=tuple(
        replace(one, delay=1.3 / RATE) if one.kind is A else one for one in clean.sensors
    ))  # fmt: skip
    samples = measured(clean, count=2000)
    force = SIGNAL.on_grid(400 / RATE, 1 / RATE, 2000)
    (motion,) = motion_of(MODEL, clean, blocks_of(samples, RATE))
    part = slice(motion.first_index, motion.first_index + len(motion.force))
    size = np.abs(force).max()
    expected = np.outer(force[part], [1.0, -1.0])
    np.testing.assert_allclose(motion.force, expected, rtol=0, atol=1e-6 * size)
    (signal,) = measured_forces(MODEL, MeasuredRecord(clean, RATE, samples))
    inner = signal.on_grid(32 / RATE, 1 / RATE, 1900)
    np.testing.assert_allclose(inner, force[32:1932], rtol=0, atol=1e-5 * size)
    assert np.abs(samples[:, 0] - force).max() > 0.02 * size


@pytest.mark.parametrize('estimator', ['weak', 'pointwise', 'likelihood'])
def test_identification_with_the_mass_covers_the_truth_and_without_it_does_not(estimator):
    errors = []
    for declared in (layout(), layout(0.0)):
        samples = measured(layout(), declared)
        if estimator == 'likelihood':
            estimate = likelihood_estimate(MODEL, [MeasuredRecord(declared, RATE, samples[:3000])])
        elif estimator == 'weak':
            identifier = WeakIdentifier(MODEL)
            for motion in motion_of(MODEL, declared, blocks_of(samples, RATE)):
                identifier.add(motion)
            estimate = identifier.estimate()
        else:
            estimate = identified(MODEL, declared, blocks_of(samples, RATE))
        if not errors:
            expected = deviations_of(estimate)
        errors.append(np.abs(values_of(estimate) - truth_of(MODEL)) / expected)
    right, wrong = errors
    assert right.max() < 4
    assert wrong.max() > 30


def test_validation_agrees_only_if_the_mass_is_told_of():
    size = len(truth_of(MODEL))
    for declared, agrees in ((layout(), True), (layout(0.0), False)):
        run = Validation(MODEL, np.zeros((size, size)), declared, RATE)
        run.add(MeasuredRecord(declared, RATE, measured(layout(), declared, count=3000)))
        assert Agreement((run.comparison(),)).agrees is agrees


def test_several_cells_count_by_their_noise_each_with_its_own_mass():
    second = Sensor('second', F, excitation='shaker', noise=0.03, front_mass=0.0)
    both = Layout((*layout().sensors, second))
    samples = measured(both.with_noise_times(0), count=1000)
    (motion,) = motion_of(MODEL, both, blocks_of(samples, RATE))
    force = SIGNAL.on_grid(400 / RATE, 1 / RATE, 1000)[motion.first_index :][: len(motion.force)]
    np.testing.assert_allclose(motion.force[:, 1], -force, rtol=0, atol=1e-9)
    (signal,) = measured_forces(MODEL, MeasuredRecord(both, RATE, samples))
    expected = SIGNAL.on_grid(500 / RATE, 1 / RATE, 300)
    np.testing.assert_allclose(
        signal.on_grid(100 / RATE, 1 / RATE, 300), expected, rtol=0, atol=1e-4
    )


def test_noise_of_the_acceleration_is_in_the_covariance_of_the_force():
    heavy = layout(4.0)
    draws = [
        motion_of(MODEL, heavy, blocks_of(measured(heavy, seed=seed, count=400), RATE))[0]
        for seed in range(20)
    ]
    clean = motion_of(
        MODEL, heavy, blocks_of(measured(heavy.with_noise_times(0), count=400), RATE)
    )[0]
    found = np.mean([np.mean((one.force[:, 0] - clean.force[:, 0]) ** 2) for one in draws])
    expected = 0.01**2 + (4.0 * 5e-3) ** 2
    assert draws[0].force_covariance[0, 0] == pytest.approx(expected)
    assert found == pytest.approx(expected, rel=0.05)


def test_a_lost_reading_of_the_accelerometer_is_bridged_and_a_dead_one_replaced():
    samples = measured(layout().with_noise_times(0), count=1500)
    force = SIGNAL.on_grid(440 / RATE, 1 / RATE, 1400)
    samples[700:702, 4] = np.nan
    record = MeasuredRecord(layout(), RATE, samples)
    (signal,) = measured_forces(MODEL, record)
    np.testing.assert_allclose(signal.on_grid(40 / RATE, 1 / RATE, 1400), force, atol=1e-3)
    samples[700:800, 4] = np.nan
    (signal,) = measured_forces(MODEL, MeasuredRecord(layout(), RATE, samples))
    np.testing.assert_allclose(signal.on_grid(40 / RATE, 1 / RATE, 1400), force, atol=1e-3)
    samples[700:800, 3] = np.nan
    with pytest.raises(DataError, match=r'"shaker".* is not known all along'):
        measured_forces(MODEL, MeasuredRecord(layout(), RATE, samples))


def test_an_acceleration_that_no_sensor_sees_is_refused():
    blind = Layout(tuple(one for one in layout().sensors if one.body != 'table'))
    record = MeasuredRecord(blind, RATE, np.zeros((200, len(blind.sensors))))
    with pytest.raises(LayoutError, match='"shaker" has a mass in front, but no sensors see'):
        measured_forces(MODEL, record)
    with pytest.raises(LayoutError, match='cannot see'):
        MotionTransform(MODEL, blind, RATE)
