# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Periodic forces and drifting stiffness: simulated, differentiated, identified, refused."""

from dataclasses import replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.estimation.identifier import identifier_for
from identnl_ros.core.likelihood.likelihood import fit_likelihood
from identnl_ros.core.likelihood.likelihood_estimate import likelihood_estimate
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.motion_record import records_of
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.machine import Body
from identnl_ros.core.mechanics.periodic_force import PeriodicForce
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.simulation.simulation import Simulation, steps_per_sample
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.simulation.tangent_response import TangentResponse
from identnl_ros.core.weak.rough_start import rough_start
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.core.element_cases import DAMPING, element, MASS, STIFFNESS
from tests.core.machines import (
    blocks_of,
    deviations_of,
    known,
    line_layout,
    motion_of,
    ORIGIN,
    oscillator,
    unknown,
    values_of,
    X,
    Z,
)

SIGNAL = multisine(5.0, (5.0, 60.0), 0.5, np.random.default_rng(3))
INTERVAL = 1e-3
COSINE, SINE, FREQUENCY, DRIFT = 3.0, -2.0, 37.3, 2e5
D, A, F = SensorKind.DISPLACEMENT, SensorKind.ACCELERATION, SensorKind.FORCE


def hum(make=known, frequency=FREQUENCY):
    return PeriodicForce(
        'hum', 'block', ORIGIN, X, make(COSINE), make(SINE), make(frequency)
    )  # fmt: skip


def model_of(make=known, drifting=True, periodic=True, spring=None):
    more = (element('drifting_stiffness', make(DRIFT), 'drift'),) if drifting else ()
    forces = (hum(make),) if periodic else ()
    return assemble(oscillator(stiffness=spring, forces=forces, more_joints=more))


def varied(model, count, start=0.0, origin=0.0, sensitive=True, steps=1, state=(0.0, 0.0)):
    place, rate = (np.array([one]) for one in state)
    return VariedSimulation(
        model, (SIGNAL,), INTERVAL, place, rate,
        start=start, origin=origin, sensitive=sensitive, steps=steps,
    ).advance(count)  # fmt: skip


def independent(count, drift=DRIFT, cosine=COSINE, sine=SINE):
    """Integrate the oscillator with scipy, the equations written anew."""

    def slopes(time, scaled):
        place, rate = scaled[0] * 1e-6, scaled[1] * 1e-4
        angle = 2 * np.pi * FREQUENCY * time
        force = SIGNAL.on_grid(time, 1.0, 1)[0] + cosine * np.cos(angle) + sine * np.sin(angle)
        force -= (STIFFNESS + drift * time) * place + DAMPING * rate
        return rate / 1e-6, force / MASS / 1e-4

    found = solve_ivp(
        slopes, (0, (count - 1) * INTERVAL), np.zeros(2), method='DOP853',
        t_eval=np.arange(count) * INTERVAL, rtol=1e-11, atol=1e-9, max_step=INTERVAL,
    )  # fmt: skip
    assert found.success
    return found.y[0] * 1e-6, found.y[1] * 1e-4


def test_simulation_follows_an_independent_integrator():
    model = model_of()
    steps = steps_per_sample(model, np.zeros((1, 1)), INTERVAL)
    run = Simulation(model, (SIGNAL,), INTERVAL, np.zeros(1), np.zeros(1), steps)
    parts = [run.advance(count) for count in (70, 230)]
    expected = independent(300)
    for i in range(2):
        found = np.concatenate([one[i][0, :, 0] for one in parts])
        np.testing.assert_allclose(found, expected[i], atol=1e-8 * np.abs(expected[i]).max())


@pytest.mark.parametrize('part', ['drift', 'hum'])
def test_every_part_matters_in_these_runs(part):
    whole = independent(300)[0]
    without = independent(300, drift=0)[0] if part == 'drift' else independent(300, DRIFT, 0, 0)[0]
    assert np.abs(whole - without).max() > 0.05 * np.abs(whole).max()


def test_motion_between_samples_has_its_own_time():
    model = model_of()
    run = Simulation(model, (SIGNAL,), INTERVAL, np.zeros(1), np.zeros(1), 2)
    displacement, velocity, acceleration = run.advance(200, (0.0, 0.5))
    fine = Simulation(model, (SIGNAL,), INTERVAL / 2, np.zeros(1), np.zeros(1), 1)
    motion = displacement, velocity, acceleration
    for found, expected in zip(motion, fine.advance(400), strict=True):
        joined = np.stack((found[0], found[1]), axis=1).reshape(400, 1)
        np.testing.assert_allclose(joined, expected[0], atol=1e-7 * np.abs(expected).max())


