# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""What the bridge tells of two devices with rates of their own is true of what it publishes."""

import os
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.ros

ROOT = Path(__file__).resolve().parents[2]
MACHINE = ROOT / 'config' / 'oscillator.yaml'
FAST, SLOW = 8000.0, 1000.0  # [Hz]
NOISE = 1e-3

# Two devices that read nothing but noise, in real time.
PLUGIN = f"""
import time
from identnl_ros.sources.device import DeviceBlock, DeviceChannel
import numpy as np

class Noise:
    def __init__(self, name, channel, sample_rate, seed):
        self.name, self.channel, self.sample_rate = name, channel, sample_rate
        self.generator = np.random.default_rng(seed)
    def open(self):
        self.next, self.start, self.start_ns = 0, time.monotonic(), time.time_ns()
        return (DeviceChannel(self.channel, 'V'),)
    def read(self, timeout):
        count = round(self.sample_rate / 50)
        due = self.start + (self.next + count) / self.sample_rate
        if due > time.monotonic() + timeout:
            time.sleep(timeout)
            return None
        time.sleep(max(0.0, due - time.monotonic()))
        first, self.next = self.next, self.next + count
        stamp = self.start_ns + round(first / self.sample_rate * 1e9)
        samples = {NOISE} * self.generator.standard_normal((count, 1))
        return DeviceBlock(first, stamp, samples)
    def close(self):
        pass

class Source:
    settings = ()
    def devices(self, setting):
        return [Noise('cell', 'V1', {FAST}, 1), Noise('probe', 'V2', {SLOW}, 2)]

source = Source()
"""


@pytest.fixture
def layout(tmp_path, monkeypatch):
    """Install the plug-in for the processes of the test; give the layout file of its sensors."""
    (tmp_path / 'two_rates.py').write_text(PLUGIN)
    metadata = tmp_path / 'two_rates-0.1.0.dist-info'
    metadata.mkdir()
    text = 'Metadata-Version: 2.1\nName: two-rates\nVersion: 0.1.0\n'
    (metadata / 'METADATA').write_text(text)
    entry = '[identnl_ros.sources]\ntwo_rates = two_rates:source\n'
    (metadata / 'entry_points.txt').write_text(entry)
    paths = [str(tmp_path), *filter(None, [os.environ.get('PYTHONPATH')])]
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(paths))
    text = (ROOT / 'config' / 'oscillator_layout.yaml').read_text()
    text = text.replace('sample_rate: 610.3515625 Hz', '')
    text = text.replace('gain: 1 V/N', f'noise: {NOISE} N\n    gain: 1 V/N')
    text = text.replace('gain: 1 V/m', f'noise: {NOISE} m\n    gain: 1 V/m')
    path = tmp_path / 'layout.yaml'
    path.write_text(text)
    return path


def test_the_description_published_before_the_first_block_has_its_rate_and_noise(
    start, watcher, layout
):
    watcher.listen('samples')
    watcher.listen('stand_description')
    bridge = start('sensor_bridge', source='two_rates', machine_file=MACHINE, layout_file=layout)
    watcher.until(lambda: watcher.descriptions, 30)
    (description,) = watcher.descriptions
    assert not watcher.blocks
    assert description.sample_rate == SLOW
    # Of the fast one, an eighth of the band is left.
    told = [channel.noise_standard_deviation for channel in description.channels]
    np.testing.assert_allclose(told, [NOISE / np.sqrt(8), NOISE])
    watcher.until(lambda: len(watcher.blocks) > 200, 30)
    samples = np.concatenate(
        [np.reshape(one.samples, (-1, one.channel_count)) for one in watcher.blocks]
    )
    # 2000 samples and more tell it to 1.6 %.
    np.testing.assert_allclose(np.nanstd(samples, axis=0), told, rtol=0.07)
    assert {one.stream_id for one in watcher.blocks} == {description.stream_id}
    assert len(watcher.descriptions) == 1
    assert 'rate of the slowest device (probe)' in bridge.output
