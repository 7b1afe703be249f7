# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A late channel of a bag is found and the cost of its delay told."""

from dataclasses import replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.sources.delay_check import check_delays
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
import pytest

from tests.core.machines import blocks_of, oscillator
from tests.core.stream_runs import A, D, F, MODEL, motion, V

RATE = 5000.0
KINDS = (D, D, A, A)
LAYOUT = Layout(
    (
        Sensor('cell', F, excitation='exciter', noise=0.1),
        *(
            Sensor(f'{kind.value}_{i}', kind, 'block', noise={D: 1e-9, A: 1e-3}[kind])
            for i, kind in enumerate(KINDS)
        ),
    )
)


def settling(kind, time, begin=0.6, end=1.19):
    """Motion that comes to rest: its product with an envelope, differentiated as a product."""
    phase = np.pi * np.clip((time - begin) / (end - begin), 0, 1)
    rate = np.pi / (end - begin) * ((time > begin) & (time < end))
    envelope = (8 + 9 * np.cos(phase) - np.cos(3 * phase)) / 16
    slope = rate * (-9 * np.sin(phase) + 3 * np.sin(3 * phase)) / 16
    bend = rate**2 * (-9 * np.cos(phase) + 9 * np.cos(3 * phase)) / 16
    place, speed, acceleration = (motion(one, time, 0.14) for one in (D, V, A))
    if kind is D:
        return place * envelope
    return acceleration * envelope + 2 * speed * slope + place * bend


@pytest.fixture
def bag(tmp_path):
    """Write a bag whose second accelerometer is late, or has another fault."""

    def make(delay, stated=0.0, seed=1, amplitude=0.14, rest=0, fault=None):
        generator = np.random.default_rng(seed)
        time = np.arange(6000) / RATE
        noise = np.array([sensor.noise for sensor in LAYOUT.sensors])
        samples = noise * generator.standard_normal((len(time) + rest, 5))
        for i, kind in enumerate(KINDS, 1):
            moved = time - delay * (i == 4)
            samples[: len(time), i] += (
                settling(kind, moved) if rest else motion(kind, moved, amplitude)
            )
        if fault is not None:
            fault(samples)
        path = tmp_path / f'{delay}_{stated}_{seed}_{amplitude}_{rest}_{id(fault)}.mcap'
        last = replace(LAYOUT.sensors[4], delay=stated)
        layout = replace(LAYOUT, sensors=(*LAYOUT.sensors[:4], last))
        with BagWriter(path) as writer:
            writer.write_description(StandDescription('stand', 1, RATE, layout))
            for block in blocks_of(samples, RATE, [500] * (len(samples) // 500 - 1)):
                writer.write_block(block)
        return path

    return make


def test_late_channel_is_found_and_its_cost_told(bag):
    found = check_delays(bag(50e-6), MODEL)
    assert [one.name for one in found.channels] == [one.name for one in LAYOUT.sensors[1:]]
    truth = 50e-6 * np.array([0, 0, 0, 1.0])
    delays = np.array([one.delay for one in found.channels])
    scores = (delays - truth) / [one.deviation for one in found.channels]
    assert np.abs(scores).max() < 4.5
    assert [one.late for one in found.channels] == [False, False, False, True]
    assert found.channels[3].deviation < 2e-6
    (problem,) = found.problems
    assert 'acceleration_3: is late by' in problem
    # 2 pi f delay / (2 zeta), with f = 31.83 Hz and zeta = 5 %.
    assert 'the damping of the mode at 31.83 Hz by up to 10%' in problem
    assert 'state its delay in the layout' in problem


def test_delay_that_the_layout_states_is_no_delay(bag):
    found = check_delays(bag(50e-6, stated=50e-6), MODEL)
    assert not found.problems


def test_machine_without_values_has_no_cost_but_delays(bag):
    unknown = assemble(oscillator()).with_values(np.full(len(MODEL.values), np.nan))
    (problem,) = check_delays(bag(50e-6), unknown).problems
    assert 'is late by' in problem
    assert 'damping' not in problem


def test_rest_tells_nothing(bag):
    with pytest.raises(DataError, match='no motion stands out'):
        check_delays(bag(0.0, amplitude=0.0), MODEL)


def test_a_record_that_ends_at_rest_is_judged_where_it_moves(bag):
    (problem,) = check_delays(bag(50e-6, rest=20000), MODEL).problems
    assert 'acceleration_3: is late by' in problem


def test_an_inverted_channel_makes_no_other_late(bag):
    def invert(samples):
        samples[:, 3] *= -1

    found = check_delays(bag(0.0, fault=invert), MODEL)
    assert not any('late' in one or 'early' in one for one in found.problems)
    assert any(one.startswith('acceleration_2:') for one in (*found.problems, *found.remarks))
    good = [one for one in found.channels if one.name != 'acceleration_2']
    assert all(abs(one.delay) < 4.5 * one.deviation for one in good)


def test_spikes_are_left_out_before_delays_are_told(bag):
    def spike(samples):
        samples[300:5700:300, 4] += 5.0

    found = check_delays(bag(0.0, fault=spike), MODEL)
    assert not found.problems
    assert len(found.channels) == 4


def test_two_against_two_are_not_told_apart(bag):
    def late(samples):
        time = np.arange(6000) / RATE
        samples[:, 3] += motion(A, time - 50e-6, 0.14) - motion(A, time, 0.14)

    found = check_delays(bag(50e-6, fault=late), MODEL)
    assert len(found.problems) == 2
    assert all('the sensors do not tell which' in one for one in found.problems)


def test_exchanged_channels_of_two_axes_are_refused(bag):
    def wrong(samples):
        generator = np.random.default_rng(5)
        samples[:, 3] = np.convolve(generator.standard_normal(len(samples)), np.ones(9), 'same')

    found = check_delays(bag(0.0, fault=wrong), MODEL)
    assert not any(one.late for one in found.channels)
    assert any('contradict' in one for one in (*found.problems, *found.remarks))
