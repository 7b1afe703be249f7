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
from tests.core.stream_runs import A, D, F, MODEL, motion

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


@pytest.fixture
def bag(tmp_path):
    """Write a bag whose second accelerometer is late."""

    def make(delay, stated=0.0, seed=1, amplitude=0.14):
        generator = np.random.default_rng(seed)
        time = np.arange(6000) / RATE
        noise = np.array([sensor.noise for sensor in LAYOUT.sensors])
        samples = noise * generator.standard_normal((len(time), 5))
        for i, kind in enumerate(KINDS, 1):
            samples[:, i] += motion(kind, time - delay * (i == 4), amplitude)
        path = tmp_path / f'{delay}_{stated}_{seed}_{amplitude}.mcap'
        last = replace(LAYOUT.sensors[4], delay=stated)
        layout = replace(LAYOUT, sensors=(*LAYOUT.sensors[:4], last))
        with BagWriter(path) as writer:
            writer.write_description(StandDescription('stand', 1, RATE, layout))
            for block in blocks_of(samples, RATE, [500] * 11):
                writer.write_block(block)
        return path

    return make


def test_late_channel_is_found_and_its_cost_told(bag):
    found = check_delays(bag(50e-6), MODEL)
    assert [one.name for one in found] == [sensor.name for sensor in LAYOUT.sensors[1:]]
    truth = 50e-6 * np.array([0, 0, 0, 1.0])
    scores = (np.array([one.delay for one in found]) - truth) / [one.deviation for one in found]
    assert np.abs(scores).max() < 4.5
    assert found[3].deviation < 2e-6
    assert found[3].warning is not None
    assert 'acceleration_3: is late by' in found[3].warning
    # 2 pi f delay / (2 zeta), with f = 31.83 Hz and zeta = 5 %.
    assert 'the damping of the mode at 31.83 Hz by up to 10%' in found[3].warning


def test_delay_that_the_layout_states_is_no_delay(bag):
    found = check_delays(bag(50e-6, stated=50e-6), MODEL)
    assert not any(one.warning for one in found)


def test_machine_without_values_has_no_cost_but_delays(bag):
    unknown = assemble(oscillator()).with_values(np.full(len(MODEL.values), np.nan))
    warning = check_delays(bag(50e-6), unknown)[3].warning
    assert warning is not None
    assert 'is late by' in warning
    assert 'damping' not in warning


def test_rest_tells_nothing(bag):
    with pytest.raises(DataError, match='no motion stands out'):
        check_delays(bag(0.0, amplitude=0.0), MODEL)
