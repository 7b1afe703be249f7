# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Unknown preloads and exponents: found from starts that are off, inside their intervals."""

from dataclasses import replace
from functools import cache

from identnl_ros.core.design.fisher import expected_information
from identnl_ros.core.estimation.estimate import EstimateStatus, ParameterEstimate
from identnl_ros.core.estimation.physical_bounds import within_physical_bounds
from identnl_ros.core.likelihood.likelihood_estimate import likelihood_estimate
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
import numpy as np
import pytest
from scipy.stats import chi2

from tests.core.machines import (
    blocks_of,
    deviations_of,
    known,
    motion_of,
    ORIGIN,
    slideway,
    truth_of,
    unknown,
    values_of,
    X,
    Y,
    Z,
)

RATE = 2000.0
COUNT, SETTLING = 2400, 400
D, A, F = SensorKind.DISPLACEMENT, SensorKind.ACCELERATION, SensorKind.FORCE
NOISE = {D: 2e-7, A: 2e-2}
LAYOUT = Layout((
    Sensor('cell', F, excitation='exciter', noise=0.0),
    *(
        Sensor(f'{kind.value}_{axis}', kind, 'block', direction=direction, noise=noise)
        for kind, noise in NOISE.items()
        for axis, direction in (('x', X), ('z', Z))
    ),
))  # fmt: skip
FIRST, SECOND = 4e11, 6e11  # a_n at an exponent of 2 [N/m^2]
# The estimate of a_n is the force at this deformation, whatever the exponent turns out to be.
MICROMETRE = 1e-6
RUNS = 5


def corner(exponent=2.0, preload=3e-6, shared_preload=True):
    """
    Build a block in a corner, pressed against one slideway along x and another along z.

    The second has the first's exponent and, unless it is unknown too, 0.8 times its preload.
    """
    to_unit = MICROMETRE ** (2 - exponent)
    common = {'coupled': False, 'tangential_stiffness': known(1e5), 'longitudinal': Y}
    slideways = (
        slideway(
            'first', normal=X, exponent=unknown(exponent), preload=unknown(preload),
            normal_stiffness=unknown(FIRST * to_unit), normal_damping=unknown(400.0), **common,
        ),
        slideway(
            'second', normal=Z, exponent=Coefficient(tie=Tie('first.exponent')),
            preload=Coefficient(tie=Tie('first.preload', 0.8))
            if shared_preload else unknown(0.8 * preload),
            normal_stiffness=unknown(SECOND * to_unit), normal_damping=unknown(300.0), **common,
        ),
    )  # fmt: skip
    body = Body('block', known(10.0), ORIGIN, None, ('translation_1', 'translation_3'))
    exciter = ExcitationPoint('exciter', 'block', ORIGIN, X + 0.7 * Z)
    return assemble(Machine('corner', (body,), slideways, (exciter,)))


TRUE = corner()


def signal(force=10.0):
    return multisine(force, (5.0, 80.0), 0.5, np.random.default_rng(3))


@cache
def exact(force=10.0):
    stand = SimulatedStand(TRUE, LAYOUT.with_noise_times(0.0), (signal(force),), RATE, 1, 1)
    return stand.read(COUNT + SETTLING).samples[SETTLING:]


def noisy(seed, force=10.0):
    noise = np.array([sensor.noise for sensor in LAYOUT.sensors])
    generator = np.random.default_rng(seed)
    return exact(force) + noise * generator.standard_normal(exact(force).shape)


def blank(model):
    """Forget all values but the starts of preloads and exponents."""
    values = model.values
    for i in model.estimated:
        if not model.parameters[i].inner:
            values[i] = np.nan
    return model.with_values(values)


def weak(model, samples):
    identifier = WeakIdentifier(blank(model))
    for motion in motion_of(model, LAYOUT, blocks_of(samples, RATE)):
        identifier.add(motion)
    return identifier.estimate()


def likelihood(model, samples):
    return likelihood_estimate(blank(model), [MeasuredRecord(LAYOUT, RATE, samples)])


def bound_of(model, force=10.0):
    information = expected_information(
        model, LAYOUT, (signal(force),), RATE, COUNT / RATE, SETTLING / RATE
    )
    return np.sqrt(np.diag(information.solve().inverse))


@pytest.fixture(scope='module')
def starts():
    """Exponents and preloads to start from, up to a quarter off either way."""
    factors = np.random.default_rng(5).uniform(0.75, 1.25, (RUNS, 2))
    return [(2.0 * exponent, 3e-6 * preload) for exponent, preload in factors]


