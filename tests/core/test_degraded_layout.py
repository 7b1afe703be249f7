# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Missing samples and lost channels: what the other sensors tell, how well, and what it cost."""

from dataclasses import replace

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.alignment import HALF_WIDTH
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.pointwise.pointwise_identifier import PointwiseIdentifier
import numpy as np
import pytest
from scipy.stats import chi2

from tests.core.machines import (
    blocks_of,
    deviations_of,
    line_layout,
    motion_of,
    oscillator,
    skew_machine,
    truth_of,
    unknown,
    values_of,
)
from tests.core.weak_runs import exact, identifier_of, noisy
from tests.reference_machines import complete_layout

RATE = 2000.0
F, D, V, A = SensorKind
MACHINE = skew_machine()
MODEL = assemble(MACHINE)
LAYOUT = complete_layout(MACHINE, 1e-8, 2e-3, 2e-6)
NAMES = [sensor.name for sensor in LAYOUT.sensors]
QUANTITIES = {'displacement': D, 'velocity': V, 'acceleration': A}
# Of every coordinate and instant, far above the noise.
MOTION = np.random.default_rng(8).standard_normal((3, 700, len(MODEL.coordinates)))
MOTION *= np.array([1e-6, 1e-4, 1e-1])[:, np.newaxis, np.newaxis]


def readings(layout=LAYOUT, seed=1, factor=1.0, model=MODEL, motion=MOTION):
    """Return what noisy sensors read of an arbitrary motion, and 100 N of force."""
    count = motion.shape[1]
    samples = np.full((count, len(layout.sensors)), 100.0)
    for channel, sensor in enumerate(layout.sensors):
        if sensor.kind is not F:
            order = (D, V, A).index(sensor.kind)
            samples[:, channel] = motion[order] @ sensor_matrix(model, (sensor,))[0]
    noise = np.array([sensor.noise for sensor in layout.sensors])
    return samples + factor * noise * np.random.default_rng(seed).standard_normal(samples.shape)


def with_losses(samples, probability, seed=2):
    lost = np.random.default_rng(seed).random(samples.shape) < probability
    return np.where(lost, np.nan, samples)


def whole(motions, name):
    return np.concatenate([getattr(motion, name) for motion in motions])


def transformed(samples, layout=LAYOUT, sizes=(), model=MODEL, without=()):
    transform = MotionTransform(model, layout, RATE, without)
    found = [transform.add(block) for block in blocks_of(samples, RATE, sizes)]
    return transform, [motion for motion in found if motion is not None]


def unequal(layout):
    """Give every sensor another noise."""
    sizes = np.random.default_rng(4).uniform(0.5, 3.0, len(layout.sensors))
    sensors = zip(layout.sensors, sizes, strict=True)
    return replace(layout, sensors=tuple(replace(s, noise=f * s.noise) for s, f in sensors))


@pytest.mark.parametrize('name', QUANTITIES)
def test_every_instant_is_the_least_squares_fit_to_its_valid_sensors(name):
    layout = unequal(LAYOUT)
    samples = with_losses(readings(layout), 0.08)
    _, motions = transformed(samples, layout)
    found = whole(motions, name)
    channels = list(layout.of_kind(QUANTITIES[name]))
    sensors = tuple(layout.sensors[i] for i in channels)
    rows = sensor_matrix(MODEL, sensors)
    noise = np.array([sensor.noise for sensor in sensors])
    partial = 0
    for instant, reading in enumerate(samples[:, channels]):
        valid = np.isfinite(reading)
        # One body at a time: the sensors of a body tell its motion, whatever the other's do.
        for body in ('bed', 'saddle'):
            own = [c.body == body for c in MODEL.coordinates]
            used = valid & np.array([sensor.body == body for sensor in sensors])
            scaled = rows[np.ix_(used, own)] / noise[used, np.newaxis]
            lengths = np.linalg.norm(scaled, axis=0)
            solution, _, rank, _ = np.linalg.lstsq(
                scaled / lengths, reading[used] / noise[used], rcond=1e-9
            )
            if rank == sum(own):
                partial += not valid.all()
                np.testing.assert_allclose(
                    found[instant, own] * lengths, solution, rtol=1e-9, atol=1e-9
                )
            else:
                assert np.isnan(found[instant, own]).any()
    assert partial > 500


def test_where_nothing_is_missing_not_a_bit_changes():
    samples = readings()
    lost = samples.copy()
    lost[300:303, 5] = np.nan
    _, one = transformed(samples)
    _, other = transformed(lost)
    for name in (*QUANTITIES, 'force'):
        a, b = whole(one, name), whole(other, name)
        changed = (a != b).any(axis=1)
        assert set(np.flatnonzero(changed)) <= {300, 301, 302}
        assert changed.any() == (LAYOUT.sensors[5].kind is QUANTITIES.get(name))


