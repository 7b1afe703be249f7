# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Probes between two bodies across a joint: from the stand to every estimator and diagnosis."""

from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.diagnosis import diagnose, Verdict
from identnl_ros.core.errors import LayoutError
from identnl_ros.core.likelihood.likelihood_estimate import likelihood_estimate
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.joints import GROUND, SpringDamper
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.simulation import Simulation
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.validation.agreement import Agreement
from identnl_ros.core.validation.validation import Validation
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
import numpy as np
import pytest

from tests.core.machines import (
    blocks_of,
    deviations_of,
    known,
    motion_of,
    truth_of,
    unknown,
    values_of,
    X,
    Z,
)

RATE = 2000.0
D, V, A, F = (
    SensorKind.DISPLACEMENT,
    SensorKind.VELOCITY,
    SensorKind.ACCELERATION,
    SensorKind.FORCE,
)
NOISE = {F: 0.0, D: 2e-8, V: 5e-6, A: 5e-3}
SIGNAL = multisine(60.0, (8.0, 160.0), 0.5, np.random.default_rng(6))
RELATIVE = (('gap_low', D, 0.75, 'bed'), ('gap_high', D, 0.9, 'bed'), ('slip', V, 0.82, 'bed'))


def machine():
    """Describe a head on a bed, both of which slide along x and rock about y."""
    motions = ('translation_1', 'rotation_2')
    parts = (('bed', 60.0, 0.3, (8.0, 6.0, 4.0)), ('head', 15.0, 0.9, (0.9, 0.7, 0.5)))
    bodies = tuple(
        Body(name, known(mass), height * Z, np.diag(moments), motions)
        for name, mass, height, moments in parts
    )
    joints = tuple(
        SpringDamper(
            name, body, other, height * Z, np.eye(3),
            (stiffness, *map(known, (1.0, 1.0, 1.0)), turning),
            (damping, *map(known, (0.0, 0.0, 0.0)), known(30.0)),
        )
        for name, body, other, height, stiffness, turning, damping in (
            ('feet', 'bed', GROUND, 0.0, known(4e6), known(2e6), known(1500.0)),
            ('rail', 'head', 'bed', 0.7, unknown(2e6), unknown(1e5), unknown(300.0)),
        )
    )  # fmt: skip
    shaker = ExcitationPoint('shaker', 'head', 1.1 * Z, X, amplitude=60.0, band=(8.0, 160.0))
    return Machine('stack', bodies, joints, (shaker,))


MODEL = assemble(machine())


def layout():
    """Bed against the ground; of the head only accelerations, and what it does to the bed."""
    sensors = [Sensor('cell', F, excitation='shaker', noise=NOISE[F])]
    for height in (0.1, 0.6):
        sensors.append(Sensor(f'bed_d{height}', D, 'bed', height * Z, X, noise=NOISE[D]))
    for name, kind, height, other in RELATIVE:
        sensors.append(Sensor(name, kind, 'head', height * Z, X, other, noise=NOISE[kind]))
    for body, height in (('bed', 0.1), ('bed', 0.6), ('head', 0.8), ('head', 1.0)):
        sensors.append(Sensor(f'{body}_a{height}', A, body, height * Z, X, noise=NOISE[A]))
    return Layout(tuple(sensors))


LAYOUT = layout()


def measured(actual=LAYOUT, declared=None, count=5000, seed=1):
    stand = SimulatedStand(MODEL, actual, (SIGNAL,), RATE, seed, 1, declared_layout=declared)
    return stand.read(count + 400).samples[400:]


def test_reading_is_the_motion_of_the_body_less_that_of_the_reference_at_the_same_point():
    clean = LAYOUT.with_noise_times(0)
    samples = SimulatedStand(MODEL, clean, (SIGNAL,), RATE, 1, 1).read(500).samples
    rest = np.zeros(4)
    motion = Simulation(MODEL, (SIGNAL,), 1 / RATE, rest, rest, 4).advance(500)
    for channel, (_, kind, height, _) in enumerate(RELATIVE, 3):
        bed_x, bed_turn, head_x, head_turn = motion[0 if kind is D else 1][0].T
        # Rotation about y moves what is above the centre along +x.
        head = head_x + (height - 0.9) * head_turn
        bed = bed_x + (height - 0.3) * bed_turn
        size = np.abs(head - bed).max()
        np.testing.assert_allclose(samples[:, channel], head - bed, rtol=0, atol=1e-6 * size)
        assert np.abs(head + bed).max() > 0.5 * size


