# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Right models agree, wrong ones differ, and the band is as wide as the scatter it predicts."""

from dataclasses import replace

from identnl_ros.core.algebra.covariance_root import covariance_root
from identnl_ros.core.algebra.quadratic_form import tail_probability
from identnl_ros.core.errors import DataError, MachineError
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.validation.agreement import Agreement, STATED_DEGREES
from identnl_ros.core.validation.validation import Validation
import numpy as np
import pytest
from scipy import stats

from tests.core.machines import known, line_layout, oscillator, unknown
from tests.reference_machines import complete_layout, knee_and_column

RATE = 2000.0
LINE = assemble(oscillator(stiffness=unknown(4e5), damping=unknown(200.0), cubic=known(5e11)))


def probe(noise):
    """One displacement sensor and a force cell without noise."""
    return line_layout(
        kinds=(SensorKind.DISPLACEMENT,),
        noise={SensorKind.FORCE: 0.0, SensorKind.DISPLACEMENT: noise},
    )


LINE_LAYOUT = probe(1e-7)
LINE_TRUTH = np.array([4e5, 200.0])
KNEE = assemble(knee_and_column())
KNEE_SIZE = len(KNEE.estimated)


def knee_layout(force_noise=0.0):
    layout = complete_layout(
        KNEE.machine, 1e-8, 0.01, kinds=(SensorKind.DISPLACEMENT, SensorKind.ACCELERATION)
    )
    sensors = tuple(replace(s, noise=force_noise) if s.excitation else s for s in layout.sensors)
    return Layout(sensors)


def record(model, layout, seed=0, duration=0.5, rate=RATE, declared=None, amplitude=100.0):
    """Measure after a fifth of a second under a force of its own for every seed."""
    signal = multisine(amplitude, (5.0, 150.0), 1.0, np.random.default_rng(seed))
    stand = SimulatedStand(model, layout, (signal,), rate, seed, 1, declared_layout=declared)
    samples = stand.read(int((0.2 + duration) * rate)).samples[int(0.2 * rate) :]
    return MeasuredRecord(declared or layout, rate, samples)


def knee_record(layout, seed=0, declared=None, duration=0.1):
    return record(KNEE, layout, seed, duration, 1e4, declared, amplitude=1000.0)


def compared(model, measured, covariance=None, **options):
    size = len(model.estimated)
    covariance = np.zeros((size, size)) if covariance is None else covariance
    validation = Validation(model, covariance, measured.layout, measured.sample_rate, **options)
    validation.add(measured)
    return Agreement((validation.comparison(),))


def with_factor(model, index, factor):
    values = model.values
    values[model.estimated[index]] *= factor
    return model.with_values(values)


def wrong(layout, name, **changes):
    return Layout(tuple(replace(s, **changes) if s.name == name else s for s in layout.sensors))


def test_true_parameters_are_not_said_to_differ_and_probabilities_are_uniform():
    found = [compared(LINE, record(LINE, LINE_LAYOUT, seed)) for seed in range(30)]
    # At a false alarm rate of at most 1 %, two of 30 happen in less than 4 % of all such tests.
    assert [one.agrees for one in found].count(False) <= 1
    table = np.array([[test.probability for test in one.tests] for one in found])
    # Of averages; the size is compared with a noise that is stated to 10 % only.
    for column in table[:, 1:4].T:
        assert stats.kstest(column, 'uniform').pvalue > 1e-3


def test_true_parameters_agree_on_the_knee_and_column_with_noisy_force():
    for seed in range(2):
        agreement = compared(KNEE, knee_record(knee_layout(0.2), seed))
        assert agreement.agrees
        (stream,) = agreement.streams
        assert all(channel.spread > 0 for channel in stream.channels)
        assert np.mean([channel.ratio for channel in stream.channels]) == pytest.approx(1, abs=0.1)


def test_values_drawn_from_their_covariance_agree_though_the_band_is_wide_and_curved():
    generator = np.random.default_rng(0)
    covariance = np.diag((0.02 * LINE_TRUTH) ** 2)
    agree = []
    for seed in range(5):
        values = LINE.values
        values[list(LINE.estimated)] = LINE_TRUTH * (1 + 0.02 * generator.standard_normal(2))
        model = LINE.with_values(values)
        agree.append(compared(model, record(LINE, LINE_LAYOUT, seed), covariance).agrees)
    assert all(agree)


