# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""A device of another package, read by the bridge over a real socket, comes and goes."""

import os
from pathlib import Path
import re
import signal
import socket
import subprocess
import sys

from identnl_msgs.msg import SampleBlock
from identnl_ros.core.errors import IdentnlError
from identnl_ros.nodes.device_health import device_health
from identnl_ros.nodes.launch_plan import plan
from identnl_ros.nodes.source_choice import make_source, SETTINGS, settings_of_sources
from identnl_ros.sources.device_state import DeviceState
from identnl_ros.sources.registry import installed_sources
from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / 'examples' / 'udp_source'
MACHINE = ROOT / 'config' / 'oscillator.yaml'
RATE = 1000.0
PART = 4000  # samples that are sent before the device fails, and after it

# Sends samples of a file in real time, numbered from 0.
SENDER = """
import socket, struct, sys, time
import numpy as np

path, port, begin = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
samples = np.load(path)[begin:]
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
start, start_ns = time.monotonic(), time.time_ns()
for first in range(0, len(samples), 20):
    time.sleep(max(0.0, start + (first + 20) / 1000.0 - time.monotonic()))
    stamp = start_ns + first * 1_000_000
    data = struct.pack('<QQ', first, stamp) + samples[first : first + 20].tobytes()
    out.sendto(data, ('127.0.0.1', port))
"""


