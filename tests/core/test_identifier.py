# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The pointwise identifier: exact on clean data, honest on noisy ones."""

from dataclasses import replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.estimation.regression import PointwiseRegression
from identnl_ros.core.measurement.blocks import MotionBlock
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.joints import GROUND, SpringDamper
from identnl_ros.core.mechanics.machine import Body, ConstantForce, ExcitationPoint, Machine
from identnl_ros.core.pointwise.pointwise_identifier import PointwiseIdentifier
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest
from scipy.stats import binom, kstest

from tests.core.machines import (
    blocks_of,
    chain,
    deviations_of,
    identified,
    known,
    line_layout,
    motion_of,
    ORIGIN,
    oscillator,
    slideway,
    truth_of,
    unknown,
    values_of,
    X,
    Y,
    Z,
)  # fmt: skip
from tests.reference_machines import complete_layout, knee_and_column

RATE = 5000.0
OK, NOISE_LIMITED = EstimateStatus.OK, EstimateStatus.NOISE_LIMITED
D, V, A = SensorKind.DISPLACEMENT, SensorKind.VELOCITY, SensorKind.ACCELERATION
OSCILLATOR = oscillator(
    unknown(10.0), unknown(4e5), unknown(200.0), None, unknown(5e16)
)  # natural frequency 32 Hz, 20 um: the cubic part is as large as the linear one at 2.8 um


def record(model, layout, seconds, amplitude=20.0, band=(2.0, 80.0), rate=RATE, seed=1):
    """Return what perfect sensors read of a multisine."""
    signal = multisine(amplitude, band, 1.0, np.random.default_rng(seed))
    signals = (signal,) * len(model.machine.excitations)
    stand = SimulatedStand(model, layout.with_noise_times(0.0), signals, rate, seed, 1)
    return stand.read(int(seconds * rate)).samples


def with_noise(samples, layout, seed):
    noise = np.array([sensor.noise for sensor in layout.sensors])
    return samples + noise * np.random.default_rng(seed).standard_normal(samples.shape)


def forgetful(model):
    """Blank the true values, which the identification must not use."""
    values = model.values
    values[list(model.estimated)] = np.nan
    return model.with_values(values)


def recovered(machine, layout, seconds=1.0, **settings):
    """Return the relative errors of the estimates from clean data, and the estimate."""
    model = assemble(machine)
    samples = record(model, layout, seconds, **settings)
    estimate = identified(forgetful(model), layout, blocks_of(samples, settings.get('rate', RATE)))
    assert {parameter.status for parameter in estimate.parameters} == {OK}
    return np.abs(values_of(estimate) / truth_of(model) - 1), estimate


# --- clean data ------------------------------------------------------------------------------


@pytest.mark.parametrize('coupled', [False, True], ids=['decoupled', 'coupled'])
def test_sixteen_slideway_parameters_of_knee_and_column_return_to_1e_9(coupled):
    machine = knee_and_column(coupled)
    errors, estimate = recovered(
        machine, complete_layout(machine), 0.3, amplitude=1000.0, band=(5.0, 300.0), rate=1e4
    )
    assert len(errors) == 16
    assert errors.max() < 1e-9
    assert estimate.residual < 1e-9
    assert estimate.samples == 3000


def test_mass_stiffness_damping_and_cubic_stiffness_return_to_1e_9():
    errors, estimate = recovered(OSCILLATOR, line_layout())
    assert [parameter.name for parameter in estimate.parameters] == [
        'block.mass', 'spring.stiffness', 'spring.cubic_stiffness', 'spring.damping',
    ]  # fmt: skip
    assert errors.max() < 1e-9


def test_constant_force_and_quadratic_stiffness_return_to_1e_9():
    hose = ConstantForce('hose', 'block', ORIGIN, X, unknown(3.0))
    errors, _ = recovered(
        oscillator(None, unknown(4e5), None, unknown(3e9), forces=(hose,)),
        line_layout(),
        amplitude=5.0,
    )
    assert errors.max() < 1e-9


