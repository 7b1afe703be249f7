# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The layout for machines without one: it sees everything, whatever the machine."""

from identnl_ros.core.measurement.complete_layout import (
    ARM,
    complete_layout,
    MOTION_KINDS,
    TYPICAL_NOISE,
)
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.observation import observe_force, observe_motion, sensor_matrix
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.core.machines import chain, known, oscillator, skew_machine, turned, X, Y
from tests.reference_machines import column, knee_and_column, pads


def three_bodies():
    """Column, knee and a far smaller table, two exciters: as the largest machine shipped."""
    pair = knee_and_column()
    table = Body(
        'table', known(3.0), np.array([2.5, -1.0, 0.9]), np.diag([2e-3, 3e-3, 4e-3])
    )  # far from the origin of the machine frame
    exciters = (
        *pair.excitations,
        ExcitationPoint('hammer', 'table', np.array([2.5, -1.0, 1.0]), Y, 'knee', 0.5 * X),
    )
    return Machine('three', (*pair.bodies, table), pair.joints, exciters)


MACHINES = {
    'oscillator': oscillator(),
    'chain': chain(),
    'skew': skew_machine(),
    'skew, turned': turned(skew_machine(), Rotation.from_rotvec([0.9, -2.0, 0.4]).as_matrix()),
    'knee and column': knee_and_column(),
    'coupled': knee_and_column(coupled=True),
    'three bodies': three_bodies(),
    'no exciter': Machine('column', (column(),), pads()),
}


@pytest.mark.parametrize('machine', MACHINES.values(), ids=MACHINES)
@pytest.mark.parametrize('kind', MOTION_KINDS)
def test_every_coordinate_of_every_machine_is_seen(machine, kind):
    model, layout = assemble(machine), complete_layout(machine)
    found = observe_motion(model, layout, kind)
    assert found.unseen == ()
    motion = np.random.default_rng(1).standard_normal(len(model.coordinates))
    sensors = tuple(layout.sensors[channel] for channel in found.channels)
    assert {sensor.kind for sensor in sensors} == {kind}
    np.testing.assert_allclose(found.matrix @ sensor_matrix(model, sensors) @ motion, motion)
    # Well seen: no coordinate is louder than a sensor, rotations not louder than over the arm.
    deviations = np.sqrt(
        np.diag(found.covariance(np.full(len(complete_layout(machine).sensors), 1.0)))
    )
    assert deviations.max() < 1.0 / ARM


@pytest.mark.parametrize('machine', list(MACHINES.values())[:-1], ids=list(MACHINES)[:-1])
def test_transform_accepts_it_and_derives_nothing(machine):
    model, layout = assemble(machine), complete_layout(machine)
    assert MotionTransform(model, layout, 1e4).derived == ()
    matrix = observe_force(model, layout).matrix
    np.testing.assert_allclose(matrix, model.excitation_directions.T)


def test_kinds_that_are_left_out_are_derived():
    machine = knee_and_column()
    kinds = (SensorKind.DISPLACEMENT, SensorKind.ACCELERATION)
    layout = complete_layout(machine, motion_kinds=kinds)
    assert MotionTransform(assemble(machine), layout, 1e4).derived == ('velocity',)
    assert {sensor.kind for sensor in layout.sensors} == {SensorKind.FORCE, *kinds}


def test_every_sensor_has_the_noise_of_its_kind_and_a_name_of_its_own():
    noise = dict(zip(SensorKind, (1.0, 2.0, 3.0, 4.0), strict=True))
    for machine in MACHINES.values():
        for stated, expected in ((noise, noise), (None, TYPICAL_NOISE)):
            layout = complete_layout(machine, **({'noise': stated} if stated else {}))
            assert all(sensor.noise == expected[sensor.kind] for sensor in layout.sensors)
            assert len(layout.sensors) == len(machine.excitations) + 27 * len(machine.bodies)
            assert len({sensor.name for sensor in layout.sensors}) == len(layout.sensors)
            assert layout.stand == machine.name
