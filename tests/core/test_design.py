# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What planned runs would tell, against recomputed information, fits and closed forms."""

from dataclasses import replace

from identnl_ros.core.design.design import expectation, outlook
from identnl_ros.core.design.fisher import expected_information
from identnl_ros.core.design.plan import Plan
from identnl_ros.core.design.plan_search import compare
from identnl_ros.core.design.planned_run import PlannedRun
from identnl_ros.core.design.sensor_choice import sensor_importances
from identnl_ros.core.design.sensor_information import sensor_information
from identnl_ros.core.errors import LayoutError, MachineError
from identnl_ros.core.likelihood.likelihood import fit_likelihood
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.simulation.excitation import multisine, sine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.core.machines import (
    known,
    line_layout,
    ORIGIN,
    oscillator,
    slideway,
    truth_of,
    unknown,
    Z,
)
from tests.reference_machines import complete_layout, knee_and_column

RATE = 1000.0
MULTISINE = multisine(50.0, (5.0, 80.0), 0.5, np.random.default_rng(1))
HARDENING = assemble(oscillator(known(10.0), unknown(4e5), unknown(200.0), cubic=unknown(1e12)))
LINEAR = assemble(oscillator(known(10.0), unknown(4e5), unknown(200.0)))


def planned(signal=MULTISINE, duration=0.5, amplitude=50.0, cycle=0.5, **changes):
    settings = {'sample_rate': RATE, 'settling': 0.5} | changes
    return Plan(
        'multisine', (signal,), {'exciter': amplitude}, (5.0, 80.0), cycle,
        duration=duration, **settings,
    )  # fmt: skip


def deviations(information):
    return np.sqrt(np.diag(information.solve().inverse))


def expected(found):
    return np.array([one.standard_deviation for one in found.expectation.parameters])


def twins(noise=1e-6):
    one = line_layout(noise=noise)
    sensors = [sensor for sensor in one.sensors if not sensor.excitation]
    return Layout(
        (*one.sensors, *(replace(sensor, name=f'{sensor.name}_twin') for sensor in sensors))
    )


def two_springs():
    """Two springs side by side: only their sum acts."""
    second = replace(oscillator(stiffness=unknown(2e5)).joints[0], name='second')
    return assemble(oscillator(known(10.0), unknown(3e5), more_joints=(second,)))


def test_a_sensor_measured_twice_tells_twice_as_much():
    run = PlannedRun(HARDENING, twins(), (MULTISINE,), RATE, 0.5, 0.2)
    sensors = sensor_information(run)
    half = len(sensors.channels) // 2
    alone, both = sensors.together(range(half)), sensors.together()
    np.testing.assert_allclose(deviations(both), deviations(alone) / np.sqrt(2), rtol=1e-9)
    same = expected_information(HARDENING, line_layout(noise=1e-6), (MULTISINE,), RATE, 0.5, 0.2)
    np.testing.assert_allclose(deviations(alone), deviations(same), rtol=1e-9)


def test_information_without_a_sensor_is_that_of_the_layout_without_it():
    machine = knee_and_column()
    model = assemble(machine)
    kinds = (SensorKind.DISPLACEMENT, SensorKind.ACCELERATION)
    layout = complete_layout(machine, 1e-8, 0.01, kinds=kinds)
    signal = multisine(1000.0, (5.0, 300.0), 0.1, np.random.default_rng(1))
    sensors = sensor_information(PlannedRun(model, layout, (signal,), 1e4, 0.05))
    everything = range(len(sensors.channels))
    without = list(sensors.without_each(everything))
    for place in (0, 20):
        channel = sensors.channels[place]
        rest = Layout(tuple(one for i, one in enumerate(layout.sensors) if i != channel))
        again = expected_information(model, rest, (signal,), 1e4, 0.05)
        np.testing.assert_allclose(deviations(without[place]), deviations(again), rtol=1e-6)
    chosen = [i for i in everything if i != 35]
    np.testing.assert_allclose(
        deviations(without[35]), deviations(sensors.together(chosen)), rtol=1e-6
    )


