# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A layout that sees everything, for machines that have none of their own."""

from collections.abc import Iterator

from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.mechanics.machine import Machine
import numpy as np

# Distance of the sensors from the centre of mass along each machine axis [m].
ARM = 0.3
CORNERS = ((1, 1, 1), (-1, 1, -1), (1, -1, -1))
# White noise of good laboratory sensors at 10 kHz: probe, vibrometer, accelerometer.
TYPICAL_NOISE = {
    SensorKind.FORCE: 0.2,
    SensorKind.DISPLACEMENT: 10e-9,
    SensorKind.VELOCITY: 2e-6,
    SensorKind.ACCELERATION: 0.01,
}
MOTION_KINDS = (SensorKind.DISPLACEMENT, SensorKind.VELOCITY, SensorKind.ACCELERATION)


def complete_layout(
    machine: Machine,
    noise: dict[SensorKind, float] = TYPICAL_NOISE,
    motion_kinds: tuple[SensorKind, ...] = MOTION_KINDS,
) -> Layout:
    """
    Put three-axis sensors of motion at three corners of every body, a cell on every exciter.

    Parameters
    ----------
    machine : Machine
    noise : dict
        Standard deviation of one sample of each kind of sensor [SI unit].
    motion_kinds : tuple of SensorKind
        Kinds of motion that are measured.

    Returns
    -------
    Layout

    """
    return Layout(tuple(_sensors(machine, noise, motion_kinds)), stand=machine.name)


def _sensors(
    machine: Machine, noise: dict[SensorKind, float], motion_kinds: tuple[SensorKind, ...]
) -> Iterator[Sensor]:
    for exciter in machine.excitations:
        yield Sensor(
            f'{exciter.name}_force',
            SensorKind.FORCE,
            excitation=exciter.name,
            noise=noise[SensorKind.FORCE],
        )
    for body in machine.bodies:
        for kind in motion_kinds:
            for number, corner in enumerate(CORNERS, start=1):
                for axis, letter in enumerate('xyz'):
                    yield Sensor(
                        f'{body.name}_{kind.value}_{number}{letter}',
                        kind,
                        body.name,
                        body.centre_of_mass + ARM * np.array(corner),
                        np.eye(3)[axis],
                        noise=noise[kind],
                    )
