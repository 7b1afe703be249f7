# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Small gains, delays and wrong masses put the pointwise estimate in doubt; noise does not."""

from dataclasses import replace

from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.pointwise.pointwise_identifier import PointwiseIdentifier
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.core.machines import (
    blocks_of,
    chain,
    identified,
    known,
    line_layout,
    motion_of,
    oscillator,
    unknown,
)

RATE = 5000.0
F, D, A = SensorKind.FORCE, SensorKind.DISPLACEMENT, SensorKind.ACCELERATION
NOISE = {F: 0.02, D: 1e-8, SensorKind.VELOCITY: 0.0, A: 0.01}
LAYOUT = line_layout(kinds=(D, A), noise=NOISE)
FORCE_AND_DISPLACEMENT = replace(LAYOUT, sensors=LAYOUT.sensors[:2])
MODEL = assemble(oscillator(known(50.0), unknown(1e7), unknown(1e3)))  # 71 Hz, 2 % damping


def stand(model, layout, seconds=2.0, band=(10.0, 300.0)):
    """Return what perfect sensors read."""
    signal = multisine(50.0, band, 1.0, np.random.default_rng(3))
    perfect = layout.with_noise_times(0.0)
    return SimulatedStand(model, perfect, (signal,), RATE, 1, 1).read(int(seconds * RATE)).samples


def late(layout, delays):
    """Delay sensors by kind, which the other layout does not state."""
    return replace(
        layout,
        sensors=tuple(replace(one, delay=delays.get(one.kind, 0.0)) for one in layout.sensors),
    )


def noisy(samples, layout, seed=0):
    noise = np.array([sensor.noise for sensor in layout.sensors])
    return samples + noise * np.random.default_rng(seed).standard_normal(samples.shape)


def doubt(samples, layout=LAYOUT, model=MODEL):
    estimate = identified(model, layout, blocks_of(samples, RATE))
    doubted = {one.status is EstimateStatus.MODEL_IN_DOUBT for one in estimate.parameters}
    assert len(doubted) == 1
    return ' '.join(estimate.notes) if doubted.pop() else ''


@pytest.mark.parametrize(
    ('gains', 'said'),
    [
        ((1.0, 1.02, 1.0), 'measured rates are not those of the displacement'),
        ((1.0, 1.0, 0.99), 'measured rates are not those of the displacement'),
        ((1.005, 1.0, 1.0), 'residual goes with the force and the motion'),
        ((1.0, 1.005, 1.005), 'residual goes with the force and the motion'),
    ],
    ids=['displacement 2 %', 'acceleration 1 %', 'force 0.5 %', 'all motion 0.5 %'],
)
def test_gain_of_one_kind_of_sensor_is_seen(gains, said):
    assert said in doubt(noisy(stand(MODEL, LAYOUT) * gains, LAYOUT))


@pytest.mark.parametrize(
    ('delays', 'said'),
    [
        ({D: 50e-6}, 'measured rates are not those of the displacement'),
        ({A: 10e-6}, 'measured rates are not those of the displacement'),
        ({F: 10e-6}, 'residual goes with the force and the motion'),
    ],
    ids=['displacement 50 us', 'acceleration 10 us', 'force 10 us'],
)
def test_delay_of_one_kind_of_sensor_is_seen(delays, said):
    assert said in doubt(noisy(stand(MODEL, late(LAYOUT, delays)), LAYOUT))


def test_mass_one_percent_off_is_seen():
    stated = assemble(oscillator(known(50.5), unknown(1e7), unknown(1e3)))
    assert 'residual goes with' in doubt(noisy(stand(MODEL, LAYOUT), LAYOUT), model=stated)


def test_gains_that_all_unknowns_take_up_are_not_seen():
    # Twice the force and twice mass, stiffness and damping move alike: no data can tell.
    free = assemble(oscillator(unknown(50.0), unknown(1e7), unknown(1e3)))
    samples = noisy(stand(MODEL, LAYOUT) * (1.03, 1.0, 1.0), LAYOUT)
    assert not doubt(samples, model=free)


@pytest.mark.parametrize('layout', [LAYOUT, FORCE_AND_DISPLACEMENT], ids=['F d a', 'F d'])
@pytest.mark.parametrize('level', [1.0, 10.0])
def test_right_layout_is_doubted_in_about_one_percent_of_runs(layout, level):
    exact, layout = stand(MODEL, layout), layout.with_noise_times(level)
    alarms = sum(bool(doubt(noisy(exact, layout, seed), layout)) for seed in range(40))
    # More than three of 40 happen in 0.07 % of the cases at a rate of 1 %.
    assert alarms <= 3


def test_noise_that_the_layout_understates_a_little_is_no_contradiction():
    samples = noisy(stand(MODEL, LAYOUT), LAYOUT.with_noise_times(1.3))
    assert not doubt(samples)


def test_motion_of_two_bodies_is_compared_with_what_both_sensors_say():
    model = assemble(chain(make=unknown))
    layout = line_layout(('mass_1', 'mass_2'), (D, A), NOISE)
    exact = stand(model, layout)
    assert not doubt(noisy(exact, layout), layout, model)
    wrong = exact.copy()
    wrong[:, -1] *= 1.01
    assert doubt(noisy(wrong, layout), layout, model)


def test_missing_samples_are_left_out_of_the_comparison():
    samples = noisy(stand(MODEL, LAYOUT), LAYOUT)
    samples[np.random.default_rng(0).integers(0, len(samples), 40), 1] = np.nan
    assert not doubt(samples)


def test_comparison_survives_a_saved_state():
    samples = noisy(stand(MODEL, LAYOUT) * (1.0, 1.0, 0.99), LAYOUT)
    before, after = PointwiseIdentifier(MODEL), PointwiseIdentifier(MODEL)
    motion = motion_of(MODEL, LAYOUT, blocks_of(samples, RATE, (500,) * 20))
    for block in motion[:16]:
        before.add(block)
    after.restore(before.state)
    assert any('measured rates' in note for note in after.estimate().notes)
