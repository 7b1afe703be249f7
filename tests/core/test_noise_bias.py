# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What noise adds to the moments of the regression, against many noisy transformed records."""

from identnl_ros.core.estimation.regression import PointwiseRegression
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.joints import GROUND, SpringDamper
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.pointwise.noise_bias import NoiseBias, NoiseCovariances
import numpy as np
import pytest

from tests.core.machines import (
    blocks_of,
    chain,
    known,
    line_layout,
    motion_of,
    ORIGIN,
    oscillator,
    slideway,
    unknown,
    X,
    Z,
)  # fmt: skip
from tests.reference_machines import complete_layout

RATE = 2000.0
COUNT = 1500
D, V, A, FORCE = (
    SensorKind.DISPLACEMENT, SensorKind.VELOCITY, SensorKind.ACCELERATION, SensorKind.FORCE,
)  # fmt: skip
ORDER = {D: 0, V: 1, A: 2}


def clean_readings(model, layout, amplitude=3e-6):
    """Return what perfect sensors show of a few harmonics, and no force."""
    generator = np.random.default_rng(2)
    columns = len(model.coordinates)
    omega = 2 * np.pi * generator.uniform(8, 60, (columns, 3))
    phase = generator.uniform(0, 6, (columns, 3))
    size = amplitude * generator.uniform(0.5, 1.0, (columns, 3))
    angle = np.multiply.outer(np.arange(COUNT) / RATE, omega) + phase
    samples = np.zeros((COUNT, len(layout.sensors)))
    for channel, sensor in enumerate(layout.sensors):
        if sensor.kind is FORCE:
            continue
        order = ORDER[sensor.kind]
        motion = (size * omega**order * np.sin(angle + order * np.pi / 2)).sum(axis=2)
        samples[:, channel] = motion @ sensor_matrix(model, (sensor,))[0]
    return samples


def rows_of(model, motion):
    regressor, target = PointwiseRegression(model).rows(
        motion.displacement, motion.velocity, motion.acceleration, motion.force
    )
    return np.column_stack((regressor, target))


def computed_and_found(model, layout, draws):
    """Return E[[N, n]^T [N, n]] as core computes it and as the draws have it."""
    samples = clean_readings(model, layout)
    (clean,) = motion_of(model, layout, blocks_of(samples, RATE))
    bias = NoiseBias(model)
    sums = bias.with_motion(bias.empty(), clean.displacement)
    moments = bias.moments(sums, NoiseCovariances.of(clean))
    rows = rows_of(model, clean)
    noise = np.array([sensor.noise for sensor in layout.sensors])
    found = np.zeros((rows.shape[1],) * 2)
    for seed in range(draws):
        noisy = samples + noise * np.random.default_rng(seed).standard_normal(samples.shape)
        (motion,) = motion_of(model, layout, blocks_of(noisy, RATE))
        errors = rows_of(model, motion) - rows
        found += errors.T @ errors / draws
    return moments, found


def assert_moments_are_those_of_the_draws(model, layout, draws=40, tolerance=0.02):
    moments, found = computed_and_found(model, layout, draws)
    gram, cross = moments[:-1, :-1], moments[:-1, -1]
    assert moments[-1, -1] == pytest.approx(found[-1, -1], rel=0.05)
    sizes = np.sqrt(np.diag(found))
    # A column without any noise, e.g. of a constant force, must be exactly that.
    noisy = sizes[:-1] > 0
    np.testing.assert_array_equal(gram[~noisy], 0.0)
    np.testing.assert_array_equal(cross[~noisy], 0.0)
    scale = np.where(sizes > 0, sizes, 1.0)
    np.testing.assert_allclose(
        gram / np.outer(scale[:-1], scale[:-1]),
        found[:-1, :-1] / np.outer(scale[:-1], scale[:-1]),
        atol=tolerance,
    )
    np.testing.assert_allclose(
        cross / (scale[:-1] * scale[-1]), found[:-1, -1] / (scale[:-1] * scale[-1]), atol=tolerance
    )
    return cross / (scale[:-1] * scale[-1])


MEASURED = line_layout(noise={FORCE: 0.0, D: 2e-9, V: 3e-7, A: 1e-4})
ONLY_DISPLACEMENT = line_layout(kinds=(D,), noise={FORCE: 0.0, D: 2e-9})
DISPLACEMENT_AND_VELOCITY = line_layout(kinds=(D, V), noise={FORCE: 0.0, D: 2e-9, V: 3e-7})
LAYOUTS = {
    'measured': MEASURED,
    'derived': ONLY_DISPLACEMENT,
    'acceleration derived': DISPLACEMENT_AND_VELOCITY,
    'delayed': line_layout(kinds=(D,), noise={FORCE: 0.0, D: 2e-9}, delay=2.4 / RATE),
}


@pytest.mark.parametrize('layout', LAYOUTS.values(), ids=LAYOUTS)
def test_unknown_mass_springs_and_damping(layout):
    model = assemble(
        oscillator(unknown(10.0), unknown(4e5), unknown(200.0), unknown(2e10), unknown(5e15))
    )
    assert_moments_are_those_of_the_draws(model, layout)


@pytest.mark.parametrize('layout', LAYOUTS.values(), ids=LAYOUTS)
def test_known_mass_in_the_target_correlates_with_the_spring_where_it_is_derived(layout):
    model = assemble(oscillator(known(10.0), unknown(4e5), unknown(200.0)))
    shared = assert_moments_are_those_of_the_draws(model, layout)
    # The middle weight of a second derivative is by far its largest, and negative.
    derived = all(sensor.kind is not A for sensor in layout.sensors)
    assert (shared[0] > 0.5) == derived