def test_mass_under_gravity_counts_its_weight_too():
    machine = oscillator(unknown(10.0), unknown(4e5), gravity=9.81 * X)
    errors, _ = recovered(machine, line_layout())
    assert errors.max() < 1e-9


def test_force_and_displacement_alone_give_the_oscillator_as_well_as_they_can_be_derived():
    # Differences over 17 samples are exact to 1e-9 at the highest frequencies that matter.
    errors, estimate = recovered(OSCILLATOR, line_layout(kinds=(D,)))
    assert errors.max() < 1e-6
    assert sum('derived from the displacement' in note for note in estimate.notes) == 2


def test_known_delays_of_the_sensors_cost_clean_data_less_than_1e_6():
    errors, _ = recovered(OSCILLATOR, line_layout(delay=2.4 / RATE))
    assert errors.max() < 1e-6


def test_two_masses_with_unknown_springs_return_to_1e_9():
    errors, _ = recovered(chain(make=unknown), line_layout(('mass_1', 'mass_2')))
    assert errors.max() < 1e-9


# --- streaming -------------------------------------------------------------------------------

NOISES = {SensorKind.FORCE: 0.05, D: 1e-8, V: 2e-6, A: 1e-3}
NOISY = line_layout(noise=NOISES)
DERIVED = line_layout(kinds=(D,), noise=0.0)


def noisy_record(layout=NOISY, seconds=1.2):
    model = assemble(OSCILLATOR)
    return model, with_noise(record(model, layout, seconds), layout, 5)


def assert_same_bits(first, second):
    np.testing.assert_array_equal(values_of(first), values_of(second))
    np.testing.assert_array_equal(first.covariance, second.covariance)
    assert first == replace(second, covariance=first.covariance)


@pytest.mark.parametrize('sizes', [[1] * 300, [2048, 2048], [2047, 2, 1], [777] * 8, [3] * 900])
@pytest.mark.parametrize('layout', [DERIVED, NOISY], ids=['clean', 'noisy'])
def test_cutting_the_record_into_blocks_does_not_change_a_bit(layout, sizes):
    model, samples = noisy_record(layout)
    whole, parts = (
        identified(model, layout, blocks_of(samples, RATE, cut)) for cut in ((), sizes)
    )
    assert_same_bits(whole, parts)


@pytest.mark.parametrize('layout', [DERIVED, NOISY], ids=['derived', 'noisy'])
@pytest.mark.parametrize('pause', [1, 7, 11, 12])
def test_saved_and_restored_identifier_continues_as_if_never_stopped(layout, pause):
    model, samples = noisy_record(layout)
    samples[100, 1] = np.nan
    motions = motion_of(model, layout, blocks_of(samples, RATE, [500] * 11))
    steady, stopped, restored = (PointwiseIdentifier(model) for _ in range(3))
    for motion in motions:
        steady.add(motion)
    for motion in motions[:pause]:
        stopped.add(motion)
    restored.restore(stopped.state)
    for motion in motions[pause:]:
        restored.add(motion)
    assert_same_bits(steady.estimate(), restored.estimate())


def test_restored_identifier_knows_what_it_has_seen_of_the_stream():
    model, samples = noisy_record()
    motions = motion_of(model, NOISY, blocks_of(samples, RATE, [1000] * 5))
    first, second = PointwiseIdentifier(model), PointwiseIdentifier(model)
    for motion in motions[:3]:
        first.add(motion)
    state = first.state
    assert (state.stream_id, state.next_index) == (1, 3000)
    assert not state.noise_estimated
    assert state.derived == frozenset()
    second.restore(state)
    assert [second.add(motion) for motion in motions] == [False, False, False, True, True, True]
    for motion in motions[3:]:
        first.add(motion)
    assert_same_bits(first.estimate(), second.estimate())


def test_restored_identifier_takes_another_record_at_once():
    model, samples = noisy_record()
    (motion,) = motion_of(model, NOISY, blocks_of(samples, RATE))
    first, second = PointwiseIdentifier(model), PointwiseIdentifier(model)
    first.add(motion)
    second.restore(first.state)
    assert second.add(replace(motion, stream_id=2))
    assert second.samples == 12000
    assert second.follower.foreign_blocks == 0


