# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Devices with clocks of their own become one stream."""

import threading
import time

from identnl_ros.core.measurement.blocks import ChannelStatus
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.sources.device import DeviceLost
from identnl_ros.sources.device_reader import Patience
from identnl_ros.sources.device_source import DeviceSource
import numpy as np

from tests.sources.scripted_device import BEGIN, RATE, ScriptedDevice

FREQUENCY = 5.0  # [Hz]
SKEW = 200e-6  # the second clock is fast by
LATE = 0.25  # its first sample is late by [s]
DURATION = 6.0  # [s]


def motion(host_time):
    return np.sin(2 * np.pi * FREQUENCY * host_time)


def give(device, index, begin, skew):
    """Deliver 50 samples of the motion by a clock, with the stamps of a host that knows it."""
    host_time = begin + (index + np.arange(50)) / (RATE * (1 + skew))
    device.give(index, motion(host_time)[:, None], BEGIN + round(host_time[0] * 1e9))


def run(away=None):
    """Two devices see the same motion; the second one is away at some chunks."""
    left, right = ScriptedDevice({'a': ''}, 'left'), ScriptedDevice({'a': ''}, 'right')
    sensors = tuple(
        Sensor(name, SensorKind.DISPLACEMENT, body='table', column=f'{name}/a', noise=1e-6)
        for name in ('left', 'right')
    )
    patience = Patience(silence=60.0, pause=0.01)
    source = DeviceSource([left, right], Layout(sensors), patience=patience)
    blocks = []
    taking = threading.Thread(target=lambda: blocks.extend(source.blocks()))
    taking.start()
    for chunk in range(round(DURATION * RATE / 50)):
        give(left, 50 * chunk, 0.0, 0.0)
        if away and chunk == away.start:
            right.items.put(DeviceLost('cable'))
        if away is None or chunk not in away:
            give(right, 50 * chunk, LATE, SKEW)
        time.sleep(0.003)
    while left.items.qsize() or right.items.qsize():
        time.sleep(0.01)
    source.end()
    taking.join()
    return source, blocks


def host_times(block):
    return (block.stamp_ns - BEGIN) / 1e9 + np.arange(len(block.samples)) / RATE


def require_motion(blocks):
    for block in blocks:
        expected = np.broadcast_to(motion(host_times(block))[:, None], block.samples.shape)
        known = np.isfinite(block.samples)
        np.testing.assert_allclose(block.samples[known], expected[known], atol=2e-3)


def test_clocks_that_differ_show_the_same_motion_at_the_same_time():
    source, blocks = run()
    assert source.description.sample_rate == RATE
    *blocks, last = blocks
    assert last.last
    assert sum(len(block.samples) for block in blocks) > 0.9 * (DURATION - LATE) * RATE
    # Unaligned, the second one would be off by 2 pi 5 Hz x 0.25 s and more.
    require_motion(blocks)
    samples = np.concatenate([block.samples for block in blocks])
    # At the ends only one of them samples.
    assert np.isfinite(samples).all(axis=1).mean() > 0.9


def test_description_has_the_rate_of_the_slowest_device_and_the_noise_of_what_is_published():
    left = ScriptedDevice({'a': ''}, 'left', sample_rate=4 * RATE)
    right = ScriptedDevice({'a': ''}, 'right')
    sensors = tuple(
        Sensor(name, SensorKind.DISPLACEMENT, body='table', column=f'{name}/a', noise=1e-3)
        for name in ('left', 'right')
    )
    said = []
    source = DeviceSource([left, right], Layout(sensors), tell=said.append)
    description = source.description
    assert description.sample_rate == RATE
    assert any('rate of the slowest device (right)' in text for text in said)
    blocks = []
    taking = threading.Thread(target=lambda: blocks.extend(source.blocks()))
    taking.start()
    generator = np.random.default_rng(3)
    for chunk in range(160):
        for device, count in ((left, 200), (right, 50)):
            device.give(chunk * count, 1e-3 * generator.standard_normal((count, 1)))
        time.sleep(0.003)
    while left.items.qsize() or right.items.qsize():
        time.sleep(0.01)
    source.end()
    taking.join()
    samples = np.concatenate([block.samples for block in blocks])
    assert np.isfinite(samples).all(axis=1).sum() > 6000
    stated = [sensor.noise for sensor in description.layout.sensors]
    # As many samples as these tell it to 1 %, and the low-pass takes 1 % at the top of the band.
    np.testing.assert_allclose(np.nanstd(samples, axis=0), stated, rtol=0.05)
    np.testing.assert_allclose(stated, [0.5e-3, 1e-3])


def test_device_that_is_away_leaves_a_gap_in_its_channels_alone():
    away = range(60, 80)  # 1 s
    source, blocks = run(away)
    blocks = blocks[:-1]
    left = np.concatenate([block.samples[:, 0] for block in blocks])
    right = np.concatenate([block.samples[:, 1] for block in blocks])
    assert np.isfinite(left).mean() > 0.95
    assert 900 <= np.isnan(right[1000:-500]).sum() <= 1300
    for block in blocks:
        missing = np.isnan(block.samples).any(axis=0)
        assert (block.channel_status == np.where(missing, ChannelStatus.MISSING_SAMPLES, 0)).all()
    require_motion(blocks)
    assert [state.reconnects for state in source.devices] == [0, 1]