def test_fits_of_a_hardening_oscillator_scatter_as_expected():
    # The bound takes the force as exact.
    layout = line_layout(noise=dict.fromkeys(SensorKind, 1e-5) | {SensorKind.FORCE: 0.0})
    found = outlook(HARDENING, layout, planned(duration=0.5))
    # The fit needs a few samples on either side.
    margin = 20
    count, settled = round(0.5 * RATE) + 2 * margin, round(0.5 * RATE) - margin
    scores = []
    for seed in range(50):
        stand = SimulatedStand(HARDENING, layout, (MULTISINE,), RATE, seed, 1)
        samples = stand.read(settled + count).samples[settled:]
        fit = fit_likelihood(HARDENING, [MeasuredRecord(layout, RATE, samples)])
        scores.append((fit.values - truth_of(HARDENING)) / expected(found))
    ratio = np.sqrt(np.mean(np.square(scores), axis=0))
    # Standard error of a root mean square of 50: 10 %.
    assert np.all((ratio > 0.7) & (ratio < 1.35)), ratio


def test_information_grows_with_time_and_scaling_errs_to_the_safe_side():
    layout = line_layout(noise=1e-6)
    for model, most in ((LINEAR, 1.08), (HARDENING, 1.6)):
        short = outlook(model, layout, planned(duration=0.5))
        long = outlook(model, layout, planned(duration=2.0))
        scaled = short.lasting(2.0)
        np.testing.assert_allclose(expected(scaled), expected(short) / 2)
        ratio = expected(scaled) / expected(long)
        assert np.all((ratio >= 1 - 1e-6) & (ratio < most)), ratio
    cut = outlook(HARDENING, layout, planned(duration=2.0), at_most=0.4)
    assert cut.computed == 0.5
    np.testing.assert_allclose(expected(cut), expected(scaled))


def test_duration_needed_brings_every_error_under_the_wanted_one():
    layout = line_layout(noise=1e-6)
    found = outlook(HARDENING, layout, planned())
    wanted = found.expectation.worst / 3.1
    needed = found.duration_needed(wanted)
    assert needed == pytest.approx(5.0)  # 9.61 times half a second, in whole cycles
    assert found.lasting(needed).expectation.meets(wanted)
    assert not found.lasting(needed - 0.5).expectation.meets(wanted)


def test_side_faces_on_one_line_determine_the_sum_of_their_dampings():
    faces = {'slideway_8': (-0.19, 1.0), 'slideway_9': (0.19, -1.0)}
    machine = knee_and_column()
    joints = tuple(
        replace(
            joint,
            point=np.array([0.19, faces[joint.name][0], 0.8]),
            normal=np.array([0.0, faces[joint.name][1], 0.0]),
        )
        if joint.name in faces
        else joint
        for joint in machine.joints
    )
    model = assemble(replace(machine, joints=joints))
    kinds = (SensorKind.DISPLACEMENT, SensorKind.ACCELERATION)
    layout = complete_layout(machine, 1e-8, 0.01, kinds=kinds)
    signal = multisine(1000.0, (5.0, 300.0), 0.1, np.random.default_rng(1))
    found = outlook(model, layout, planned(signal, 0.1, 1000.0, 0.1, sample_rate=1e4, settling=0))
    lost = [one.name for one in found.expectation.parameters if not one.identifiable]
    assert lost == [f'slideway_{i}.normal_hysteretic_damping' for i in (8, 9)]
    assert [one.in_words for one in found.expectation.combinations] == [' + '.join(lost)]
    assert np.isinf(found.duration_needed(0.5))
    assert np.isfinite(expected(found)).sum() == 14


def test_sensors_are_ranked_by_what_is_lost_without_them():
    good = line_layout(noise=1e-7)
    motion = next(one for one in good.sensors if one.kind is SensorKind.DISPLACEMENT)
    others = tuple(replace(motion, name=f'poor_{i}', noise=1e-5) for i in range(3))
    force = tuple(one for one in good.sensors if one.excitation)
    layout = Layout((*force, *others, motion))
    found = outlook(LINEAR, layout, planned())
    ranked = sensor_importances(LINEAR, found.sensors)
    names = [layout.sensors[one.channel].name for one in ranked]
    assert names[0] == motion.name
    assert ranked[0].essential
    assert not ranked[0].spared
    # Three sensors of a hundred times the noise: 10000 + 3 parts of information become 3.
    assert ranked[0].growth == pytest.approx(np.sqrt(10003 / 3) - 1, rel=1e-6)
    assert all(one.spared and not one.essential for one in ranked[1:])


def test_the_only_sensor_is_essential():
    sensors = [one for one in line_layout(noise=1e-7).sensors if one.kind in
               (SensorKind.FORCE, SensorKind.DISPLACEMENT)]  # fmt: skip
    layout = Layout(tuple(sensors))
    (only,) = sensor_importances(LINEAR, outlook(LINEAR, layout, planned()).sensors)
    assert only.growth == np.inf
    assert only.essential
    assert not only.spared


