# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Small machines, rotations and runs that the tests of the core share."""

from dataclasses import replace
from itertools import pairwise

from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.joints import Coefficient, GROUND, Slideway, SpringDamper
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.pointwise.pointwise_identifier import PointwiseIdentifier
import numpy as np
from scipy.spatial.transform import Rotation

X = np.array([1.0, 0.0, 0.0])
Y = np.array([0.0, 1.0, 0.0])
Z = np.array([0.0, 0.0, 1.0])
ORIGIN = np.zeros(3)


def known(value):
    return Coefficient(float(value))


def unknown(value=float('nan')):
    return Coefficient(float(value), estimated=True)


def oscillator(
    mass=None,
    stiffness=None,
    damping=None,
    quadratic=None,
    cubic=None,
    forces=(),
    gravity=None,
    more_joints=(),
):
    """One body that moves along x on a spring; coefficients that are not given are known."""
    body = Body('block', mass or known(10.0), ORIGIN, None, ('translation_1',))
    spring = SpringDamper(
        'spring',
        'block',
        GROUND,
        ORIGIN,
        np.eye(3),
        (stiffness or known(4e5),),
        (damping or known(200.0),),
        (quadratic,) if quadratic else (),
        (cubic,) if cubic else (),
    )
    exciter = ExcitationPoint('exciter', 'block', ORIGIN, X)
    return Machine('oscillator', (body,), (spring, *more_joints), (exciter,), forces, gravity)


def chain(masses=(5.0, 3.0), stiffnesses=(2e5, 1e5), dampings=(50.0, 30.0), make=known):
    """Ground, spring 1, body 1, spring 2, body 2, along x; the exciter acts on body 1."""
    bodies = tuple(
        Body(f'mass_{i}', known(mass), ORIGIN, None, ('translation_1',))
        for i, mass in enumerate(masses, 1)
    )
    joints = tuple(
        SpringDamper(
            f'spring_{i}',
            f'mass_{i}',
            GROUND if i == 1 else f'mass_{i - 1}',
            ORIGIN,
            np.eye(3),
            (make(stiffness),),
            (make(damping),),
        )
        for i, (stiffness, damping) in enumerate(zip(stiffnesses, dampings, strict=True), 1)
    )
    return Machine('chain', bodies, joints, (ExcitationPoint('exciter', 'mass_1', ORIGIN, X),))


def slideway(name='slide', body='block', other=GROUND, point=ORIGIN, normal=-Z, **changes):
    """Build a slideway with round numbers and, by default, no damping."""
    settings = {
        'longitudinal': X,
        'length': 0.4,
        'width': 0.06,
        'normal_stiffness': known(4e15),
        'tangential_stiffness': known(1.5e8),
        'normal_damping': known(0.0),
        'tangential_damping': known(0.0),
        'exponent': 2.0,
        'preload': 0.6e-6,
        'coupled': True,
    }
    return Slideway(name, body, other, np.asarray(point), normal, **(settings | changes))


def skew_machine(grounded=True, gravity=None):
    """Two bodies whose principal axes are far off the machine's, all kinds of joints."""
    rotations = Rotation.from_rotvec([[0.5, -0.3, 0.7], [-0.4, 0.6, 0.35]]).as_matrix()
    bodies = tuple(
        Body(name, known(mass), np.array(centre), turn @ np.diag(moments) @ turn.T)
        for name, mass, centre, moments, turn in zip(
            ('bed', 'saddle'),
            (400.0, 120.0),
            ((0.1, -0.05, 0.3), (0.2, 0.1, 0.75)),
            ((20.0, 35.0, 42.0), (3.0, 7.0, 8.5)),
            rotations,
            strict=True,
        )
    )
    pads = tuple(
        SpringDamper(
            f'pad_{i}',
            'bed',
            GROUND,
            np.array([x, y, 0.0]),
            np.eye(3),
            (known(1e7), known(1.2e7), known(3e7)),
            (known(5e3), known(6e3), known(1.5e4)),
        )
        for i, (x, y) in enumerate(((-0.4, -0.3), (0.5, -0.3), (0.05, 0.4)))
    )
    turn = Rotation.from_rotvec([0.2, 0.3, -0.5]).as_matrix()
    spring = SpringDamper(
        'rail',
        'saddle',
        'bed',
        np.array([0.15, 0.2, 0.6]),
        turn,
        tuple(known(value) for value in (5e7, 4e7, 3e7, 2e5, 3e5, 1e5)),
        tuple(known(value) for value in (2e3, 1e3, 3e3, 20.0, 30.0, 10.0)),
        (known(0.0), known(2e12)),
        (known(1e18),),
    )
    slides = tuple(
        slideway(
            f'slide_{i}',
            'saddle',
            'bed',
            np.array(point),
            normal,
            longitudinal=Y,
            coupled=coupled,
            normal_damping=known(3e7),
            tangential_damping=known(4e7),
            damping_frequency=40.0,
        )
        for i, (point, normal, coupled) in enumerate(
            (((0.1, 0.05, 0.5), -Z, True), ((0.3, 0.1, 0.55), -(X + Z), False))
        )
    )
    exciter = ExcitationPoint(
        'exciter', 'saddle', np.array([0.4, 0.2, 0.9]), np.array([1.0, 2.0, -1.0]),
        'bed', np.array([0.0, 0.3, 0.2]),
    )  # fmt: skip
    joints = (*(pads if grounded else ()), spring, *slides)
    return Machine('skew', bodies, joints, (exciter,), (), gravity)