def test_one_of_two_force_cells_may_fail():
    cell = replace(LAYOUT.sensors[0], name='second_cell')
    layout = replace(LAYOUT, sensors=(*LAYOUT.sensors, cell))
    samples = readings(layout)
    samples[:, -1] += 2.0
    lost = samples.copy()
    lost[100:, 0] = np.nan
    (whole_one,), (found,) = (transformed(one, layout)[1] for one in (samples, lost))
    np.testing.assert_allclose(found.force, whole_one.force, rtol=1e-12)
    lost[200, -1] = np.nan
    _, (found,) = transformed(lost, layout)
    assert np.isnan(found.force[200]).any()
    assert np.isfinite(found.force[:200]).all()


def test_covariances_are_those_of_the_sensors_left():
    # Noise alone, of a layout whose acceleration is derived; a sensor of each kind is dead.
    sensors = [s for s in LAYOUT.sensors if s.kind is not A]
    layout = unequal(Layout(tuple(sensors)))
    samples = readings(layout, motion=np.zeros((3, 40000, len(MODEL.coordinates))))
    for kind in (D, V):
        samples[:, layout.of_kind(kind)[3]] = np.nan
    _, (found,) = transformed(samples, layout)
    usual = MotionTransform(MODEL, layout, RATE).displacement_covariance
    assert (np.diag(found.displacement_covariance) / np.diag(usual)).max() > 1.3
    for name in QUANTITIES:
        spread = np.cov(getattr(found, name).T)
        sizes = np.sqrt(np.diag(spread))
        stated = getattr(found, f'{name}_covariance')
        np.testing.assert_allclose(
            stated / np.outer(sizes, sizes), spread / np.outer(sizes, sizes), atol=0.05
        )


def test_covariance_is_the_average_over_the_instants_of_a_block():
    count = 60000
    samples = with_losses(readings(motion=np.zeros((3, count, len(MODEL.coordinates)))), 0.05)
    _, (found,) = transformed(samples)
    known = np.isfinite(found.displacement).all(axis=1)
    spread = found.displacement[known].T @ found.displacement[known] / known.sum()
    np.testing.assert_allclose(np.diag(found.displacement_covariance), np.diag(spread), rtol=0.04)


# --- no steps ---------------------------------------------------------------------------------


OFFSET, NOISE = 1e-6, 1e-8


def largest_step(samples, sizes, dead_from):
    """Compare with the motion from all sensors: largest difference, over its own noise."""
    lost = samples.copy()
    channel = LAYOUT.of_kind(D)[4]
    if dead_from:
        lost[dead_from:, channel] = np.nan
    else:
        lost[50::37, channel] = np.nan
    lost[400::90, LAYOUT.of_kind(D)[1]] = np.nan
    transform, motions = transformed(samples, sizes=sizes)
    deviation = np.sqrt(np.diag(transform.displacement_covariance))
    found = whole(transformed(lost, sizes=sizes)[1], 'displacement')
    return np.max(np.abs(found - whole(motions, 'displacement')) / deviation)


@pytest.mark.parametrize('sizes', [(), [50] * 13])
@pytest.mark.parametrize('dead_from', [0, 100])
def test_unknown_offset_makes_no_step_where_its_sensor_drops_out_or_dies(sizes, dead_from):
    samples = readings()
    channel = LAYOUT.of_kind(D)[4]
    samples[:, channel] += OFFSET
    samples[:, LAYOUT.of_kind(D)[1]] -= OFFSET
    # Without that the offset would show as a hundred times the noise.
    assert largest_step(samples, sizes, dead_from) < 8


def test_where_offsets_are_as_stated_nothing_is_subtracted():
    samples = readings(motion=np.zeros((3, 700, len(MODEL.coordinates))))
    samples[600:, LAYOUT.of_kind(D)[2]] = np.nan
    left_out = Layout(tuple(s for i, s in enumerate(LAYOUT.sensors) if i != LAYOUT.of_kind(D)[2]))
    expected = motion_of(
        MODEL, left_out, blocks_of(np.delete(samples, LAYOUT.of_kind(D)[2], 1), RATE)
    )
    _, (found,) = transformed(samples)
    np.testing.assert_allclose(
        found.displacement[600:], expected[0].displacement[600:], rtol=0, atol=1e-14
    )