def test_noise_of_the_force_would_be_taken_for_a_difference_if_it_were_not_known():
    actual = knee_layout(20.0)
    measured = knee_record(actual, 1)
    assert compared(KNEE, measured).agrees
    silent = replace(measured, layout=knee_layout())
    assert not compared(KNEE, silent).agrees


@pytest.mark.parametrize('index', [0, 8])
def test_five_percent_of_a_normal_stiffness_are_seen(index):
    assert KNEE.parameters[KNEE.estimated[index]].symbol == 'a_n'
    agreement = compared(with_factor(KNEE, index, 1.05), knee_record(knee_layout()))
    assert not agreement.agrees


def test_an_error_within_the_uncertainty_agrees():
    model = with_factor(KNEE, 0, 1.2)
    covariance = np.zeros((KNEE_SIZE, KNEE_SIZE))
    covariance[0, 0] = (0.15 * 3.8e15) ** 2
    agreement = compared(model, knee_record(knee_layout()), covariance)
    assert agreement.agrees
    assert any(channel.band > channel.noise for channel in agreement.streams[0].channels)
    # A fifth of that uncertainty does not explain it.
    assert not compared(model, knee_record(knee_layout()), covariance / 25).agrees


@pytest.mark.parametrize(
    'changes',
    [{'gain': 1.03}, {'delay': 25e-6}, {'offset': 0.01}],
    ids=lambda one: next(iter(one)),
)
def test_a_fault_of_one_sensor_is_seen_and_the_sensor_named(changes):
    name = 'knee_acceleration_0x'
    actual = wrong(knee_layout(), name, **changes)
    agreement = compared(KNEE, knee_record(actual, declared=knee_layout()))
    assert not agreement.agrees
    (stream,) = agreement.streams
    worst = min(stream.channels, key=lambda one: (one.worst.probability, -one.worst.ratio))
    assert worst.sensor.name == name


def test_a_missing_cubic_stiffness_is_seen_beyond_the_band():
    linear = assemble(oscillator(stiffness=unknown(4.1e5), damping=unknown(200.0)))
    covariance = np.diag((0.002 * LINE_TRUTH) ** 2)
    agreement = compared(linear, record(LINE, LINE_LAYOUT), covariance)
    assert not agreement.agrees
    beyond = [test for test in agreement.tests if test.beyond_band]
    assert agreement.differs(beyond)


def test_noise_stated_three_times_too_small_is_seen_ten_percent_are_not():
    for factor, agrees in ((1.1, True), (3.0, False)):
        measured = record(LINE, LINE_LAYOUT.with_noise_times(factor), 4)
        assert compared(LINE, replace(measured, layout=LINE_LAYOUT)).agrees is agrees


def test_floor_is_noise_over_signal_and_nrmse_reaches_it():
    measured = record(LINE, LINE_LAYOUT)
    ((channel,),) = (stream.channels for stream in compared(LINE, measured).streams)
    clean = record(LINE, probe(0.0))
    signal = np.std(clean.samples[16:-16, -1])
    assert channel.floor == pytest.approx(1e-7 / signal, rel=0.01)
    assert channel.nrmse == pytest.approx(channel.floor, rel=0.1)
    unknown_noise = replace(measured, layout=probe(float('nan')))
    ((estimated,),) = (stream.channels for stream in compared(LINE, unknown_noise).streams)
    assert not estimated.noise_stated
    assert estimated.noise == pytest.approx(1e-7, rel=0.2)


def test_perfect_sensors_have_no_floor():
    clean = record(LINE, probe(0.0))
    agreement = compared(LINE, clean)
    ((channel,),) = (stream.channels for stream in agreement.streams)
    assert agreement.agrees
    assert channel.floor == 0
    assert channel.nrmse < 1e-6
    assert not compared(with_factor(LINE, 0, 1 + 1e-4), clean).agrees


