# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Machines of the tests, built from the core alone so that no file format is involved."""

from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.mechanics.joints import Coefficient, frame_about, Slideway, SpringDamper
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
import numpy as np

OMEGA_REFERENCE = 2 * np.pi * 40.0
DECANEWTON_PER_MICROMETRE = 1e7


def known(*values):
    return tuple(Coefficient(float(value)) for value in values)


def unknown(value):
    return Coefficient(float(value), estimated=True)


def column(mass=900.0):
    return Body(
        'column', Coefficient(mass), np.array([0.0, 0.0, 0.75]), np.diag([190.0, 160.0, 60.0])
    )


def pads(body='column'):
    places = [(x, y, 0.0) for x in (-0.3, 0.3) for y in (-0.3, 0.3)]
    return tuple(
        SpringDamper(
            f'pad_{i + 1}', body, 'ground', np.array(place), np.eye(3),
            known(1.2e7, 1.2e7, 2.5e7), known(6e3, 6e3, 1.2e4), kind='pad',
        )
        for i, place in enumerate(places)
    )  # fmt: skip


def knee_and_column(coupled=False):
    """Build the reference machine: all 16 slideway parameters unknown."""
    knee = Body(
        'knee', Coefficient(260.0), np.array([0.42, 0.0, 0.70]), np.diag([14.0, 18.0, 12.0])
    )
    root = np.sqrt(0.5)
    slideways = tuple(
        Slideway(
            f'slideway_{number}', 'knee', 'column', np.array(point), np.array(normal),
            np.array([0.0, 0.0, 1.0]), 0.40, 0.06,
            unknown(a_n * 1e13), unknown(a_t * 1e7), unknown(h_n * 1e7), unknown(h_t * 1e7),
            damping_frequency=40.0, exponent=2.0, preload=preload, coupled=coupled,
        )
        for number, point, normal, a_n, a_t, h_n, h_t, preload in (
            (6, (0.22, -0.17, 0.62), (-1.0, 0.0, 0.0), 380, 15, 3.6, 5.5, 0.6e-6),
            (7, (0.22, 0.17, 0.62), (-1.0, 0.0, 0.0), 370, 15, 3.5, 5.5, 0.6e-6),
            (8, (0.19, -0.19, 0.80), (root, root, 0.0), 340, 13, 2.7, 0.21, 0.6e-6),
            (9, (0.19, 0.19, 0.80), (root, -root, 0.0), 660, 27, 2.1, 7.7,
             0.6e-6 * np.sqrt(340 / 660)),
        )
    )  # fmt: skip
    screw = SpringDamper(
        'screw', 'knee', 'column', np.array([0.35, 0.0, 0.45]),
        frame_about(np.array([0.0, 0.0, 1.0]), 'screw'), known(1.2e8), known(8e3), kind='screw',
    )  # fmt: skip
    alpha, beta = np.radians([150.0, 76.0])
    exciter = ExcitationPoint(
        'exciter', 'knee', np.array([0.6, 0.1, 0.85]),
        np.array([np.cos(alpha) * np.sin(beta), np.sin(alpha) * np.sin(beta), np.cos(beta)]),
        'column', np.array([0.0, 0.0, 1.4]), 1000.0, 40.0, (5.0, 300.0),
    )  # fmt: skip
    return Machine('knee_and_column', (column(), knee), (*pads(), screw, *slideways), (exciter,))


def complete_layout(
    machine,
    displacement_noise=0.0,
    acceleration_noise=0.0,
    velocity_noise=0.0,
    kinds=tuple(SensorKind)[1:],
):
    """Put three-axis sensors of motion at three corners of every body, a cell on every exciter."""
    sensors = [
        Sensor(f'{point.name}_cell', SensorKind.FORCE, excitation=point.name, noise=0.0)
        for point in machine.excitations
    ]
    for body in machine.bodies:
        for kind in kinds:
            noise = {
                SensorKind.DISPLACEMENT: displacement_noise,
                SensorKind.VELOCITY: velocity_noise,
                SensorKind.ACCELERATION: acceleration_noise,
            }[kind]
            for i, corner in enumerate(((1, 1, 1), (-1, 1, -1), (1, -1, -1))):
                for axis in range(3):
                    sensors.append(Sensor(
                        f'{body.name}_{kind.value}_{i}{"xyz"[axis]}', kind, body.name,
                        body.centre_of_mass + 0.3 * np.array(corner), np.eye(3)[axis],
                        noise=noise,
                    ))  # fmt: skip
    return Layout(tuple(sensors))
