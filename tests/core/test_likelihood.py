# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Maximum-likelihood fits of simulated stands: back come the values, with honest errors."""

from dataclasses import replace

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.likelihood.likelihood import fit_likelihood
from identnl_ros.core.likelihood.likelihood_point import LikelihoodSettings
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.sensor_unknown import (
    SensorQuantity,
    SensorUnknown,
    shared_unknown,
)
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine, sine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.core.machines import known, line_layout, oscillator, unknown
from tests.reference_machines import complete_layout, knee_and_column

RATE = 1e4
DISPLACEMENT, ACCELERATION = SensorKind.DISPLACEMENT, SensorKind.ACCELERATION
MACHINE = knee_and_column()
MODEL = assemble(MACHINE)
TRUTH = MODEL.values[list(MODEL.estimated)]
BROADBAND = multisine(1000.0, (5.0, 300.0), 1.0, np.random.default_rng(0))
HARMONIC = sine(1000.0, 40.0)


def layout(displacement_noise=1e-8, acceleration_noise=0.01):
    return complete_layout(
        MACHINE, displacement_noise, acceleration_noise, kinds=(DISPLACEMENT, ACCELERATION)
    )


def record(signal, actual, seed=0, duration=0.2, declared=None, model=MODEL, rate=RATE):
    """Measure after a fifth of a second, so that the initial state is none of rest."""
    stand = SimulatedStand(model, actual, (signal,), rate, seed, 1, declared_layout=declared)
    samples = stand.read(int((0.2 + duration) * rate)).samples[int(0.2 * rate) :]
    return MeasuredRecord(declared or actual, rate, samples)


def perturbed(model=MODEL, stiffness=0.2, damping=0.5, seed=3):
    generator = np.random.default_rng(seed)
    values = model.values
    for index in model.estimated:
        size = damping if 'damping' in model.parameters[index].name else stiffness
        values[index] *= 1 + size * generator.choice([-1, 1])
    return model.with_values(values)


def scores(fit, truth=TRUTH):
    """Give the error along every principal axis of the covariance, in standard deviations."""
    scale = np.sqrt(np.diag(fit.covariance))
    sizes, axes = np.linalg.eigh(fit.covariance / np.outer(scale, scale))
    return axes.T @ ((fit.values - truth) / scale) / np.sqrt(sizes)


@pytest.mark.parametrize('signal', [BROADBAND, HARMONIC], ids=['multisine', 'sine'])
def test_clean_data_return_every_parameter(signal):
    fit = fit_likelihood(perturbed(), [record(signal, layout(0.0, 0.0))])
    assert fit.converged, fit.reason
    np.testing.assert_allclose(fit.values, TRUTH, rtol=1e-9)
    assert not fit.noise_known


def test_a_far_start_converges_and_errors_are_as_large_as_they_say():
    fit = fit_likelihood(perturbed(), [record(BROADBAND, layout())])
    assert fit.converged, fit.reason
    assert np.sum(scores(fit) ** 2) < 39  # chi squared of 16: one in a thousand
    assert abs(fit.excess) < 4
    assert fit.noise_known
    np.testing.assert_allclose(np.concatenate(fit.channel_ratios), 1.0, atol=0.1)
    assert not fit.free.any()
    assert fit.null_space.shape == (16, 0)


def test_scores_over_seeds_have_unit_size():
    found = []
    for seed in range(5):
        fit = fit_likelihood(
            perturbed(stiffness=0.01, damping=0.02),
            [record(BROADBAND, layout(), seed + 10, duration=0.1)],
            settings=LikelihoodSettings(pieces=False),
        )
        found.append(scores(fit))
    # Mean of 80 squares: 1 +- 0.16.
    assert 0.5 < np.mean(np.square(found)) < 1.6


