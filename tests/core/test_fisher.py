# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The Cramer-Rao bound of planned runs."""

from identnl_ros.core.design.fisher import expected_information
from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.likelihood.likelihood import fit_likelihood
from identnl_ros.core.likelihood.likelihood_point import LikelihoodSettings
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.sensor_unknown import SensorQuantity, shared_unknown
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine, sine
import numpy as np
import pytest

from tests.core.machines import known, line_layout, oscillator, unknown
from tests.core.test_likelihood import BROADBAND, layout, MODEL, RATE, record, TRUTH


def deviations(information):
    return np.sqrt(np.diag(information.solve().inverse))


def test_a_fit_reports_the_errors_that_were_foretold():
    fit = fit_likelihood(
        MODEL,
        [record(BROADBAND, layout(), duration=0.1)],
        settings=LikelihoodSettings(pieces=False),
    )
    margin = fit.first_samples[0]
    foretold = expected_information(
        MODEL, layout(), (BROADBAND,), RATE, 0.1 - 2 * margin / RATE, 0.2 + margin / RATE
    )
    np.testing.assert_allclose(fit.standard_deviations, deviations(foretold), rtol=0.02)


def test_errors_of_a_linear_oscillator_scatter_as_foretold():
    model = assemble(oscillator(known(10.0), unknown(4e5), unknown(200.0)))
    signal = multisine(50.0, (5.0, 80.0), 1.0, np.random.default_rng(1))
    sensors = line_layout(noise=1e-5)
    bound = deviations(expected_information(model, sensors, (signal,), 1000.0, 0.468, 0.216))
    errors = [
        fit_likelihood(model, [record(signal, sensors, seed, 0.5, None, model, 1000.0)]).values
        / [4e5, 200.0] - 1
        for seed in range(40)
    ]  # fmt: skip
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / (bound / [4e5, 200.0])
    # Standard error of a root mean square of 40: 11 %.
    assert np.all((ratio > 0.65) & (ratio < 1.4))


def test_runs_add_up_and_noise_scales_the_bound():
    signal = sine(1000.0, 40.0)
    one = expected_information(MODEL, layout(), (signal,), RATE, 0.05)
    np.testing.assert_allclose(
        deviations(one.merged(one)), deviations(one) / np.sqrt(2), rtol=1e-6
    )
    loud = expected_information(MODEL, layout().with_noise_times(3), (signal,), RATE, 0.05)
    np.testing.assert_allclose(deviations(loud), 3 * deviations(one), rtol=1e-6)


def test_bound_of_the_reference_machine_is_that_of_the_theory():
    # 0.015 to 0.042 % for the normal stiffness in two seconds with this noise on the coordinates
    # themselves; three corner sensors a body see rotations better.
    information = expected_information(MODEL, layout(), (BROADBAND,), RATE, 0.25, 0.25)
    relative = deviations(information) / TRUTH * np.sqrt(0.25 / 2.0)
    assert np.all((relative[::4] > 1.5e-5) & (relative[::4] < 4.2e-4))


def test_an_unknown_delay_costs_exactness():
    delay = shared_unknown(layout(), SensorQuantity.DELAY, SensorKind.ACCELERATION)
    plan = (MODEL, layout(), (BROADBAND,), RATE, 0.05)
    without = expected_information(*plan)
    information = expected_information(*plan, sensor_unknowns=(delay,))
    assert information.size == 17
    assert np.all(deviations(information)[:16] >= 0.999 * deviations(without))
    assert deviations(information)[16] < 1e-6


def test_plans_without_noise_or_time_are_refused():
    with pytest.raises(LayoutError, match='expected a positive number'):
        expected_information(MODEL, layout(0.0), (BROADBAND,), RATE, 0.1)
    with pytest.raises(DataError, match='expected at least two'):
        expected_information(MODEL, layout(), (BROADBAND,), RATE, 0.0)
