# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Samples of an openDAQ device in another process, over the native protocol on loopback."""

from collections.abc import Iterator
from itertools import pairwise
import os
import time

from identnl_ros.core.errors import DataError
from identnl_ros.sources.device import DeviceBlock, DeviceChannel, DeviceLost
from identnl_ros.sources.opendaq_device import OpenDaqDevice, source
import numpy as np
import pytest

from tests.sources.opendaq_process import OpenDaqProcess

pytest.importorskip('opendaq', reason='the openDAQ SDK is not installed (extra opendaq)')

RATE = 10000
PERIOD = 1000
BEGIN = 1_700_000_000 * RATE  # sample of the origin 1970: 2023-11-14
# What sample i carries, so that a sample tells its own index.
FORCE = 0.5 * np.arange(PERIOD)
GAP = 0.01 * np.arange(PERIOD) - 3.0
CHANNELS = [
    {'name': 'force', 'unit': 'N'},
    {'name': 'gap', 'unit': 'um', 'scale': 0.01, 'offset': -3.0},
]


@pytest.fixture
def server(tmp_path) -> Iterator[OpenDaqProcess]:
    table = tmp_path / 'table.npy'
    np.save(table, np.stack([FORCE, GAP], axis=1))
    process = OpenDaqProcess(table, CHANNELS, RATE, BEGIN)
    yield process
    process.kill()


@pytest.fixture
def device(server) -> Iterator[OpenDaqDevice]:
    device = device_at(server.address('daq.nd'))
    yield device
    device.close()


def device_at(address: str, **settings: object) -> OpenDaqDevice:
    values = {one.name: one.default for one in source.settings}
    values |= {'connection': [address], 'sample_rate': 0.0, **settings}
    (device,) = source.devices(values.__getitem__)
    return device


def read(device: OpenDaqDevice, samples: int, timeout: float = 10.0) -> list[DeviceBlock]:
    blocks, end = [], time.monotonic() + timeout
    while sum(len(block.samples) for block in blocks) < samples:
        assert time.monotonic() < end, f'{samples} samples did not come in {timeout} s'
        if block := device.read(0.2):
            blocks.append(block)
    return blocks


def assert_values_are_those_of_the_index(blocks: list[DeviceBlock]) -> None:
    for block in blocks:
        rows = (block.first_index + np.arange(len(block.samples))) % PERIOD
        np.testing.assert_array_equal(block.samples[:, 0], FORCE[rows])
        np.testing.assert_allclose(block.samples[:, 1], GAP[rows], rtol=0, atol=1e-12)


def until_lost(device: OpenDaqDevice, timeout: float = 10.0) -> str:
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        try:
            device.read(0.2)
        except DeviceLost as error:
            return str(error)
    pytest.fail(f'not lost within {timeout} s')


@pytest.mark.parametrize('protocol', ['daq.nd', 'daq.ns'])
def test_samples_units_and_clock_are_those_of_the_device(server, protocol):
    device = device_at(server.address(protocol))
    channels = device.open()
    blocks = read(device, 3 * PERIOD)
    device.close()
    assert channels == (DeviceChannel('force', 'N'), DeviceChannel('gap', 'um'))
    assert device.sample_rate == RATE
    assert_values_are_those_of_the_index(blocks)
    for block, following in pairwise(blocks):
        assert following.first_index == block.first_index + len(block.samples)
    for block in blocks:
        assert block.first_index >= BEGIN
        assert block.stamp_ns == block.first_index * 10**9 // RATE


def test_lost_samples_are_a_jump_of_the_index(server, device):
    device.open()
    blocks = read(device, PERIOD)
    server.command('lose 377')
    blocks += read(device, 2 * PERIOD)
    jumps = [
        following.first_index - block.first_index - len(block.samples)
        for block, following in pairwise(blocks)
    ]
    assert [jump for jump in jumps if jump] == [377]
    assert_values_are_those_of_the_index(blocks)


def test_named_channels_come_in_their_order_and_unknown_ones_are_refused(server):
    device = device_at(server.address('daq.ns'), channels=['gap'])
    assert [channel.name for channel in device.open()] == ['gap']
    (block, *_) = read(device, 100)
    assert block.samples.shape[1] == 1
    device.close()
    with pytest.raises(DataError, match='no channel speed; with a time base it has force, gap'):
        device_at(server.address('daq.ns'), channels=['speed']).open()