def test_restored_identifier_remembers_that_noise_and_rates_are_second_hand():
    model, samples = noisy_record(DERIVED)
    unstated = line_layout(kinds=(D,), noise=np.nan)
    (motion,) = motion_of(model, unstated, blocks_of(samples, RATE))
    first, second = PointwiseIdentifier(model), PointwiseIdentifier(model)
    first.add(motion)
    assert first.state.noise_estimated
    assert first.state.derived == {'velocity', 'acceleration'}
    second.restore(first.state)
    assert second.estimate().notes == first.estimate().notes
    assert_same_bits(first.estimate(), second.estimate())


@pytest.mark.parametrize('noise', [0.0, 1e-9, 1e-7, 1e-5, 1e-3])
def test_record_that_begins_with_the_machine_at_rest_is_judged_as_one_that_does_not(noise):
    # The first batch is then full of zeros and says nothing about the size of the residuals.
    model = assemble(OSCILLATOR)
    layout = line_layout()
    samples = record(model, layout, 1.0)
    samples[:, 0] += noise * np.random.default_rng(1).standard_normal(len(samples))
    late = np.concatenate((np.zeros((2100, samples.shape[1])), samples))
    plain, waiting = (identified(model, layout, blocks_of(part, RATE)) for part in (samples, late))
    assert {parameter.status for parameter in waiting.parameters} == {OK}
    np.testing.assert_allclose(values_of(waiting), values_of(plain), rtol=1e-9)
    deviations = deviations_of(waiting)
    assert np.isfinite(deviations).all()
    if noise:
        np.testing.assert_allclose(deviations, deviations_of(plain), rtol=0.01)
    else:
        assert np.all(deviations < 1e-9 * truth_of(model))


@pytest.mark.parametrize('exponent', [0.5, 0.8])
@pytest.mark.parametrize('coupled', [False, True], ids=['decoupled', 'coupled'])
def test_contact_with_a_power_below_one_and_no_preload_returns_to_1e_9(coupled, exponent):
    # Its slope is infinite at rest, where every record begins.
    slide = slideway(
        normal=X, longitudinal=Z, exponent=exponent, preload=0.0, coupled=coupled,
        normal_stiffness=unknown(1e3), tangential_stiffness=known(1e8),
    )  # fmt: skip
    errors, _ = recovered(oscillator(known(2.0), known(1e4), more_joints=(slide,)), line_layout())
    assert errors.max() < 1e-9


def test_asking_for_an_estimate_changes_nothing():
    model, samples = noisy_record()
    motions = motion_of(model, NOISY, blocks_of(samples, RATE, [700] * 8))
    asked, silent = PointwiseIdentifier(model), PointwiseIdentifier(model)
    for motion in motions:
        asked.add(motion)
        silent.add(motion)
        asked.estimate()
    assert_same_bits(asked.estimate(), silent.estimate())


def test_reset_forgets_everything():
    model, samples = noisy_record(DERIVED)
    first, second = motion_of(model, DERIVED, blocks_of(samples, RATE, [3000]))
    used, fresh = PointwiseIdentifier(model), PointwiseIdentifier(model)
    used.add(first)
    used.reset()
    for identifier in (used, fresh):
        identifier.add(second)
    assert_same_bits(used.estimate(), fresh.estimate())


def test_repeated_block_is_not_counted_twice():
    model, samples = noisy_record()
    motions = motion_of(model, NOISY, blocks_of(samples, RATE, [2000, 2000]))
    once, twice = PointwiseIdentifier(model), PointwiseIdentifier(model)
    assert [once.add(motion) for motion in motions] == [True] * 3
    assert [twice.add(motions[i]) for i in (0, 0, 1, 0, 2)] == [True, False, True, False, True]
    assert_same_bits(once.estimate(), twice.estimate())