def test_delay_of_the_accelerometers_is_found_and_does_not_bias_the_damping():
    late = replace(
        layout(),
        sensors=tuple(
            replace(sensor, delay=25e-6 * (sensor.kind is ACCELERATION))
            for sensor in layout().sensors
        ),
    )
    measured = record(BROADBAND, late, declared=layout())
    delay = shared_unknown(layout(), SensorQuantity.DELAY, ACCELERATION)
    start = perturbed(stiffness=0.02, damping=0.05)
    fit = fit_likelihood(start, [measured], (delay,))
    assert fit.sensor_values[0] == pytest.approx(25e-6, abs=1e-6)
    assert abs(fit.sensor_values[0] - 25e-6) < 4 * fit.sensor_deviations[0]
    assert np.sum(scores(fit) ** 2) < 39
    without = fit_likelihood(start, [measured])
    assert without.excess > 100
    assert 'times the noise' in without.reason


def test_offset_and_gain_of_a_sensor_are_found():
    name = 'knee_displacement_0x'
    wrong = Layout(
        tuple(
            replace(one, offset=3e-7, gain=1.02) if one.name == name else one
            for one in layout().sensors
        )
    )
    measured = record(BROADBAND, wrong, declared=layout(), duration=0.1)
    unknowns = tuple(
        SensorUnknown(one, (name,)) for one in (SensorQuantity.OFFSET, SensorQuantity.GAIN)
    )
    fit = fit_likelihood(perturbed(stiffness=0.02, damping=0.05), [measured], unknowns)
    errors = (fit.sensor_values - [3e-7, 0.02]) / fit.sensor_deviations
    assert np.all(np.abs(errors) < 4)
    assert fit.sensor_deviations[1] < 2e-3


def test_a_known_delay_and_lost_samples_do_no_harm():
    late = replace(
        layout(),
        sensors=tuple(
            replace(
                sensor,
                delay=0.37e-3 if sensor.kind is DISPLACEMENT else 0.0,
                dropout_probability=0.0 if sensor.excitation else 0.02,
            )
            for sensor in layout().sensors
        ),
    )
    measured = record(BROADBAND, late)
    measured.samples[500:503, 0] = np.nan  # of the force, bridged
    fit = fit_likelihood(perturbed(stiffness=0.02, damping=0.05), [measured])
    assert fit.converged
    assert abs(fit.excess) < 4
    assert np.sum(scores(fit) ** 2) < 39


def test_sensors_that_do_not_see_all_coordinates_suffice():
    partial = Layout(
        tuple(
            sensor
            for sensor in layout().sensors
            if sensor.excitation or (sensor.kind is DISPLACEMENT) == (sensor.body == 'column')
        )
    )
    fit = fit_likelihood(perturbed(), [record(BROADBAND, partial)])
    assert fit.converged, fit.reason
    assert np.sum(scores(fit) ** 2) < 39


def test_two_records_of_different_layouts_tell_more_than_each():
    accelerations = Layout(tuple(s for s in layout().sensors if s.kind is not DISPLACEMENT))
    records = [
        record(BROADBAND, layout(), 1, duration=0.1),
        record(HARMONIC, accelerations, 2, duration=0.1),
    ]
    start = perturbed(stiffness=0.02, damping=0.05)
    both = fit_likelihood(start, records)
    one = fit_likelihood(start, records[:1])
    assert both.converged
    assert np.sum(scores(both) ** 2) < 39
    assert np.all(both.standard_deviations < one.standard_deviations)


def test_what_the_data_cannot_tell_is_named():
    # Two springs side by side: only their sum acts.
    second = replace(oscillator(stiffness=unknown(2e5)).joints[0], name='second')
    machine = oscillator(stiffness=unknown(3e5), damping=known(100.0), more_joints=(second,))
    model = assemble(machine)
    signal = multisine(100.0, (5.0, 100.0), 1.0, np.random.default_rng(1))
    measured = record(signal, line_layout(noise=1e-8), model=model, rate=2000.0, duration=0.5)
    start = model.with_values(
        np.where([p.estimated for p in model.parameters], 2.6e5, model.values)
    )
    fit = fit_likelihood(start, [measured])
    assert fit.converged
    assert fit.free.all()
    assert fit.null_space.shape == (2, 1)
    assert fit.null_space[0, 0] == pytest.approx(-fit.null_space[1, 0])
    assert fit.values.sum() == pytest.approx(5e5, rel=1e-3)
    assert np.isnan(fit.standard_deviations).all()


