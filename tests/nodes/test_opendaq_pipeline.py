# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""A stand measured by an openDAQ device is identified by the nodes, over real protocols."""

import signal

from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
import numpy as np
import pytest

from tests.sources.opendaq_process import OpenDaqProcess

pytestmark = pytest.mark.ros
pytest.importorskip('opendaq', reason='the openDAQ SDK is not installed (extra opendaq)')

RATE = 2000
DURATION = 8.0  # [s]
PART = 3 * RATE  # samples before the device fails
BEGIN_AGAIN = 4 * RATE  # sample with which it comes back

# A slide of 20 kg on a hardening joint: 50 Hz.
MACHINE = """
machine: slide
bodies:
  mass:
    mass: {estimate: 20 kg}
    centre_of_mass: [0, 0, 0]
    degrees_of_freedom: [translation_1]
joints:
  joint:
    kind: six_spring
    body: mass
    to: ground
    point: [0, 0, 0]
    stiffness: [{estimate: 2 N/um}]
    damping: [{estimate: 400 N*s/m}]
    cubic_stiffness: [{estimate: 2e13 N/m^3}]
excitations:
  shaker:
    body: mass
    point: [0, 0, 0]
    direction: +x
    amplitude: 100 N
    frequency: 50 Hz
    band: [5 Hz, 150 Hz]
"""
LAYOUT = """
stand: slide
sensors:
  force: {kind: force, excitation: shaker, unit: N, noise: 0.05 N}
  position:
    kind: displacement
    body: mass
    point: [0, 0, 0]
    direction: +x
    column: probe
    unit: um
    noise: 0.05 um
  acceleration:
    kind: acceleration
    body: mass
    point: [0, 0, 0]
    direction: +x
    unit: V
    gain: 10 mV/(m/s^2)
    noise: 0.01 m/s^2
"""
# The device delivers other units than the layout records, and 16 bit numbers of the probe.
CHANNELS = [
    {'name': 'temperature', 'unit': 'degC'},
    {'name': 'acceleration', 'unit': 'mV'},
    {'name': 'probe', 'unit': 'nm', 'scale': 10.0, 'offset': 0.0},
    {'name': 'force', 'unit': 'kN'},
]


@pytest.fixture
def stand(tmp_path):
    machine, layout = tmp_path / 'slide.yaml', tmp_path / 'slide_layout.yaml'
    machine.write_text(MACHINE)
    layout.write_text(LAYOUT)
    source = SimulatedSource(
        load_machine(machine).machine,
        load_layout(layout).layout,
        TestRun(Excitation.MULTISINE, DURATION, RATE, seed=5),
    )
    samples = np.concatenate([block.samples for block in source.blocks()])
    force, position, acceleration = samples.T  # N, m, m/s^2
    columns = [np.full_like(force, 21.0), 10.0 * acceleration, 1e9 * position, 1e-3 * force]
    table = tmp_path / 'table.npy'
    np.save(table, np.stack(columns, axis=1))
    device = OpenDaqProcess(table, CHANNELS, RATE, 0)
    device.command('silent')
    settings = {
        'source': 'opendaq',
        'machine_file': machine,
        'layout_file': layout,
        'device_silence': 60.0,
        'reconnect_pause': 0.1,
        'reconnect_longest_pause': 0.2,
        'opendaq.connection': f'["{device.address("daq.nd")}"]',
    }
    yield source, device, settings
    device.kill()


def test_stand_is_identified_from_an_opendaq_device_that_is_killed_once(start, watcher, stand):
    source, device, settings = stand
    watcher.listen('samples')
    identifier = start('identifier', estimator='weak')
    transform = start('transform')
    bridge = start('sensor_bridge', **settings, wait_for_consumers=2)
    ready = {f'progress of /bench/{name} [samples]' for name in ('transform', 'identifier')}
    stream = 'bench/sensor_bridge: stream'
    watcher.until(
        lambda: stream in watcher.health and watcher.health[stream].values.keys() >= ready, 60
    )
    device.command('sound')
    watcher.until(lambda: sum(map(count, watcher.blocks)) >= PART)
    device.kill()
    part = f'sensor_bridge: device {device.address("daq.nd")}'
    watcher.health_of(part, 'does not answer', level=2)
    again = device.again(begin=BEGIN_AGAIN)
    try:
        watcher.until(lambda: sum(map(count, watcher.blocks)) >= PART + RATE)
        bridge.signal(signal.SIGTERM)
        final = watcher.final_estimate()
        assert bridge.exit_code() == 0
    finally:
        again.kill()
    for process in (identifier, transform):
        process.signal(signal.SIGTERM)
        assert process.exit_code() == 0
    assert 'Traceback' not in bridge.output
    assert 'is lost: the connection is down' in bridge.output
    assert 'is back after' in bridge.output

    truth = source.truth
    assert {one.name for one in final.parameters} >= {'mass.mass', 'joint.cubic_stiffness'}
    for one in final.parameters:
        assert one.status == one.STATUS_OK, one.note
        assert abs(one.value - truth[one.name]) < 4 * one.standard_deviation, one.name
        assert one.standard_deviation < 0.02 * abs(truth[one.name]), one.name
    assert final.samples_used > PART


def count(message) -> int:
    """Give the number of samples in a block."""
    return len(message.samples) // message.channel_count