@pytest.mark.parametrize('sizes', [[1] * 700, [64] * 11, [3, 200, 17]])
def test_cutting_into_blocks_changes_nothing(sizes):
    layout = replace(
        LAYOUT,
        sensors=tuple(
            replace(s, delay=0.4 / RATE) if i % 7 == 3 else s
            for i, s in enumerate(LAYOUT.sensors)
            if s.kind is not V
        ),
    )
    samples = with_losses(readings(layout), 5e-3)
    samples[:, layout.of_kind(D)[4]] += OFFSET
    samples[350:, layout.of_kind(D)[0]] = np.nan
    _, one = transformed(samples, layout)
    _, other = transformed(samples, layout, sizes)
    for name in (*QUANTITIES, 'force'):
        a, b = whole(one, name), whole(other, name)
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * np.nanmax(np.abs(a)))


# --- rates, and what is no longer seen ----------------------------------------------------------

ONE = assemble(oscillator())
LINE = line_layout(kinds=(D, A), noise={F: 0.1, D: 1e-8, V: 1e-6, A: 1e-2})
TIME = np.arange(1600) / RATE
SMOOTH = np.stack(
    [1e-5 * w * np.sin(2 * np.pi * 20 * TIME + p) for w, p in zip(
        (2 * np.pi * 20) ** np.arange(3), (0, np.pi / 2, np.pi), strict=True
    )]
)[:, :, np.newaxis]  # fmt: skip


def test_rate_whose_only_sensor_is_lost_is_derived_as_by_the_layout_without_it():
    samples = readings(LINE, model=ONE, motion=SMOOTH)
    samples[500:503, 2] = np.nan  # short
    samples[800:, 2] = np.nan
    transform, motions = transformed(samples, LINE, [50] * 32, model=ONE)
    acceleration, index = (
        whole(motions, 'acceleration')[:, 0],
        np.concatenate([np.arange(one.first_index, one.next_index) for one in motions]),
    )
    derived = np.concatenate(
        [np.full(len(one.force), one.acceleration_derived) for one in motions]
    )
    lost = index[np.isnan(acceleration)]
    first = index[derived].min()
    # For 0.1 s nobody can know that it will not come back; then derivatives need neighbours.
    assert set(lost) == {500, 501, 502, *range(800, index[~derived].max() + 1)}
    assert 800 + 0.1 * RATE - 50 <= first - HALF_WIDTH <= 800 + 0.1 * RATE
    without = Layout(LINE.sensors[:2])
    alone = motion_of(ONE, without, blocks_of(samples[:, :2], RATE))
    (expected,) = alone
    np.testing.assert_allclose(
        acceleration[derived], expected.acceleration[first - HALF_WIDTH :, 0], rtol=1e-12
    )
    np.testing.assert_allclose(
        motions[-1].acceleration_covariance, expected.acceleration_covariance, rtol=1e-12
    )
    # There is a gap, so that nobody takes both for one run.
    assert max(np.diff(index)) == HALF_WIDTH + 1 + HALF_WIDTH
    (sentence,) = [one for one in transform.degradation if 'block_acceleration' in one]
    assert 'differentiated' in sentence
    unseen = [one for one in transform.degradation if 'not visible' in one]
    assert f'at {len(lost)} of {len(index)} instants' in unseen[0]


def test_lost_sensor_that_comes_back_is_used_again():
    samples = readings(LINE, model=ONE, motion=SMOOTH)
    samples[300:800, 2] = np.nan
    _, motions = transformed(samples, LINE, [50] * 32, model=ONE)
    assert not motions[-1].acceleration_derived
    assert any(one.acceleration_derived for one in motions)
    end = motions[-1]
    assert np.isfinite(end.acceleration).all()
    np.testing.assert_array_equal(
        end.acceleration[:, 0], samples[end.first_index : end.next_index, 2]
    )


def test_what_no_sensor_left_sees_is_told_and_the_other_body_is_still_known():
    samples = readings()
    own = [i for i in LAYOUT.of_kind(D) if LAYOUT.sensors[i].body == 'saddle']
    samples[100:, own[:4]] = np.nan
    transform, motions = transformed(samples, sizes=[50] * 14)
    displacement = whole(motions, 'displacement')[100:]
    saddle = np.array([one.body == 'saddle' for one in MODEL.coordinates])
    assert np.isnan(displacement[:, saddle]).any(axis=1).all()
    assert np.isfinite(displacement[:, ~saddle]).all()
    text = ' '.join(transform.degradation)
    assert 'saddle' in text
    assert 'too little is seen' in text
    assert 'at 600 of' in text


def test_loss_of_all_channels_is_told_without_their_names():
    samples = readings()
    samples[100:400] = np.nan
    transform, _ = transformed(samples, sizes=[50] * 14)
    sentence, *_ = transform.degradation
    assert sentence == f'all channels: no readings for {300 / RATE:.3g} s (300 of 700 samples)'