def test_the_shortest_plan_is_advised_and_stronger_ones_are_not():
    layout = line_layout(noise=1e-6)
    signals = {size: multisine(size, (5.0, 80.0), 0.5, np.random.default_rng(1))
               for size in (20.0, 60.0, 180.0)}  # fmt: skip
    plans = [planned(signal, 0.5, size, advisable=size < 100) for size, signal in signals.items()]
    worst = outlook(LINEAR, layout, plans[1]).expectation.worst
    found = compare(LINEAR, layout, plans, worst / 2.1)
    assert found.met
    assert found.best is found.candidates[1]
    assert found.best.needed == pytest.approx(2.5)
    # Of a linear machine: nine times as long at a third of the force.
    assert found.candidates[0].needed == pytest.approx(20.0)
    assert found.candidates[2].needed == pytest.approx(0.5)
    assert not compare(LINEAR, layout, plans, worst / 2.1, longest=1.0).met


def test_a_run_shorter_than_the_one_computed_is_computed_again():
    layout = line_layout(noise=1e-6)
    tone = planned(sine(50.0, 40.0), 0.5, 50.0, cycle=0.025)
    wanted = outlook(LINEAR, layout, tone).expectation.worst * 2.5
    found = compare(LINEAR, layout, [tone], wanted).best
    assert found.needed < 0.5
    assert found.outlook.computed == found.needed
    again = expected_information(LINEAR, layout, tone.signals, RATE, found.needed, 0.5)
    assert np.max(deviations(again) / truth_of(LINEAR)) <= wanted


def test_what_no_duration_determines_is_not_attainable():
    found = compare(two_springs(), line_layout(noise=1e-6), [planned()], 0.5)
    assert not found.attainable
    assert not found.met
    (combination,) = found.best.outlook.expectation.combinations
    assert combination.in_words == 'spring.stiffness + second.stiffness'


def test_relief_of_a_contact_is_that_of_the_static_law():
    # a ((d + x)^2 - d^2) = -F; at F = a d^2 / 2 the compression d falls to d / sqrt(2).
    preload, stiffness = 1e-6, 4e13
    joint = slideway(
        normal_stiffness=unknown(stiffness), normal_damping=known(5e3), coupled=False,
        preload=preload,
    )  # fmt: skip
    body = Body('block', known(10.0), ORIGIN, None, ('translation_3',))
    machine = Machine(
        'block', (body,), (joint,), (ExcitationPoint('exciter', 'block', ORIGIN, Z),)
    )
    layout = Layout(
        tuple(
            replace(one, direction=Z) if one.kind is SensorKind.DISPLACEMENT else one
            for one in line_layout(noise=1e-9).sensors
            if one.kind in (SensorKind.FORCE, SensorKind.DISPLACEMENT)
        )
    )
    signal = sine(stiffness * preload**2 / 2, 1.0)
    plan = planned(signal, 1.0, 20.0, cycle=1.0, settling=0.0)
    found = outlook(assemble(machine), layout, plan)
    assert found.relief['slide'] == pytest.approx(1 - np.sqrt(0.5), rel=2e-3)
    assert found.keeps_contact


def test_parameters_without_a_value_or_a_sensor_noise_are_refused():
    layout = line_layout(noise=1e-6)
    with pytest.raises(MachineError, match='no value to simulate with; give the machine file one'):
        outlook(assemble(oscillator(stiffness=unknown())), layout, planned())
    with pytest.raises(MachineError, match='nothing is to be estimated'):
        outlook(assemble(oscillator()), layout, planned())
    with pytest.raises(MachineError, match='no exciter'):
        outlook(assemble(replace(oscillator(stiffness=unknown(4e5)), excitations=())), layout,
                planned())  # fmt: skip
    with pytest.raises(LayoutError, match='expected a positive number'):
        outlook(LINEAR, line_layout(noise=0.0), planned())


def test_a_value_of_zero_has_no_relative_error():
    model = assemble(oscillator(known(10.0), unknown(4e5), unknown(200.0), cubic=unknown(0.0)))
    information = expected_information(model, line_layout(noise=1e-6), (MULTISINE,), RATE, 0.5)
    found = expectation(model, information)
    (zero,) = (one for one in found.parameters if one.value == 0)
    assert np.isnan(zero.relative)
    assert zero.standard_deviation > 0
    assert found.meets(found.worst)
    assert found.bottleneck is not zero