class Stand:
    """A simulated oscillator whose device sends its samples to a port."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.layout = folder / 'layout.yaml'
        text = (ROOT / 'config' / 'oscillator_layout.yaml').read_text()
        text = text.replace('gain: 1 V/N', 'noise: 1e-5 N\n    gain: 1 V/N')
        text = text.replace('gain: 1 V/m', 'noise: 1e-5 m\n    gain: 1 V/m')
        self.layout.write_text(text)
        self.source = SimulatedSource(
            load_machine(MACHINE).machine,
            load_layout(self.layout).layout,
            TestRun(Excitation.MULTISINE, 2 * PART / RATE, RATE),
        )
        # Gains are 1 V/N and 1 V/m: what is recorded in volts.
        self.samples = np.concatenate([block.samples for block in self.source.blocks()])
        np.save(folder / 'samples.npy', self.samples)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(('127.0.0.1', 0))
            self.port = free.getsockname()[1]
        self.senders: list[subprocess.Popen[bytes]] = []

    @property
    def name(self) -> str:
        """Of the device."""
        return f'127.0.0.1:{self.port}'

    @property
    def settings(self) -> dict[str, object]:
        """Parameters of the bridge."""
        return {
            'source': 'udp',
            'machine_file': MACHINE,
            'layout_file': self.layout,
            'device_silence': 1.5,
            'reconnect_pause': 0.05,
            'reconnect_longest_pause': 0.1,
            'udp.port': self.port,
            'udp.sample_rate': RATE,
            'udp.channels': 'V2:V, V1:mV',
        }

    def send(self, begin: int) -> subprocess.Popen[bytes]:
        delivered = self.samples[:, ::-1] * [1.0, 1e3]
        np.save(self.folder / 'delivered.npy', delivered)
        command = [sys.executable, '-c', SENDER, self.folder / 'delivered.npy']
        self.senders.append(subprocess.Popen([*command, str(self.port), str(begin)]))
        return self.senders[-1]

    def require_part_of(self, messages: list[SampleBlock], begin: int) -> None:
        """Require samples that follow each other to be those of the simulation, none left out."""
        indices = [message.first_sample_index for message in messages]
        counts = [len(message.samples) // message.channel_count for message in messages]
        assert np.array_equal(np.diff(indices), counts[:-1])
        samples = np.concatenate([np.reshape(m.samples, (-1, m.channel_count)) for m in messages])
        # Those that are sent while nobody listens do not arrive.
        begin += int(np.argmin(np.abs(self.samples[begin:] - samples[0]).sum(axis=1)))
        assert samples == pytest.approx(self.samples[begin : begin + len(samples)])


@pytest.fixture
def stand(tmp_path, monkeypatch):
    """Install the example for the processes of the test, as metadata on the path of Python."""
    metadata = tmp_path / 'identnl_udp_source-0.1.0.dist-info'
    metadata.mkdir()
    text = 'Metadata-Version: 2.1\nName: identnl-udp-source\nVersion: 0.1.0\n'
    (metadata / 'METADATA').write_text(text)
    entry = '[identnl_ros.sources]\nudp = identnl_udp_source:source\n'
    (metadata / 'entry_points.txt').write_text(entry)
    paths = [str(tmp_path), str(EXAMPLE), *filter(None, [os.environ.get('PYTHONPATH')])]
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(paths))
    stand = Stand(tmp_path)
    yield stand
    for sender in stand.senders:
        sender.kill()
        sender.wait()


def test_stream_of_a_device_that_comes_back_identifies_the_machine(start, watcher, stand):
    part = f'sensor_bridge: device {stand.name}'
    watcher.listen('samples')
    start('identifier', estimator='weak')
    start('transform')
    bridge = start('sensor_bridge', **stand.settings, wait_for_consumers=2)
    watcher.until(lambda: f'bench/{part}' in watcher.health)
    # Consumers have reported before samples come, so that none is dropped.
    watcher.until(lambda: watcher.health['bench/sensor_bridge: stream'].values.keys() >= {
        'progress of /bench/transform [samples]', 'progress of /bench/identifier [samples]',
    })  # fmt: skip
    sender = stand.send(0)
    watcher.until(lambda: watcher.blocks and watcher.blocks[-1].first_sample_index >= 3000)
    sender.send_signal(signal.SIGKILL)
    assert 'no samples for 1.5 s' in watcher.health_of(part, 'away', level=2)
    stopped = watcher.blocks[-1].first_sample_index + count(watcher.blocks[-1])
    stand.send(PART)
    watcher.until(lambda: watcher.blocks[-1].first_sample_index >= stopped + 3500)
    values = watcher.health[f'bench/{part}'].values
    assert int(values['reconnects']) >= 1
    assert float(values['measured rate [Hz]']) == pytest.approx(RATE, rel=1e-3)
    bridge.signal(signal.SIGTERM)
    final = watcher.final_estimate(240)
    assert bridge.exit_code() == 0
    lines = bridge.output.splitlines()
    for words, level in (('is lost: no samples for 1.5 s', '[WARN]'), ('is back after', '[INFO]')):
        told = [line for line in lines if words in line]
        assert told
        assert all(line.startswith(level) for line in told)

    assert len({block.stream_id for block in watcher.blocks}) == 1
    assert watcher.blocks[-1].last_block
    before, after = [], []
    for message in watcher.blocks[:-1]:
        (before if message.first_sample_index < stopped else after).append(message)
    stand.require_part_of(before, 0)
    stand.require_part_of(after, PART)
    # The jump of the index is the time that has passed, to the 1 kHz of the clock and the
    # moment that a sender takes to begin.
    passed = stamp_of(after[0]) - stamp_of(before[0])
    assert after[0].first_sample_index / RATE == pytest.approx(passed, abs=0.02)

    truth = stand.source.truth
    for one in final.parameters:
        assert one.status == one.STATUS_OK, one.note
        assert abs(one.value - truth[one.name]) < 5 * one.standard_deviation, one.name
    values = {one.name: one.value for one in final.parameters}
    for name in ('mass.mass', 'spring.stiffness', 'spring.cubic_stiffness'):
        assert values[name] == pytest.approx(truth[name], rel=2e-3)


def test_stand_with_a_device_is_launched_by_arguments_and_a_parameter_file(
    start, watcher, stand, monkeypatch
):
    for path in (stand.folder, EXAMPLE):
        monkeypatch.syspath_prepend(path)
    installed_sources.cache_clear()
    file = stand.folder / 'bench.yaml'
    file.write_text(
        'identifier: {ros__parameters: {estimator: weak, publish_rate: 5}}\n'
        '/bench/sensor_bridge:\n  ros__parameters:\n    device_silence: 60\n'
        f'    udp: {{port: {stand.port}, sample_rate: 500, channels: "V2:V, V1:mV"}}\n'
    )
    given = {
        'namespace': 'bench', 'parameters': str(file), 'source': 'udp',
        'machine_file': str(MACHINE), 'layout_file': str(stand.layout),
        'udp.sample_rate': '1e3', 'wait_timeout': '60',
    }  # fmt: skip
    nodes = plan(given)
    installed_sources.cache_clear()
    processes = [start(node.executable, **node.parameters) for node in nodes]
    watcher.until(lambda: watcher.health.get('bench/sensor_bridge: stream') and {
        'progress of /bench/transform [samples]', 'progress of /bench/identifier [samples]',
    } <= watcher.health['bench/sensor_bridge: stream'].values.keys(), 60)  # fmt: skip
    stand.send(PART).wait(60)
    *consumers, bridge = processes
    bridge.signal(signal.SIGTERM)
    final = watcher.final_estimate(240)
    for process in (bridge, *consumers):
        process.signal(signal.SIGTERM)
        assert process.exit_code() == 0, process.output
    truth = stand.source.truth
    assert final.estimator == 'weak'
    for one in final.parameters:
        assert one.status == one.STATUS_OK, one.note
        assert abs(one.value - truth[one.name]) < 5 * one.standard_deviation, one.name


def test_samples_that_come_while_the_bridge_is_inactive_are_lost(start, watcher, stand):
    watcher.listen('samples')
    start('sensor_bridge', **stand.settings, autostart=False)

    def change(transition):
        request = Transition(id=transition)
        answer = watcher.call(ChangeState, 'sensor_bridge/change_state', transition=request)
        assert answer.success

    change(Transition.TRANSITION_CONFIGURE)
    stand.send(0)
    part = 'bench/sensor_bridge: stream'
    watcher.until(
        lambda: (
            part in watcher.health
            and int(watcher.health[part].values['samples not published']) > 500
        )
    )
    assert not watcher.blocks
    change(Transition.TRANSITION_ACTIVATE)
    watcher.until(lambda: len(watcher.blocks) > 10)
    first = watcher.blocks[0].first_sample_index
    assert first > 500
    stand.require_part_of(watcher.blocks, 500)
    change(Transition.TRANSITION_DEACTIVATE)
    change(Transition.TRANSITION_CLEANUP)
    # The port is free again.
    change(Transition.TRANSITION_CONFIGURE)


def test_wrong_use_is_told_in_sentences(start, stand):
    wrong = {'udp.channels': 'V1:V, V3', 'udp.sample_rates': 3.0}
    bridge = start('sensor_bridge', **{**stand.settings, **wrong})
    assert bridge.exit_code() == 1
    assert (
        'sensor output: found no channel "V2" (key column), expected one of V1, V3'
        in bridge.output
    )
    assert 'did you mean "udp.sample_rate"?' in bridge.output
    assert 'Traceback' not in bridge.output


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        ({'source': 'upd'}, 'source "upd" is not installed; did you mean "udp"?'),
        ({'source': 'udp+bag'}, 'bag cannot be joined with others'),
        ({'source': 'udp + udp'}, 'every kind of device once'),
        ({'machine_file': ''}, 'parameter machine_file is empty'),
        ({'udp.channels': ' , '}, 'parameter udp.channels is empty'),
        ({'udp.channels': 'V1:N, V2'}, 'gives channel V1 in N, the layout expects V'),
        ({'sample_rate': 500.0}, 'sample_rate is 500 Hz, but device 127.0.0.1'),
        ({'udp.channels': None}, 'source "udp" of the package identnl-udp-source failed: Attr'),
    ],
)
def test_source_that_cannot_be_made_is_told_in_a_sentence(stand, monkeypatch, wrong, words):
    for path in (stand.folder, EXAMPLE):
        monkeypatch.syspath_prepend(path)
    installed_sources.cache_clear()
    settings = {one.name: one.default for one in (*SETTINGS, *settings_of_sources())}
    with pytest.raises(IdentnlError, match=re.escape(words)):
        make_source((settings | stand.settings | wrong).__getitem__)
    installed_sources.cache_clear()


def test_device_with_a_clock_of_another_rate_is_warned_of():
    def state(measured):
        return DeviceState('box', '', 1000, 0, 0, 1000.0, measured)

    assert device_health(state(float('nan'))).message == 'OK'
    assert device_health(state(1001.0)).message == 'OK'
    assert device_health(state(1024.0)).message == (
        'samples at 1024 Hz by their stamps, says 1000 Hz'
    )


def count(message):
    return len(message.samples) // message.channel_count


def stamp_of(message):
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