def test_a_search_that_is_cut_short_says_so():
    settings = LikelihoodSettings(iterations=1, pieces=False)
    fit = fit_likelihood(
        perturbed(), [record(BROADBAND, layout(), duration=0.05)], settings=settings
    )
    assert not fit.converged
    assert 'not converged: after 1 iterations' in fit.reason


def test_noise_that_is_not_stated_is_estimated_and_residuals_are_returned():
    silent = Layout(
        tuple(
            replace(one, noise=float('nan')) if not one.excitation else one
            for one in layout().sensors
        )
    )
    measured = record(BROADBAND, layout(), duration=0.1)
    fit = fit_likelihood(
        perturbed(stiffness=0.01, damping=0.02),
        [MeasuredRecord(silent, RATE, measured.samples)],
        settings=LikelihoodSettings(keep_residuals=True),
    )
    assert not fit.noise_known
    assert np.nanstd(fit.residuals[0]) == pytest.approx(1.0, abs=0.05)
    assert len(fit.residuals[0]) == 1000 - 2 * fit.first_samples[0]


def test_records_that_cannot_be_fitted_are_refused():
    with pytest.raises(DataError, match='no record'):
        fit_likelihood(MODEL, [])
    measured = record(BROADBAND, layout(), duration=0.05)
    with pytest.raises(DataError, match='too few'):
        MeasuredRecord(layout(), RATE, measured.samples[:20])
    with pytest.raises(DataError, match='shape'):
        MeasuredRecord(layout(), RATE, measured.samples[:, 1:])
    holed = MeasuredRecord(layout(), RATE, measured.samples.copy())
    holed.samples[200:210, 0] = np.nan
    with pytest.raises(DataError, match='from sample 200 on'):
        fit_likelihood(MODEL, [holed])
    mixed = Layout(
        tuple(replace(s, noise=0.0) if s.name.endswith('0x') else s for s in layout().sensors)
    )
    with pytest.raises(LayoutError, match='noise is 0 while other'):
        fit_likelihood(MODEL, [MeasuredRecord(mixed, RATE, measured.samples)])
    with pytest.raises(LayoutError, match='cannot be an unknown'):
        fit_likelihood(MODEL, [measured], (SensorUnknown(SensorQuantity.GAIN, ('exciter_cell',)),))


def test_opposite_side_faces_on_one_line_share_their_damping():
    faces = {'slideway_8': (-0.19, 1.0), 'slideway_9': (0.19, -1.0)}
    machine = replace(
        MACHINE,
        joints=tuple(
            replace(
                joint,
                point=np.array([0.19, faces[joint.name][0], 0.8]),
                normal=np.array([0.0, faces[joint.name][1], 0.0]),
            )
            if joint.name in faces
            else joint
            for joint in MACHINE.joints
        ),
    )
    model = assemble(machine)
    fit = fit_likelihood(
        perturbed(model, 0.02, 0.05), [record(BROADBAND, layout(), model=model, duration=0.1)]
    )
    names = [model.parameters[index].name for index in model.estimated]
    free = [name for name, one in zip(names, fit.free, strict=True) if one]
    assert free == [f'slideway_{i}.normal_hysteretic_damping' for i in (8, 9)]
    assert fit.null_space.shape == (16, 1)
    np.testing.assert_allclose(np.sum(fit.values[fit.free]), 4.8e7, rtol=0.05)
    assert np.isfinite(fit.standard_deviations).sum() == 14