def test_cost_of_a_dead_sensor_is_the_growth_of_the_standard_deviation():
    channel = LAYOUT.of_kind(D)[0]
    samples = readings()
    samples[:, channel] = np.nan
    transform, motions = transformed(samples, sizes=[100] * 7)
    (sentence,) = transform.degradation
    usual = np.diag(MotionTransform(MODEL, LAYOUT, RATE).displacement_covariance)
    growth = np.sqrt(np.diag(motions[-1].displacement_covariance) / usual)
    assert NAMES[channel] in sentence
    assert MODEL.coordinates[int(np.argmax(growth))].in_words in sentence
    assert f'{growth.max():.3g} times' in sentence


# --- sensors that are ignored -------------------------------------------------------------------


def test_ignored_sensors_are_as_if_they_did_not_exist():
    channels = [LAYOUT.of_kind(kind)[1] for kind in (D, V)] + list(LAYOUT.of_kind(A))
    samples = readings()
    samples[:, channels] = 1e3  # they show anything
    names = [NAMES[i] for i in channels]
    transform, found = transformed(samples, without=names)
    left = Layout(tuple(s for s in LAYOUT.sensors if s.name not in names))
    expected = motion_of(MODEL, left, blocks_of(np.delete(samples, channels, 1), RATE))
    for name in (*QUANTITIES, 'force'):
        np.testing.assert_array_equal(whole(found, name), whole(expected, name))
        covariance = f'{name}_covariance'
        np.testing.assert_array_equal(
            getattr(found[0], covariance), getattr(expected[0], covariance)
        )
    assert transform.derived == ('acceleration',)
    assert f'{names[0]}' in transform.degradation[0]
    assert 'ignored' in transform.degradation[0]


def test_ignoring_what_is_needed_or_does_not_exist_is_refused():
    saddle = [s.name for s in LAYOUT.sensors if s.kind is D and s.body == 'saddle']
    with pytest.raises(LayoutError, match=rf'of saddle.*ignored: {saddle[0]}'):
        MotionTransform(MODEL, LAYOUT, RATE, saddle)
    with pytest.raises(LayoutError, match='no force sensor measures'):
        MotionTransform(MODEL, LAYOUT, RATE, [LAYOUT.sensors[0].name])
    with pytest.raises(LayoutError, match=f'did you mean {saddle[0]}'):
        MotionTransform(MODEL, LAYOUT, RATE, [saddle[0] + 'x'])


# --- estimators -------------------------------------------------------------------------------

LINEAR = assemble(oscillator(None, unknown(4e5), unknown(200.0)))
PROBE = Sensor('coarse', D, 'block', noise=6e-8)
TWO_PROBES = line_layout(kinds=(D,), noise={F: 0.0, D: 1e-8})
TWO_PROBES = replace(TWO_PROBES, sensors=(*TWO_PROBES.sensors, PROBE))


@pytest.mark.parametrize('stated', [True, False])
def test_weak_estimator_weighs_what_is_left_of_a_layout_by_its_own_noise(stated):
    samples = exact(LINEAR, TWO_PROBES, count=4096)
    half, scores = 2048, []
    sensors = tuple(
        replace(one, noise=one.noise if stated else np.nan) for one in TWO_PROBES.sensors
    )
    layout = replace(TWO_PROBES, sensors=sensors)
    for seed in range(5):
        noisy_samples = noisy(samples, TWO_PROBES, seed)
        dying = noisy_samples.copy()
        dying[half:, 1] = np.nan
        found = identifier_of(dying, LINEAR, layout, sizes=[64] * 63).estimate()
        assert {parameter.status for parameter in found.parameters} == {EstimateStatus.OK}
        scores.append((values_of(found) - truth_of(LINEAR)) / deviations_of(found))
    if stated:
        # Both probes, then the coarse one alone: six times the noise tells next to nothing.
        before = identifier_of(noisy_samples[:half], LINEAR, layout).estimate()
        np.testing.assert_allclose(deviations_of(found), deviations_of(before), rtol=0.1)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 10)
    assert low < (np.array(scores) ** 2).sum() < high


def test_pointwise_bias_is_that_of_the_noise_at_the_instants_used():
    samples = noisy(exact(LINEAR, TWO_PROBES, count=3000), TWO_PROBES)
    dying = samples.copy()
    dying[1000:, 1] = np.nan
    identifier = PointwiseIdentifier(LINEAR)
    counts, covariances = [], []
    for motion in motion_of(LINEAR, TWO_PROBES, blocks_of(dying, RATE, [100] * 29)):
        identifier.add(motion)
        counts.append(np.isfinite(motion.acceleration).all(axis=1).sum())
        covariances.append(motion.displacement_covariance)
    expected = np.average(covariances, axis=0, weights=counts)
    np.testing.assert_allclose(identifier.state.noise.displacement, expected, rtol=1e-12)
    assert expected[0, 0] > 2 * covariances[0][0, 0]