def test_band_is_the_scatter_of_simulations():
    deviation = 0.01 * LINE_TRUTH
    covariance = np.outer(deviation, deviation) * [[1, -0.6], [-0.6, 1]]
    clean = record(LINE, probe(1e-8), duration=0.2)
    ((channel,),) = (s.channels for s in compared(LINE, clean, covariance).streams)
    generator = np.random.default_rng(2)
    squares = []
    for _ in range(30):
        values = LINE.values
        values[list(LINE.estimated)] = generator.multivariate_normal(LINE_TRUTH, covariance)
        # The initial state follows, as in the band.
        ((one,),) = (s.channels for s in compared(LINE.with_values(values), clean).streams)
        squares.append(one.error**2 - one.noise**2)
    # 30 draws of about two independent parts: 18 % of the mean square, 9 % of its root.
    assert np.sqrt(np.mean(squares)) == pytest.approx(channel.band, rel=0.25)


def test_traces_hold_what_was_compared():
    covariance = np.diag((0.01 * LINE_TRUTH) ** 2)
    measured = record(LINE, LINE_LAYOUT)
    validation = Validation(LINE, covariance, LINE_LAYOUT, RATE, trace_samples=5000)
    validation.add(measured)
    traces = validation.traces
    ((channel,),) = ((one,) for one in validation.comparison().channels)
    assert len(traces.time) == channel.samples
    assert np.diff(traces.time) == pytest.approx(1 / RATE)
    error = traces.measured - traces.simulated
    assert np.sqrt(np.mean(error**2)) == pytest.approx(channel.error, rel=1e-3)
    assert np.sqrt(np.mean(traces.band**2)) == pytest.approx(channel.band, rel=1e-6)
    short = Validation(LINE, covariance, LINE_LAYOUT, RATE, trace_samples=100)
    short.add(measured)
    np.testing.assert_allclose(short.traces.band, traces.band[:100])


def test_runs_add_up_and_lost_samples_are_left_out():
    validation = Validation(LINE, np.zeros((2, 2)), LINE_LAYOUT, RATE)
    whole = record(LINE, LINE_LAYOUT, duration=1.0)
    whole.samples[::7, -1] = np.nan
    for part in (whole.samples[:900], whole.samples[950:]):
        validation.add(replace(whole, samples=part))
    stream = validation.comparison()
    assert stream.runs == 2
    assert stream.samples == 2000 - 50 - 4 * 16
    assert stream.channels[0].samples == pytest.approx(stream.samples * 6 / 7, abs=2)
    assert Agreement((stream,)).agrees


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(DataError, match='no sensor of motion'):
        Validation(LINE, np.zeros((2, 2)), Layout(LINE_LAYOUT.sensors[:1]), RATE)
    with pytest.raises(DataError, match='no uninterrupted run'):
        Validation(LINE, np.zeros((2, 2)), LINE_LAYOUT, RATE).comparison()
    growing = with_factor(LINE, 1, -20.0)
    with pytest.raises(MachineError, match='grows without bound'):
        compared(growing, record(LINE, LINE_LAYOUT, duration=2.0))


def test_root_of_a_covariance_leaves_out_what_is_not_known():
    covariance = np.array([[4.0, np.nan, 1.0], [np.nan] * 3, [1.0, np.nan, 9.0]])
    root = covariance_root(covariance)
    expected = np.array([[4.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 9.0]])
    np.testing.assert_allclose(root @ root.T, expected, atol=1e-12)


@pytest.mark.parametrize('ratio', [0.3, 1.3, 3.0, 10.0])
@pytest.mark.parametrize('degrees', [(1.0, 400.0), (156.0, STATED_DEGREES), (5000.0, 1250.0)])
def test_tail_probability_is_that_of_fishers_ratio(ratio, degrees):
    upper, lower = degrees
    found = tail_probability(np.array([1.0, -ratio * upper / lower]), np.array(degrees))
    assert found == pytest.approx(stats.f.sf(ratio, upper, lower), rel=0.12, abs=1e-12)


def test_tail_probability_of_unequal_weights():
    weights, degrees = np.array([30.0, 1.0, -2.5]), np.array([1.0, 80.0, 100.0])
    draws = np.random.default_rng(1).chisquare(degrees, (200_000, 3)) @ weights
    assert tail_probability(weights, degrees) == pytest.approx(np.mean(draws > 0), rel=0.1)
