# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Faults of channels live: status bits, diagnostics, estimates that are in doubt."""

import signal

from mcap.reader import make_reader
import numpy as np
import pytest

pytest.importorskip('rclpy')

from identnl_msgs.msg import DataQuality, ParameterEstimate
from identnl_ros.core.quality.condition import Condition
from rclpy.serialization import deserialize_message

from tests.faulty_bags import inverted, RATE, stuck, write_faulty

pytestmark = pytest.mark.ros


def both(samples, columns):
    inverted(samples, columns)
    stuck(samples, columns)


def test_faulty_channels_are_flagged_left_out_and_doubted(start, watcher, tmp_path):
    bag = write_faulty(tmp_path / 'faulty.mcap', both)
    recorded = tmp_path / 'recorded.mcap'
    topics = ['samples', 'stand_description', 'quality']
    recorder = start('recorder', path=recorded, topics=topics)
    start('stand', source='bag', bag=bag, speed=0.0, wait_for_consumers=3, estimator='pointwise')
    final = watcher.final_estimate()
    words = watcher.health_of('transform: readings', 'knee_s1x: reads -1.00')
    recorder.signal(signal.SIGTERM)
    assert recorder.exit_code() == 0

    with recorded.open('rb') as file:
        messages = make_reader(file).iter_messages(topics=['/bench/quality'])
        found = [deserialize_message(message.data, DataQuality) for _, _, message in messages]
    status = np.array([message.channel_status for message in found])
    excluded = np.array([message.excluded_samples for message in found])
    counts = [message.sample_count for message in found]
    first = [message.first_sample_index for message in found]
    assert first == [0, *np.cumsum(counts)[:-1]]
    assert sum(counts) == 1.2 * RATE
    names = [sensor.name for sensor in stand_sensors(bag)]
    held, turned = names.index('column_a2y'), names.index('knee_s1x')
    assert excluded.sum(axis=0)[held] == pytest.approx(3000, abs=3)
    assert excluded.sum() == excluded.sum(axis=0)[held]
    assert status[-1][held] & Condition.STUCK
    assert status[-1][turned] & Condition.INVERTED
    assert set(np.flatnonzero(np.bitwise_or.reduce(status, axis=0))) == {held, turned}
    assert any('column_a2y: stuck' in one for message in found for one in message.findings)

    assert 'column_a2y: stuck' in words
    assert final.samples_used > 0.97 * 1.2 * RATE
    assert any('knee_s1x: reads -1.00' in note for note in final.notes)
    assert all(one.status != ParameterEstimate.STATUS_OK for one in final.parameters)


def stand_sensors(bag):
    from identnl_ros.storage.bag_reader import open_bag

    return open_bag(bag).description.layout.sensors