def test_time_counts_from_the_begin_of_the_stream():
    model = model_of()
    whole = varied(model, 200, sensitive=False).motion[:, :, 0]
    state = whole[120, 0], whole[120, 1]
    later = varied(model, 80, start=0.12, sensitive=False, state=state).motion[:, :, 0]
    np.testing.assert_allclose(later, whole[120:], atol=1e-7 * np.abs(whole).max(axis=0).max())
    free = assemble(replace(model.machine, excitations=()))
    run = {'sensitive': False, 'interval': INTERVAL, 'model': free, 'signals': ()}
    zero = {'displacement': np.zeros(1), 'velocity': np.zeros(1)}
    begun, moved = (
        VariedSimulation(**run, **zero, start=start, origin=origin).advance(50).motion
        for start, origin in ((0.4, 0.0), (0.1, 0.3))
    )
    np.testing.assert_allclose(moved, begun, rtol=1e-9, atol=1e-12)


def test_moment_turns_a_body_and_harmonics_follow_their_root():
    body = Body('block', known(2.0), ORIGIN, np.diag((1.0, 2.0, 3.0)), ('rotation_3',))
    first = PeriodicForce('hum', 'block', ORIGIN, Z, known(3.0), known(0.0), unknown(10.0),
                          moment=True)  # fmt: skip
    second = replace(first, name='buzz', frequency=Coefficient(tie=Tie('hum.frequency', 2.0)))
    machine = replace(oscillator(), bodies=(body,), excitations=(), forces=(first, second))
    model = assemble(machine)
    assert [one.unit for one in model.parameters if one.symbol == 'F_cos'] == ['N*m', 'N*m']
    time = np.linspace(0, 0.3, 7)
    for frequency in (10.0, 11.0):
        now = model.with_unknowns(np.array([frequency]))
        expected = 3 * np.cos(2 * np.pi * frequency * time)
        expected += 3 * np.cos(4 * np.pi * frequency * time)
        np.testing.assert_allclose(now.periodic_load(time)[:, 0], expected, atol=1e-12)
    assert static_equilibrium(model) == 0


def test_force_derivatives_are_differences_of_forces():
    model = model_of(unknown)
    generator = np.random.default_rng(1)
    displacement = 1e-6 * generator.standard_normal((40, 1))
    time = np.sort(generator.uniform(0, 2, 40))
    still = np.zeros_like(displacement)
    found = ForceDerivatives(model).of_motion(displacement, still, still, time=time)
    for column, index in enumerate(model.estimated):
        change = 1e-5 * model.values[index]
        forces = []
        for sign in (1, -1):
            values = model.values
            values[index] += sign * change
            moved = model.with_values(values)
            forces.append(
                moved.joint_force(displacement, still, time=time) - moved.periodic_load(time)
            )
        expected = (forces[0] - forces[1]) / (2 * change)
        np.testing.assert_allclose(
            found[:, :, column], expected, atol=1e-5 * np.abs(expected).max()
        )


def test_sensitivities_are_those_of_simulations_nearby():
    model = model_of(unknown)
    found = varied(model, 300, steps=2)
    motion = varied(model, 301, steps=2).motion
    response = TangentResponse(model, INTERVAL)
    parts = [
        response.advance(*(motion[first : end + 1, i] for i in range(3)))
        for first, end in ((0, 100), (100, 300))
    ]
    assert response.time == pytest.approx(0.3)
    response = np.concatenate(parts)[:, :, 0]
    for column, index in enumerate(model.estimated):
        change = 1e-5 * model.values[index]
        runs = []
        for sign in (1, -1):
            values = model.values
            values[index] += sign * change
            runs.append(varied(model.with_values(values), 300, steps=2, sensitive=False).motion)
        expected = (runs[0] - runs[1])[:, :, 0] / (2 * change)
        size = np.abs(expected).max(axis=0)
        assert (np.abs(found.derivatives[:, :, 0, column] - expected) < 1e-5 * size).all()
        assert (np.abs(response[:, :, column] - expected) < 5e-3 * size).all()


def test_likelihood_recovers_amplitude_frequency_and_drift():
    truth = model_of(unknown, spring=unknown(STIFFNESS))
    layout = line_layout(kinds=(D, A), noise={F: 0.0, D: 0.0, A: 0.0})
    stand = SimulatedStand(truth, layout, (SIGNAL,), 1 / INTERVAL, 1, 1)
    record = MeasuredRecord(layout, 1 / INTERVAL, stand.read(1000).samples)
    expected = truth.values[list(truth.estimated)]
    start = truth.with_unknowns(expected * np.array([0.3, 1.5, 1.001, 1.1, 0.2]))
    names = [truth.parameters[i].name for i in truth.estimated]
    assert names == [
        'hum.cosine', 'hum.sine', 'hum.frequency', 'spring.stiffness', 'drift.stiffness_rate'
    ]  # fmt: skip
    # A part of a stream knows when it was measured.
    for one in (record, record.part(400, 1000)):
        fit = fit_likelihood(start, [one])
        assert fit.converged, fit.reason
        np.testing.assert_allclose(fit.values, expected, rtol=1e-6)