def scores(estimate, start):
    """Errors over standard deviations; truth in the unit that a start exponent gives a_n."""
    names = [parameter.name for parameter in estimate.parameters]
    truth = truth_of(corner(start[0], shared_preload='second.preload' not in names))
    truth[names.index('first.exponent')] = 2.0
    return (values_of(estimate) - truth) / deviations_of(estimate)


def test_errors_are_those_that_the_intervals_say(starts):
    found = [
        weak(corner(*start, shared_preload=False), noisy(seed))
        for seed, start in enumerate(starts)
    ]
    assert {one.parameters[0].status for one in found} == {EstimateStatus.OK}
    errors = np.array([scores(*pair) for pair in zip(found, starts, strict=True)])
    assert np.abs(errors).max() < 4
    low, high = chi2.ppf([1e-4, 1 - 1e-4], RUNS)
    sums = (errors**2).sum(axis=0)
    assert np.all((low < sums) & (sums < high))
    bound = bound_of(corner(shared_preload=False))
    inner = [parameter.unit in ('1', 'm') for parameter in found[0].parameters]
    deviations = np.array([deviations_of(one) for one in found])[:, inner]
    np.testing.assert_allclose(np.median(deviations, axis=0), bound[inner], rtol=0.1)


def test_preloads_and_exponents_that_are_held_have_no_derivative():
    held = replace(
        TRUE,
        parameters=tuple(
            replace(one, estimated=one.estimated and not one.inner) for one in TRUE.parameters
        ),
    )
    motion = np.random.default_rng(2).standard_normal((3, 50, 2)) * 1e-6
    coefficients = [not TRUE.parameters[i].inner for i in TRUE.estimated]
    np.testing.assert_array_equal(
        ForceDerivatives(held).of_motion(*motion),
        ForceDerivatives(TRUE).of_motion(*motion)[:, :, coefficients],
    )


def test_likelihood_finds_the_same(starts):
    model, samples = corner(*starts[0]), noisy(0)
    streamed, fitted = weak(model, samples), likelihood(model, samples)
    difference = values_of(streamed) - values_of(fitted)
    assert np.abs(difference / deviations_of(fitted)).max() < 0.3


def test_stiffness_is_the_force_at_one_micrometre_for_every_start():
    samples = noisy(0)
    forces = []
    for exponent in (1.6, 2.3):
        estimate = weak(corner(exponent), samples)
        names = [parameter.name for parameter in estimate.parameters]
        one = estimate.parameters[names.index('first.normal_stiffness')]
        assert one.unit == f'N/m^{exponent:g}'
        forces.append(one.value * MICROMETRE**exponent)
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-4)
    np.testing.assert_allclose(forces, FIRST * MICROMETRE**2, rtol=0.05)


def test_tied_numbers_follow_what_is_found():
    start = corner(1.7, 3.5e-6)
    estimate = weak(start, noisy(1))
    assert np.abs(scores(estimate, (1.7, 3.5e-6))).max() < 4
    names = [parameter.name for parameter in estimate.parameters]
    assert not any(name in names for name in ('second.exponent', 'second.preload'))
    found = start.with_unknowns(values_of(estimate))
    preloads = {term.law.preload for term in found.terms if term.law.preload}
    exponents = {term.law.exponent for term in found.terms if term.inner}
    preload = values_of(estimate)[names.index('first.preload')]
    np.testing.assert_allclose(sorted(preloads), [0.8 * preload, preload], rtol=1e-12)
    np.testing.assert_allclose(
        list(exponents), values_of(estimate)[names.index('first.exponent')], rtol=1e-12
    )


def test_bounded_interval_of_a_preload_ends_at_zero_and_holds_it():
    estimate = weak(corner(), noisy(0))
    names = [parameter.name for parameter in estimate.parameters]
    index = names.index('first.preload')
    preload = estimate.parameters[index]
    # As a far smaller force would leave it: known to about its own size.
    factor = preload.value / preload.standard_deviation
    rough = replace(
        estimate,
        covariance=factor**2 * estimate.covariance,
        parameters=tuple(
            ParameterEstimate(
                one.name, one.symbol, one.unit, one.value, factor * one.standard_deviation,
                one.status,
            )
            for one in estimate.parameters
        ),
    )  # fmt: skip
    before = rough.parameters[index]
    after = within_physical_bounds(rough).parameters[index]
    assert before.lower < 0 == after.lower
    assert after.lower <= 3e-6 <= after.upper == pytest.approx(before.upper)