def test_rows_with_nan_are_left_out_and_counted():
    model, samples = noisy_record()
    holes = samples.copy()
    holes[[10, 11, 500, 4000], [0, 1, 2, 3]] = np.nan
    found = identified(model, NOISY, blocks_of(holes, RATE, [100] * 9))
    assert (found.samples, found.rejected_samples) == (5996, 4)
    (motion,) = motion_of(model, NOISY, blocks_of(samples, RATE))
    keep = np.setdiff1d(np.arange(6000), [10, 11, 500, 4000])
    parts = [getattr(motion, name)[keep] for name in
             ('displacement', 'velocity', 'acceleration', 'force')]  # fmt: skip
    regressor, target = PointwiseRegression(model).rows(*parts)
    expected = np.linalg.lstsq(regressor / truth_of(model) ** -1, target, rcond=None)[0]
    np.testing.assert_allclose(values_of(found), expected * truth_of(model), rtol=1e-9)


@pytest.mark.parametrize('count', [0, 1, 3, 4])
def test_too_few_samples_give_no_number_at_all(count):
    model, samples = noisy_record()
    identifier = PointwiseIdentifier(model)
    if count:
        (motion,) = motion_of(model, NOISY, blocks_of(samples[:count], RATE))
        identifier.add(motion)
    estimate = identifier.estimate()
    assert {parameter.status for parameter in estimate.parameters} == {EstimateStatus.UNKNOWN}
    assert np.isnan(values_of(estimate)).all()
    assert np.isnan(estimate.covariance).all()
    assert estimate.samples == count


def test_data_of_a_machine_that_does_not_move_determine_nothing():
    model, samples = noisy_record(DERIVED)
    estimate = identified(model, DERIVED, blocks_of(0 * samples, RATE))
    statuses = {parameter.status for parameter in estimate.parameters}
    assert statuses == {EstimateStatus.NOT_IDENTIFIABLE}
    assert np.isnan(values_of(estimate)).all()


UNSTATED = line_layout(noise=np.nan)


def test_unknown_noise_is_noted():
    model, samples = noisy_record()
    estimate = identified(model, UNSTATED, blocks_of(samples, RATE))
    assert sum('does not state every sensor' in note for note in estimate.notes) == 1
    stated = identified(model, NOISY, blocks_of(samples, RATE))
    assert not any('does not state' in note for note in stated.notes)


def test_noise_found_from_the_samples_stands_in_for_a_statement():
    model, samples = noisy_record()
    found, stated = (
        identified(model, layout, blocks_of(samples, RATE)) for layout in (UNSTATED, NOISY)
    )
    np.testing.assert_allclose(values_of(found), values_of(stated), rtol=1e-12)
    np.testing.assert_allclose(deviations_of(found), deviations_of(stated), rtol=0.1)
    assert [p.status for p in found.parameters] == [p.status for p in stated.parameters]