def test_noisy_data_give_estimates_within_their_standard_errors():
    truth = model_of(unknown, spring=unknown(STIFFNESS))
    layout = line_layout(kinds=(D, A), noise={F: 1e-2, D: 1e-8, A: 1e-3})
    stand = SimulatedStand(truth, layout, (SIGNAL,), 1 / INTERVAL, 1, 1)
    record = MeasuredRecord(layout, 1 / INTERVAL, stand.read(1500).samples).part(200, 1500)
    expected = truth.values[list(truth.estimated)]
    start = truth.with_unknowns(expected * np.array([0.5, 1.2, 1.0005, 1.1, 0.5]))
    estimate = likelihood_estimate(start, [record])
    assert {one.status for one in estimate.parameters} == {EstimateStatus.OK}
    errors = (values_of(estimate) - expected) / deviations_of(estimate)
    assert (np.abs(errors) < 4).all(), errors
    assert (deviations_of(estimate) < 0.05 * np.abs(expected)).all()


@pytest.mark.parametrize('memory', [None, 1.0])
def test_weak_estimator_finds_them_along_a_stream(memory):
    truth = model_of(unknown, spring=unknown(STIFFNESS))
    layout = line_layout(kinds=(D, A), noise={F: 0.0, D: 1e-8, A: 1e-3})
    # One in a hundred draws of the noise is doubted by chance: not this one.
    samples = SimulatedStand(truth, layout, (SIGNAL,), 1 / INTERVAL, 2, 1).read(3000).samples
    samples[1400:1500] = np.nan
    expected = truth.values[list(truth.estimated)]
    start = truth.with_unknowns(np.array([np.nan, np.nan, 1.0003 * FREQUENCY, np.nan, np.nan]))
    identifier = identifier_for(start, 'weak', memory)
    for motion in motion_of(truth, layout, blocks_of(samples, 1 / INTERVAL, (900, 900))):
        identifier.add(motion)
    estimate = identifier.estimate()
    assert {one.status for one in estimate.parameters} == {EstimateStatus.OK}
    errors = (values_of(estimate) - expected) / deviations_of(estimate)
    assert (np.abs(errors) < 4).all(), errors
    assert (deviations_of(estimate) < 0.05 * np.abs(expected)).all()


def test_rough_start_knows_the_time():
    truth = model_of(unknown, spring=unknown(STIFFNESS))
    layout = line_layout(kinds=(D, A), noise={F: 0.0, D: 1e-9, A: 1e-4})
    stand = SimulatedStand(truth, layout, (SIGNAL,), 1 / INTERVAL, 1, 1)
    record = MeasuredRecord(layout, 1 / INTERVAL, stand.read(1500).samples).part(300, 1500)
    found = rough_start(truth.with_unknowns(np.array([1.0, 1.0, FREQUENCY, 1.0, 1.0])), record)
    np.testing.assert_allclose(found.values, truth.values, rtol=0.05)


def test_motion_records_know_their_place_in_the_stream():
    model = model_of(periodic=False, drifting=False)
    layout = line_layout(kinds=(D, A), noise={F: 0.0, D: 1e-9, A: 1e-4})
    samples = SimulatedStand(model, layout, (SIGNAL,), 1 / INTERVAL, 1, 1).read(400).samples
    samples[200, 0] = np.nan
    motions = motion_of(model, layout, blocks_of(samples, 1 / INTERVAL, (150, 150)))
    for motion in motions:
        for record in records_of(motion, model.excitation_directions):
            if len(record) > 10:
                part = record.part(7, 10).followed_by(record.part(10, 11))
                first = round(part.time[0] / INTERVAL) - motion.first_index
                np.testing.assert_array_equal(
                    part.displacement, motion.displacement[first : first + 4]
                )


def test_what_does_not_know_the_time_says_so():
    model = model_of(unknown)
    still = np.zeros((3, 1))
    with pytest.raises(MachineError, match='time, which is not known'):
        ForceDerivatives(model).of_motion(still, still, still)
    with pytest.raises(MachineError, match='time, which is not known'):
        model.joint_force(still, still)
    drifting = model_of(unknown, periodic=False)
    with pytest.raises(MachineError, match=r'pointwise .*; use weak or likelihood'):
        identifier_for(drifting, 'pointwise')


def test_frequency_must_be_positive():
    with pytest.raises(MachineError, match=r'force hum: frequency is -1\.0 Hz, expected more'):
        hum(frequency=-1.0)
    model = model_of(unknown)
    with pytest.raises(MachineError, match=r'frequency is 0\.0 Hz'):
        model.with_unknowns(np.array([1.0, 1.0, 0.0, 1.0]))