def test_transform_sees_both_bodies_through_the_probes_between_them():
    clean = LAYOUT.with_noise_times(0)
    (motion,) = motion_of(MODEL, clean, blocks_of(measured(clean, count=800), RATE))
    absolute = Layout((
        LAYOUT.sensors[0],
        *(Sensor(f'{body}_{kind.value}{height}', kind, body, height * Z, X)
          for kind in (D, V, A) for body in ('bed', 'head') for height in (0.1, 0.9)),
    ))  # fmt: skip
    (expected,) = motion_of(MODEL, absolute, blocks_of(measured(absolute, count=800), RATE))
    begin = motion.first_index
    for name, exactness in (('displacement', 1e-12), ('velocity', 1e-7), ('acceleration', 1e-11)):
        found, same = getattr(motion, name), getattr(expected, name)[begin:]
        size = np.abs(found).max()
        np.testing.assert_allclose(found, same[: len(found)], rtol=0, atol=exactness * size)


def test_without_the_probes_across_the_joint_the_head_is_not_seen():
    blind = Layout(tuple(one for one in LAYOUT.sensors if 'gap' not in one.name))
    with pytest.raises(LayoutError, match='cannot see translation 1 of head, rotation 2 of head'):
        MotionTransform(MODEL, blind, RATE)


@pytest.mark.parametrize('estimator', ['weak', 'likelihood'])
def test_identification_covers_the_truth(estimator):
    samples = measured()
    start = MODEL.with_unknowns(1.15 * truth_of(MODEL))
    if estimator == 'likelihood':
        estimate = likelihood_estimate(start, [MeasuredRecord(LAYOUT, RATE, samples[:2500])])
    else:
        identifier = WeakIdentifier(start)
        for motion in motion_of(MODEL, LAYOUT, blocks_of(samples, RATE)):
            identifier.add(motion)
        estimate = identifier.estimate()
    errors = (values_of(estimate) - truth_of(MODEL)) / deviations_of(estimate)
    assert np.abs(errors).max() < 4
    assert np.max(deviations_of(estimate) / truth_of(MODEL)) < 0.02


def test_validation_tells_a_probe_whose_bodies_are_the_wrong_way_round():
    size = len(truth_of(MODEL))
    reversed_ = replace(LAYOUT, sensors=tuple(
        replace(one, body='bed', reference_body='head') if one.name == 'slip' else one
        for one in LAYOUT.sensors
    ))  # fmt: skip
    for actual, agrees in ((LAYOUT, True), (reversed_, False)):
        run = Validation(MODEL, np.zeros((size, size)), LAYOUT, RATE)
        run.add(MeasuredRecord(LAYOUT, RATE, measured(actual, LAYOUT, 2000)))
        assert Agreement((run.comparison(),)).agrees is agrees


@pytest.mark.parametrize('name', ['', 'gap_high'])
def test_diagnosis_predicts_the_probes_and_names_the_one_that_is_wrong(name):
    actual = replace(LAYOUT, sensors=tuple(
        replace(one, gain=1.04) if one.name == name else one for one in LAYOUT.sensors
    ))  # fmt: skip
    found = diagnose(
        Description(machine(), LAYOUT), MODEL.with_unknowns(1.1 * truth_of(MODEL)),
        MeasuredRecord(LAYOUT, RATE, measured(actual, LAYOUT, 3072), first_index=400),
    )  # fmt: skip
    if not name:
        assert found.verdict is Verdict.COMPLETE
        return
    assert found.verdict is Verdict.EXPLAINED
    assert [one.hypothesis.key for one in found.named] == [('sensor_gain', name)]
    assert found.named[0].size == pytest.approx(0.04, rel=0.1)