@pytest.mark.parametrize('change', ['unit force kN', 'rate 20000'])
def test_changed_device_is_opened_again_and_says_what_it_is_now(server, device, change):
    device.open()
    read(device, PERIOD)
    server.command(change)
    assert 'was changed' in until_lost(device)
    device.close()
    channels = device.open()
    assert_values_are_those_of_the_index(read(device, PERIOD))
    assert (channels[0].unit, device.sample_rate) in {('kN', 10000.0), ('N', 20000.0)}


def test_silent_device_gives_nothing_but_is_not_lost(server, device):
    device.open()
    read(device, PERIOD)
    server.command('silent')
    time.sleep(0.1)
    while device.read(0.2) is not None:
        pass
    assert device.read(0.2) is None
    server.command('sound')
    assert_values_are_those_of_the_index(read(device, 100))


def test_killed_device_is_lost_and_found_again_where_its_clock_is(server, device):
    device.open()
    (*_, before) = read(device, PERIOD)
    server.kill()
    assert 'the connection is down' in until_lost(device)
    device.close()
    with pytest.raises(DeviceLost, match='does not answer'):
        device.open()
    device.close()
    again = server.again(begin=BEGIN + 10 * RATE)
    try:
        device.open()
        (after, *_) = read(device, PERIOD)
    finally:
        again.kill()
    assert after.first_index >= BEGIN + 10 * RATE > before.first_index
    device.close()
    device.close()


def test_origin_that_is_no_time_of_day_is_stamped_by_the_host(tmp_path, server):
    server.kill()
    other = server.again(begin=0, origin='')
    try:
        device = device_at(other.address('daq.ns'))
        device.open()
        begin = time.time_ns()
        blocks = read(device, PERIOD)
        end = time.time_ns()
        device.close()
    finally:
        other.kill()
    packet = 10**9 // 50  # a sample may have been waiting for its packet
    stamps = [block.stamp_ns for block in blocks]
    assert begin - 5 * packet < stamps[0] < end
    period = 10**9 // RATE
    assert all(
        stamp - stamps[0] == (block.first_index - blocks[0].first_index) * period
        for stamp, block in zip(stamps, blocks, strict=True)
    )


def test_reference_device_of_the_sdk_takes_a_sample_rate():
    device = device_at('daqref://device0', sample_rate=2000.0)
    channels = device.open()
    blocks = read(device, 500)
    device.close()
    assert channels == (DeviceChannel('AI0', 'V'), DeviceChannel('AI1', 'V'))
    assert device.sample_rate == 2000.0
    # A sine of 5 V and 10 Hz: by its second difference, x'' = -(2 pi f)^2 x.
    samples = np.concatenate([block.samples[:, 0] for block in blocks])
    assert np.abs(samples).max() == pytest.approx(5.0, rel=1e-3)
    middle = samples[1:-1]
    bend = samples[2:] - 2 * middle + samples[:-2]
    factor = 2 * np.cos(2 * np.pi * 10.0 / 2000.0) - 2
    np.testing.assert_allclose(bend, factor * middle, atol=1e-9)
    assert abs(blocks[0].stamp_ns - time.time_ns()) < 60 * 10**9


@pytest.mark.parametrize(
    ('address', 'words'),
    [
        ('daq.nowhere://127.0.0.1', 'knows no address of the form .* daq.nd://'),
        ('daqref://device7', 'cannot be used: Device with id "7" not found'),
    ],
)
def test_address_that_can_never_be_right_is_refused(address, words):
    with pytest.raises(DataError, match=words) as error:
        device_at(address).open()
    assert not isinstance(error.value, DeviceLost)


def test_no_address_is_refused_in_words():
    with pytest.raises(DataError, match='connection is empty; give the connection strings'):
        device_at('')


def test_closed_device_leaves_no_thread(server):
    before = len(os.listdir('/proc/self/task'))
    device = device_at(server.address('daq.nd'))
    device.open()
    read(device, 100)
    device.close()
    end = time.monotonic() + 5
    while len(os.listdir('/proc/self/task')) > before and time.monotonic() < end:
        time.sleep(0.05)
    assert len(os.listdir('/proc/self/task')) <= before
