# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Records and runs that the tests of the weak identifier share."""

from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine, sine
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
import numpy as np

from tests.core.machines import (
    blocks_of,
    known,
    line_layout,
    motion_of,
    oscillator,
    slideway,
    unknown,
    X,
    Z,
)

RATE = 2000.0
SETTLING = 400
D, V, A, F = (
    SensorKind.DISPLACEMENT,
    SensorKind.VELOCITY,
    SensorKind.ACCELERATION,
    SensorKind.FORCE,
)
NOISE = {F: 0.0, D: 2e-8, V: 5e-6, A: 2e-3}
LAYOUT = line_layout(kinds=(D, A), noise=NOISE)
# The cubic part is as large as the linear one at 9 um; the motion is 5 um.
OSCILLATOR = assemble(oscillator(None, unknown(4e5), unknown(200.0), None, unknown(5e15)))
SLIDING = assemble(
    oscillator(
        stiffness=known(1e5),
        damping=known(20.0),
        more_joints=(
            slideway(
                normal=X, longitudinal=Z, normal_stiffness=unknown(4e11), coupled=False,
                preload=3e-6, normal_damping=unknown(400.0),
            ),
        ),
    )
)  # fmt: skip
MULTISINE = multisine(10.0, (5.0, 80.0), 0.5, np.random.default_rng(3))
SINE = sine(20.0, 23.0)


def exact(model=OSCILLATOR, layout=LAYOUT, signal=MULTISINE, count=2400, rate=RATE):
    """Return what perfect sensors read, after the transient."""
    stand = SimulatedStand(model, layout.with_noise_times(0.0), (signal,), rate, 1, 1)
    return stand.read(count + SETTLING).samples[SETTLING:]


def noisy(samples, layout=LAYOUT, seed=1):
    """Add the noise that a layout states."""
    noise = np.array([sensor.noise for sensor in layout.sensors])
    return samples + noise * np.random.default_rng(seed).standard_normal(samples.shape)


def forgetful(model):
    """Blank the true values; preloads and exponents are needed to start from."""
    values = model.values
    for i in model.estimated:
        if not model.parameters[i].inner:
            values[i] = np.nan
    return model.with_values(values)


def identifier_of(samples, model=OSCILLATOR, layout=LAYOUT, sizes=(), rate=RATE, memory=None):
    """Return an identifier that has seen a record."""
    identifier = WeakIdentifier(forgetful(model), memory)
    feed(identifier, samples, model, layout, sizes, rate)
    return identifier


def feed(identifier, samples, model=OSCILLATOR, layout=LAYOUT, sizes=(), rate=RATE, stream_id=1):
    for motion in motion_of(model, layout, blocks_of(samples, rate, sizes, stream_id=stream_id)):
        identifier.add(motion)


def statuses(estimate):
    return {parameter.status for parameter in estimate.parameters}
