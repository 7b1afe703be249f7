# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""An estimate that cannot be trusted says so, whatever the reason."""

from dataclasses import replace

from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.pointwise.pointwise_identifier import PointwiseIdentifier
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.reference_machines import complete_layout, knee_and_column

MACHINE = knee_and_column()
MODEL = assemble(MACHINE)
TRUTH = MODEL.values[list(MODEL.estimated)]


def layout(factor):
    """Lay out sensors of a fraction of the nominal noise."""
    return complete_layout(MACHINE, 1e-8 * factor, 0.01 * factor, 2e-6 * factor)


def feed(identifier, actual, declared, seconds=0.5, stream_id=1):
    """Run a stand with the actual sensors, read it with the declared ones."""
    signal = multisine(1000.0, (5, 300), 1.0, np.random.default_rng(0))
    stand = SimulatedStand(MODEL, actual, (signal,), 1e4, stream_id, stream_id, 0, declared)
    transform = MotionTransform(MODEL, declared, 1e4)
    blocks = round(seconds * 100)
    for number in range(blocks):
        motion = transform.add(stand.read(100, last=number == blocks - 1))
        if motion is not None:
            identifier.add(motion)


def changed(place, **values):
    """Change one sensor of a quiet layout."""
    quiet = layout(0.01)
    return replace(
        quiet,
        sensors=tuple(
            replace(sensor, **values) if i == place else sensor
            for i, sensor in enumerate(quiet.sensors)
        ),
    )


def late(kind, delay):
    quiet = layout(0.01)
    return replace(
        quiet,
        sensors=tuple(
            replace(sensor, delay=delay) if sensor.kind is kind else sensor
            for sensor in quiet.sensors
        ),
    )


@pytest.mark.parametrize(
    'actual',
    [
        changed(5, gain=1.02),
        changed(5, gain=-1.0),
        late(SensorKind.ACCELERATION, 25e-6),
        layout(0.03),
    ],
    ids=['gain 2 % off', 'wrong polarity', 'delay of 25 us', 'three times the stated noise'],
)
def test_wrong_layout_puts_the_model_in_doubt(actual):
    identifier = PointwiseIdentifier(MODEL)
    feed(identifier, actual, layout(0.01))
    estimate = identifier.estimate()
    assert {one.status for one in estimate.parameters} == {EstimateStatus.MODEL_IN_DOUBT}
    assert 'residual' in estimate.notes[0]


@pytest.mark.parametrize('factor', [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0])
def test_right_layout_does_not(factor):
    identifier = PointwiseIdentifier(MODEL)
    feed(identifier, layout(factor), layout(factor))
    found = {one.status for one in identifier.estimate().parameters}
    assert EstimateStatus.MODEL_IN_DOUBT not in found


@pytest.mark.parametrize('factors', [(1.0, 1e-3), (1e-3, 1.0)])
def test_quiet_stream_does_not_hide_the_noise_of_another(factors):
    identifier = PointwiseIdentifier(MODEL)
    for stream_id, factor in enumerate(factors, start=1):
        feed(identifier, layout(factor), layout(factor), stream_id=stream_id)
    for parameter, truth in zip(identifier.estimate().parameters, TRUTH, strict=True):
        if parameter.status is EstimateStatus.OK:
            assert abs(parameter.value - truth) < 5 * parameter.standard_deviation


def test_reset_forgets_which_stream_the_data_came_from():
    identifier = PointwiseIdentifier(MODEL)
    feed(identifier, layout(0.0), layout(0.0), seconds=0.3)
    first = identifier.estimate()
    feed(identifier, layout(0.0), layout(0.0), seconds=0.3)
    assert identifier.samples == first.samples, 'the same data do not count twice'
    identifier.reset()
    feed(identifier, layout(0.0), layout(0.0), seconds=0.3)
    assert identifier.estimate().parameters == first.parameters


def test_ended_stream_may_be_replayed_from_its_beginning_only():
    follower = StreamFollower(replays=True)
    assert follower.accept(7, 0, 10, False) is Arrival.FIRST
    assert follower.accept(7, 10, 20, True) is Arrival.IN_ORDER
    assert follower.accept(7, 10, 20, True) is Arrival.REPEATED
    assert follower.accept(7, 0, 10, False) is Arrival.FIRST
    assert follower.accept(7, 10, 20, True) is Arrival.IN_ORDER