@pytest.mark.parametrize('size', [10, 50, 500])
def test_noise_found_from_the_samples_depends_on_the_blocks_by_rounding_only(size):
    model, samples = noisy_record(seconds=0.6)
    whole, parts = (
        identified(model, UNSTATED, blocks_of(samples, RATE, sizes))
        for sizes in ((), [size] * (3000 // size))
    )
    np.testing.assert_array_equal(values_of(whole), values_of(parts))
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-9)
    np.testing.assert_allclose(deviations_of(parts), deviations_of(whole), rtol=1e-9)
    assert [p.status for p in parts.parameters] == [p.status for p in whole.parameters]
    assert parts.notes == whole.notes


def test_machine_without_unknowns_or_with_a_known_number_missing_is_refused():
    with pytest.raises(DataError, match='nothing to identify'):
        PointwiseIdentifier(assemble(oscillator()))
    with pytest.raises(DataError, match=r'spring\.damping: known but without a value'):
        PointwiseIdentifier(assemble(oscillator(None, unknown(), known(np.nan))))


def test_state_or_motion_of_another_machine_is_refused():
    model, samples = noisy_record()
    identifier = PointwiseIdentifier(model)
    other = assemble(chain(make=unknown))
    with pytest.raises(DataError, match='another machine or other unknowns'):
        identifier.restore(PointwiseIdentifier(other).state)
    (motion,) = motion_of(model, NOISY, blocks_of(samples[:9], RATE))
    with pytest.raises(DataError, match='coordinates'):
        PointwiseIdentifier(other).add(motion)


# --- what data determine only together --------------------------------------------------------


def test_faces_on_one_line_of_action_are_told_apart_but_for_their_normal_damping():
    # A block between two opposite faces, as of a dovetail, and a slideway below.
    body = Body('block', known(60.0), np.array([0.0, 0.0, 0.1]), np.diag([0.9, 1.2, 1.5]))
    bed = tuple(
        SpringDamper(
            f'pad_{i}', 'block', GROUND, np.array([x, y, 0.0]), np.eye(3),
            (known(1e7), known(1e7), known(3e7)), (known(2e3),) * 3,
        )
        for i, (x, y) in enumerate(((-0.2, -0.2), (0.2, -0.2), (0.0, 0.3)))
    )  # fmt: skip
    faces = tuple(
        slideway(
            name, 'block', point=np.array([0.0, side, 0.15]), normal=-np.sign(side) * Y,
            normal_stiffness=unknown(a_n), tangential_stiffness=unknown(a_t),
            normal_damping=unknown(h_n), tangential_damping=unknown(h_t),
            damping_frequency=40.0, coupled=False,
        )
        for name, side, a_n, a_t, h_n, h_t in (
            ('left', 0.19, 3.4e15, 1.3e8, 2.7e7, 0.3e7),
            ('right', -0.19, 6.6e15, 2.7e8, 2.1e7, 7.7e7),
        )
    )  # fmt: skip
    exciter = ExcitationPoint('exciter', 'block', np.array([0.3, 0.1, 0.3]), X + 2 * Y - Z)
    machine = Machine('dovetail', (body,), (*bed, *faces), (exciter,))
    model = assemble(machine)
    layout = complete_layout(machine)
    samples = record(model, layout, 0.5, amplitude=100.0, band=(10.0, 300.0), rate=1e4)
    estimate = identified(forgetful(model), layout, blocks_of(samples, 1e4))
    (combination,) = estimate.combinations
    assert combination.in_words == (
        'left.normal_hysteretic_damping + right.normal_hysteretic_damping'
    )
    truth = dict(zip((p.name for p in estimate.parameters), truth_of(model), strict=True))
    total = sum(value for name, value in truth.items() if 'normal_hysteretic' in name)
    assert combination.value == pytest.approx(total, rel=1e-8)
    for index, parameter in enumerate(estimate.parameters):
        if 'normal_hysteretic' in parameter.name:
            assert parameter.status is EstimateStatus.NOT_IDENTIFIABLE
            assert np.isnan(parameter.value)
            assert np.isnan(parameter.standard_deviation)
            assert np.isnan(estimate.covariance[index]).all()
            assert np.isnan(estimate.covariance[:, index]).all()
        else:
            assert parameter.status is OK
            assert parameter.value == pytest.approx(truth[parameter.name], rel=1e-8)
            assert np.isfinite(estimate.covariance[index, index])


def test_mass_and_its_weight_s_spring_under_rest_alone_are_known_as_a_ratio():
    # At rest only k q = m g: the data tell k / m and nothing else, so neither gets a number.
    machine = oscillator(unknown(10.0), unknown(4e5), gravity=9.81 * X)
    model = assemble(machine)
    samples = record(model, line_layout(), 0.1, amplitude=1e-30)
    estimate = identified(model, line_layout(), blocks_of(0 * samples + samples[0], RATE))
    assert {p.status for p in estimate.parameters} == {EstimateStatus.NOT_IDENTIFIABLE}
    assert len(estimate.combinations) == 1


# --- statistics ------------------------------------------------------------------------------


def smooth_motion(count, columns, seed=3, rate=2000.0):
    """Return displacement, velocity, acceleration of a smooth motion, from closed forms."""
    generator = np.random.default_rng(seed)
    frequencies = generator.uniform(10, 100, (columns, 5))
    omega = 2 * np.pi * frequencies
    phase = generator.uniform(0, 6, (columns, 5))
    amplitude = generator.uniform(0.5, 1.5, (columns, 5)) * 1e-6
    angle = np.multiply.outer(np.arange(count) / rate, omega) + phase
    return tuple(
        (amplitude * omega**k * np.sin(angle + k * np.pi / 2)).sum(axis=2) for k in range(3)
    )


def estimate_of_motion(model, motion, force, covariances=(0.0,) * 5):
    n = len(model.coordinates)
    identifier = PointwiseIdentifier(model)
    identifier.add(MotionBlock(
        1, 0, 0, 2000.0, model.coordinate_names, *motion, force,
        *(covariance * np.eye(n) for covariance in covariances), last=True,
    ))  # fmt: skip
    return identifier.estimate()


def force_of(model, motion):
    displacement, velocity, acceleration = motion
    return model.mass_diagonal() * acceleration + model.joint_force(displacement, velocity)


def assert_coverage_and_no_bias(model, noise_on, runs=400, count=150):
    """95 % intervals hold the truth in 95 % of the runs; z-scores are standard normal."""
    motion = smooth_motion(count, len(model.coordinates))
    force = force_of(model, motion)
    factors = np.diag(noise_on) if np.ndim(noise_on) == 1 else np.array(noise_on)
    scores = np.empty((runs, len(model.estimated)))
    for seed in range(runs):
        noise = np.random.default_rng(seed).standard_normal((count, len(factors))) @ factors
        estimate = estimate_of_motion(model, motion, force + noise)
        scores[seed] = (values_of(estimate) - truth_of(model)) / deviations_of(estimate)
    inside = (np.abs(scores) < 1.96).sum(axis=0)
    low, high = binom.ppf([5e-4, 1 - 5e-4], runs, 0.95)
    assert np.all((low <= inside) & (inside <= high)), inside / runs
    assert np.all(np.abs(scores.mean(axis=0)) < 3.9 / np.sqrt(runs))
    return scores


def test_intervals_hold_the_truth_95_times_in_100_with_noise_on_the_force():
    scores = assert_coverage_and_no_bias(assemble(OSCILLATOR), [0.2])
    for column in scores.T:
        assert kstest(column, 'norm').pvalue > 1e-4


def test_intervals_hold_the_truth_95_times_in_100_with_noise_on_one_force_of_two():
    # Only the first body is shaken: its equations are noisy, those of the second exact.
    assert_coverage_and_no_bias(assemble(chain(make=unknown)), [0.2, 0.0])


@pytest.mark.parametrize(
    'factors',
    [[[0.2, 0.0], [0.0, 2e-3]], [[2e-3, 0.0], [0.0, 0.2]], [[0.2, -0.15]], [[2e-3, 0.2]]],
)
def test_intervals_hold_the_truth_with_unequal_or_common_noise_on_two_equations(factors):
    assert_coverage_and_no_bias(assemble(chain(make=unknown)), factors)


def test_intervals_hold_the_truth_with_noisy_force_where_rates_are_derived():
    model = assemble(oscillator(unknown(10.0), unknown(4e5), unknown(200.0)))
    layout = line_layout(kinds=(D,), noise={SensorKind.FORCE: 0.5, D: 0.0})
    samples = record(model, layout, 0.5)
    runs = 200
    scores = np.empty((runs, 3))
    for seed in range(runs):
        estimate = identified(model, layout, blocks_of(with_noise(samples, layout, seed), RATE))
        scores[seed] = (values_of(estimate) - truth_of(model)) / deviations_of(estimate)
    inside = (np.abs(scores) < 1.96).sum(axis=0)
    low, high = binom.ppf([5e-4, 1 - 5e-4], runs, 0.95)
    assert np.all((low <= inside) & (inside <= high)), inside / runs


def honest(model, layout, samples, runs=60):
    """Count parameters that are called ok though more than three deviations off."""
    truth = truth_of(model)
    wrong, called_ok = np.zeros(len(truth), int), np.zeros(len(truth), int)
    for seed in range(runs):
        noisy = with_noise(samples, layout, seed)
        estimate = identified(model, layout, blocks_of(noisy, RATE))
        ok = np.array([parameter.status is OK for parameter in estimate.parameters])
        off = np.abs(values_of(estimate) - truth) > 3 * deviations_of(estimate)
        wrong += ok & off
        called_ok += ok
    allowed = binom.ppf(0.9995, runs, 0.0027)
    return np.all(wrong <= allowed), dict(
        zip((model.parameters[i].name for i in model.estimated),
            zip(wrong.tolist(), called_ok.tolist(), strict=True), strict=True)
    )  # fmt: skip


@pytest.mark.parametrize('level', [0.01, 0.1, 1.0, 10.0])
def test_all_quantities_measured_with_noise_are_judged_honestly(level):
    model = assemble(OSCILLATOR)
    layout = NOISY.with_noise_times(level)
    fine, counts = honest(model, layout, record(model, layout, 1.0))
    assert fine, counts


@pytest.mark.parametrize('noise', [1e-9, 1e-8, 1e-7, 3e-7, 1e-6])
def test_noisy_displacement_alone_is_judged_honestly(noise):
    # Mass known, stiffness and damping sought: velocity and acceleration are derived.
    model = assemble(oscillator(None, unknown(4e5), unknown(200.0)))
    layout = line_layout(kinds=(D,), noise={SensorKind.FORCE: 0.01, D: noise})
    fine, counts = honest(model, layout, record(model, layout, 2.0))
    assert fine, counts


@pytest.mark.parametrize('noise', [1e-9, 1e-8, 1e-7, 3e-7, 1e-6])
def test_mass_from_noisy_displacement_alone_is_judged_honestly(noise):
    model = assemble(oscillator(unknown(10.0), unknown(4e5), unknown(200.0)))
    layout = line_layout(kinds=(D,), noise={SensorKind.FORCE: 0.01, D: noise})
    fine, counts = honest(model, layout, record(model, layout, 2.0))
    assert fine, counts


@pytest.mark.parametrize('noise', [1e-9, 1e-8, 1e-7, 1e-6])
def test_soft_unknown_spring_beside_a_stiff_known_one_is_judged_honestly(noise):
    # The known spring's force is computed from the same noisy displacement.
    beside = SpringDamper('soft', 'block', GROUND, ORIGIN, np.eye(3), (unknown(1e4),))
    model = assemble(oscillator(more_joints=(beside,)))
    layout = line_layout(noise={SensorKind.FORCE: 0.01, D: noise, V: 1e-7, A: 1e-5})
    fine, counts = honest(model, layout, record(model, layout, 1.0))
    assert fine, counts


@pytest.mark.parametrize('noise', [1e-9, 1e-8, 1e-7])
def test_preloaded_slideway_under_displacement_noise_is_judged_honestly(noise):
    slide = slideway(
        normal=X, longitudinal=Z, normal_stiffness=unknown(4e11), coupled=False,
        preload=1e-6, normal_damping=unknown(100.0),
    )  # fmt: skip
    model = assemble(oscillator(stiffness=known(1.0), damping=known(1.0), more_joints=(slide,)))
    layout = line_layout(noise={SensorKind.FORCE: 0.01, D: noise, V: 1e-7, A: 1e-5})
    samples = record(model, layout, 1.0, amplitude=2.0)
    identified_model = assemble(model.machine)
    fine, counts = honest(identified_model, layout, samples)
    assert fine, counts


def test_long_noisy_displacement_record_is_judged_honestly():
    # The derived acceleration shares its noise with the displacement it is derived from.
    model = assemble(oscillator(None, unknown(4e5), unknown(200.0)))
    layout = line_layout(kinds=(D,), noise={SensorKind.FORCE: 0.01, D: 2e-6})
    fine, counts = honest(model, layout, record(model, layout, 12.0), runs=6)
    assert fine, counts


def test_soft_unknown_spring_beside_a_stiff_known_one_is_judged_honestly_in_long_records():
    beside = SpringDamper('soft', 'block', GROUND, ORIGIN, np.eye(3), (unknown(1e4),))
    model = assemble(oscillator(more_joints=(beside,)))
    layout = line_layout(noise={SensorKind.FORCE: 0.01, D: 3e-6, V: 1e-7, A: 1e-5})
    fine, counts = honest(model, layout, record(model, layout, 12.0), runs=6)
    assert fine, counts


def knee_and_column_record():
    machine = knee_and_column()
    model, layout = assemble(machine), complete_layout(machine)
    samples = record(model, layout, 0.3, amplitude=1000.0, band=(5.0, 300.0), rate=1e4)
    return model, layout, samples


def test_intervals_of_knee_and_column_hold_the_truth_with_noise_on_the_force_cell():
    # One noisy force enters all twelve equations at once, metres and radians.
    model, layout, samples = knee_and_column_record()
    (motion,) = motion_of(model, layout, blocks_of(samples, 1e4))
    runs = 100
    scores = np.empty((runs, 16))
    for seed in range(runs):
        noise = np.random.default_rng(seed).normal(0.0, 5.0, (len(samples), 1))
        estimate = estimate_of_motion(
            model,
            (motion.displacement, motion.velocity, motion.acceleration),
            motion.force + noise * model.excitation_directions,
        )
        scores[seed] = (values_of(estimate) - truth_of(model)) / deviations_of(estimate)
    inside = (np.abs(scores) < 1.96).sum(axis=0)
    # 95 % of the runs, with room for sixteen parameters at once.
    assert np.all(inside >= binom.ppf(5e-4 / 16, runs, 0.95)), inside / runs
    assert np.all(np.abs(scores.mean(axis=0)) < 4.5 * scores.std(axis=0) / np.sqrt(runs))


@pytest.mark.parametrize('coupled', [False, True], ids=['decoupled', 'coupled'])
def test_pooled_intervals_of_knee_and_column_with_a_noisy_force_cell(coupled):
    # The whole way: readings, transform, identifier; every motion sensor perfect.
    machine = knee_and_column(coupled)
    model = assemble(machine)
    layout = complete_layout(machine)
    layout = Layout((replace(layout.sensors[0], noise=5.0), *layout.sensors[1:]))
    samples = record(model, layout, 0.1, amplitude=1000.0, band=(5.0, 300.0), rate=1e4)
    runs = 40
    inside = np.empty((runs, 16), bool)
    for seed in range(runs):
        noisy = with_noise(samples, layout, seed)
        estimate = identified(model, layout, blocks_of(noisy, 1e4, [300]))
        assert {parameter.status for parameter in estimate.parameters} == {OK}
        error = np.abs(values_of(estimate) - truth_of(model))
        inside[seed] = error < 1.96 * deviations_of(estimate)
    # The parameters of a run share its noise: count a run as four independent intervals.
    low, high = binom.ppf([5e-4, 1 - 5e-4], 4 * runs, 0.95) / (4 * runs)
    assert low <= inside.mean() <= high, (inside.mean(), inside.mean(axis=0))


@pytest.mark.parametrize('level', [1e-4, 1e-2, 0.1, 1.0])
def test_knee_and_column_are_judged_honestly_with_noise_on_every_motion_sensor(level):
    model, _, samples = knee_and_column_record()
    noisy = complete_layout(model.machine, 1e-8 * level, 1e-2 * level, 1e-5 * level)
    truth = truth_of(model)
    wrong = np.zeros(16, int)
    for seed in range(10):
        estimate = identified(model, noisy, blocks_of(with_noise(samples, noisy, seed), 1e4))
        ok = np.array([parameter.status is OK for parameter in estimate.parameters])
        wrong += ok & (np.abs(values_of(estimate) - truth) > 3 * deviations_of(estimate))
    assert wrong.sum() <= binom.ppf(0.9995, 160, 0.0027), wrong


def test_noise_limited_estimates_are_off_by_about_their_deviation():
    model = assemble(oscillator(None, unknown(4e5), unknown(200.0)))
    layout = line_layout(noise={SensorKind.FORCE: 0.01, D: 3e-6, V: 3e-5, A: 1e-3})
    samples = record(model, layout, 1.0)
    scores, limited = [], 0
    for seed in range(30):
        estimate = identified(model, layout, blocks_of(with_noise(samples, layout, seed), RATE))
        stiffness = estimate.parameters[0]
        limited += stiffness.status is NOISE_LIMITED
        scores.append((stiffness.value - 4e5) / stiffness.standard_deviation)
    assert limited == 30
    assert -1.3 < np.mean(scores) < -0.7