@pytest.mark.parametrize('layout', LAYOUTS.values(), ids=LAYOUTS)
def test_known_stiff_spring_beside_an_unknown_soft_one(layout):
    beside = SpringDamper(
        'soft', 'block', GROUND, ORIGIN, np.eye(3), (unknown(1e4),), (unknown(20.0),)
    )
    machine = oscillator(cubic=known(5e15), more_joints=(beside,))
    shared = assert_moments_are_those_of_the_draws(assemble(machine), layout)
    if layout is MEASURED:
        assert shared[0] < -0.5


@pytest.mark.parametrize('kinds', [(D,), (D, V, A), (D, A)], ids=len)
def test_two_bodies_whose_springs_share_their_motions(kinds):
    machine = chain(make=unknown)
    machine = Machine(
        machine.name,
        (machine.bodies[0], Body('mass_2', unknown(3.0), ORIGIN, None, ('translation_1',))),
        machine.joints,
        machine.excitations,
    )
    layout = line_layout(
        ('mass_1', 'mass_2'), kinds, noise={FORCE: 0.0, D: 2e-9, V: 3e-7, A: 1e-4}
    )
    assert_moments_are_those_of_the_draws(assemble(machine), layout)


@pytest.mark.parametrize('kinds', [(D,), (D, V, A)], ids=len)
def test_turning_block_on_an_unknown_slideway_with_unknown_mass(kinds):
    # One stiffness owns many rays; mass and moments of inertia; sensors seen from several sides.
    body = Body('block', unknown(50.0), np.array([0.02, 0.0, 0.1]), np.diag([0.6, 0.9, 1.1]))
    pad = SpringDamper(
        'pad', 'block', GROUND, np.array([0.0, 0.1, 0.1]), np.eye(3),
        (known(1e7), unknown(1e7), known(1e7)), (known(1e3), unknown(1e3), known(1e3)),
    )  # fmt: skip
    slide = slideway(
        width=0.2, preload=50e-6,
        normal_stiffness=unknown(1e12), tangential_stiffness=unknown(1e8),
        normal_damping=unknown(1e4), tangential_damping=unknown(1e4),
    )  # fmt: skip
    exciter = ExcitationPoint('exciter', 'block', np.array([0.1, 0.05, 0.15]), X + 2 * Z)
    machine = Machine('block', (body,), (pad, slide), (exciter,))
    layout = complete_layout(machine, 2e-9, 1e-4, 3e-7, kinds)
    assert_moments_are_those_of_the_draws(assemble(machine), layout, draws=25)


def test_instants_add_up_however_they_come():
    model = assemble(oscillator(unknown(10.0), unknown(4e5), None, None, unknown(5e15)))
    motion = np.random.default_rng(1).standard_normal((100, 1)) * 1e-6
    bias = NoiseBias(model)
    whole = bias.with_motion(bias.empty(), motion)
    parts = bias.empty()
    for part in np.split(motion, [1, 7, 60]):
        parts = bias.with_motion(parts, part)
    assert parts.samples == whole.samples == 100
    np.testing.assert_allclose(parts.products, whole.products, rtol=1e-12)
    np.testing.assert_allclose(parts.sums, whole.sums, rtol=1e-12)
    assert bias.empty().samples == 0


def test_moments_by_hand_of_one_spring_and_mass():
    # Phi = (q'', q, q^3), Y = F - c q'; noises s0, s1, s2 of q, q', q''; cov(q, q'') = r.
    model = assemble(oscillator(unknown(10.0), unknown(4e5), known(200.0), None, unknown(5e16)))
    q = np.linspace(-2e-6, 3e-6, 40)[:, np.newaxis]
    bias = NoiseBias(model)
    sums = bias.with_motion(bias.empty(), q)
    s0, s1, s2, sf, r = 3e-18, 4e-12, 5e-6, 7e-4, -2e-12
    covariances = NoiseCovariances(*(np.full((1, 1), value) for value in (s0, s1, s2, sf, r)))
    moments = bias.moments(sums, covariances)
    names = [model.parameters[i].name for i in model.estimated]
    assert names == ['block.mass', 'spring.stiffness', 'spring.cubic_stiffness']
    slope, square = 3 * np.sum(q**2), 9 * np.sum(q**4)
    expected = np.array(
        [
            [40 * s2, 40 * r, r * slope],
            [40 * r, 40 * s0, s0 * slope],
            [r * slope, s0 * slope, s0 * square],
        ]
    )
    np.testing.assert_allclose(moments[:-1, :-1], expected, rtol=1e-12)
    np.testing.assert_array_equal(moments[:-1, -1], 0.0)
    assert moments[-1, -1] == pytest.approx(40 * (sf + 200.0**2 * s1))


def test_noise_that_is_not_known_is_not_known():
    model = assemble(oscillator(unknown()))
    (motion,) = motion_of(
        model, line_layout(kinds=(D,), noise={FORCE: 0.0, D: np.nan}),
        blocks_of(np.zeros((30, 2))[:5], RATE),
    )  # fmt: skip
    bias = NoiseBias(model)
    sums = bias.with_motion(bias.empty(), motion.displacement)
    assert np.isnan(bias.moments(sums, NoiseCovariances.of(motion))).any()