def turned(machine, rotation):
    """Return the same machine described in a frame that is turned."""

    def vectors(part, *names):
        return replace(part, **{
            name: rotation @ getattr(part, name)
            for name in names if getattr(part, name) is not None
        })  # fmt: skip

    bodies = tuple(
        replace(
            vectors(body, 'centre_of_mass'),
            inertia=None if body.inertia is None else rotation @ body.inertia @ rotation.T,
        )
        for body in machine.bodies
    )
    joints = tuple(
        vectors(joint, 'point', 'normal', 'longitudinal')
        if isinstance(joint, Slideway)
        else vectors(joint, 'point', 'axes')
        for joint in machine.joints
    )
    excitations = tuple(
        vectors(point, 'point', 'direction', 'reaction_point') for point in machine.excitations
    )
    forces = tuple(vectors(force, 'point', 'direction') for force in machine.forces)
    gravity = None if machine.gravity is None else rotation @ machine.gravity
    return replace(
        machine,
        bodies=bodies, joints=joints, excitations=excitations, forces=forces, gravity=gravity,
    )  # fmt: skip


def line_layout(bodies=('block',), kinds=tuple(SensorKind)[1:], noise=0.0, **changes):
    """Force cell, and one sensor of every kind along x on every body."""
    noises = noise if isinstance(noise, dict) else dict.fromkeys(SensorKind, noise)
    sensors = [
        Sensor('cell', SensorKind.FORCE, excitation='exciter', noise=noises[SensorKind.FORCE])
    ]
    for body in bodies:
        for kind in kinds:
            sensors.append(Sensor(f'{body}_{kind.value}', kind, body, noise=noises[kind]))
    return Layout(tuple(replace(sensor, **changes) for sensor in sensors))


def blocks_of(samples, rate, sizes=(), last=True, stream_id=1, stamp_ns=0):
    """Cut a record into blocks of the given sizes, the rest into one more."""
    edges = np.clip(np.concatenate(([0], np.cumsum(sizes), [len(samples)])), 0, len(samples))
    edges = np.unique(edges.astype(int))
    return [
        SampleBlock(
            stream_id,
            stamp_ns + round(start / rate * 1e9),
            int(start),
            rate,
            samples[start:end],
            np.isnan(samples[start:end]).any(axis=0).astype(np.uint8),
            last and end == len(samples),
        )
        for start, end in pairwise(edges)
    ]


def motion_of(model, layout, blocks):
    """Return the motion blocks of a record."""
    transform = MotionTransform(model, layout, blocks[0].sample_rate)
    found = (transform.add(block) for block in blocks)
    return [motion for motion in found if motion is not None]


def identified(model, layout, blocks):
    """Return the estimate from a record."""
    identifier = PointwiseIdentifier(model)
    for motion in motion_of(model, layout, blocks):
        identifier.add(motion)
    return identifier.estimate()


def values_of(estimate):
    return np.array([parameter.value for parameter in estimate.parameters])


def deviations_of(estimate):
    return np.array([parameter.standard_deviation for parameter in estimate.parameters])


def truth_of(model):
    return model.values[list(model.estimated)]
