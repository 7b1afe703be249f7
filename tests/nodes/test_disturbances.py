# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Whatever else is on the topics, the nodes name it and live."""

from dataclasses import replace
import time

from geometry_msgs.msg import PointStamped
from identnl_msgs.msg import (
    SampleBlock as SampleBlockMessage,
    StandDescription as StandDescriptionMessage,
)
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.nodes import qos
from identnl_ros.nodes.conversions import block_to_message
from identnl_ros.nodes.description_conversion import description_to_message
import numpy as np
import pytest

pytestmark = pytest.mark.ros


@pytest.fixture
def publish(watcher):
    """Publish blocks as a source would, once a subscriber is there."""
    publisher = watcher.node.create_publisher(SampleBlockMessage, 'samples', qos.blocks())

    def send(blocks, describe=None):
        if describe is not None:
            latched = watcher.node.create_publisher(
                StandDescriptionMessage, 'stand_description', qos.stand_description()
            )
            latched.publish(description_to_message(describe))
            watcher.until(lambda: latched.get_subscription_count())
            # Topics have no order among each other: let the description arrive first.
            arrived = time.monotonic() + 0.5
            watcher.until(lambda: time.monotonic() > arrived)
        watcher.until(lambda: publisher.get_subscription_count())
        for block in blocks:
            publisher.publish(block)

    return send


def messages(blocks):
    return [block_to_message(block) for block in blocks]


def wait_for_stream(watcher, description):
    watcher.until(
        lambda: (
            (part := watcher.health.get('bench/transform: stream'))
            and part.values['stream'] == str(description.stream_id)
        )
    )


def test_lost_repeated_and_damaged_blocks_are_counted(
    start, watcher, description, blocks, publish
):
    start('transform')
    publish([], describe=description)
    wait_for_stream(watcher, description)
    cut = block_to_message(blocks[7])
    cut.samples = cut.samples[:-1]
    hole = blocks[8].samples.copy()
    hole[3, 2] = np.nan
    odd = messages([blocks[9]])[0]
    odd.channel_status = odd.channel_status[:-1]
    publish(
        [
            *messages(blocks[:4]),
            *messages(blocks[2:4]),  # repeated
            *messages(blocks[6:7]),  # 100 samples lost
            cut,
            *messages([replace(blocks[8], samples=hole)]),
            odd,
            *messages([replace(blocks[10], stream_id=77)]),
        ]
    )
    watcher.health_of('transform: stream', '2 blocks repeated or late')
    watcher.health_of('transform: stream', '2 blocks damaged')
    watcher.health_of('transform: stream', 'channel states')
    watcher.health_of('transform: stream', '150 samples lost')
    watcher.health_of('transform: stream', '1 blocks without description')
    name = description.layout.sensors[2].name
    publish(messages(blocks[11:16]))  # what is judged comes a little later
    watcher.health_of('transform: readings', f'{name}: 1 sample without a valid number')
    assert watcher.health['bench/transform: stream'].values['blocks received'] == '16'


def test_ignored_sensor_is_named_with_what_that_costs(
    start, watcher, description, blocks, publish
):
    name = next(
        one.name for one in description.layout.sensors if one.kind is SensorKind.DISPLACEMENT
    )
    start('transform', ignored_sensors=[name])
    publish([], describe=description)
    wait_for_stream(watcher, description)
    publish(messages(blocks[:4]))
    watcher.health_of('transform: readings', f'{name}: ignored; without it the standard deviation')


def test_second_publisher_is_named_and_not_used(
    start, watcher, bridge_settings, blocks, description, publish, offline, same_bits
):
    start('identifier')
    start('transform')
    start('sensor_bridge', **{**bridge_settings, 'speed': 0.12})
    watcher.until(lambda: watcher.estimates)
    other = replace(description, stream_id=5)
    publish(messages(replace(block, stream_id=5) for block in blocks[:10]), describe=other)
    sentence = watcher.health_of('transform: samples', '2 publishers', level=2)
    assert '/bench/sensor_bridge' in sentence
    assert '/bench/watcher' in sentence
    assert watcher.health_of('sensor_bridge: samples', '2 publishers', level=2)
    assert watcher.health_of('transform: stream', '10 blocks from a second source')
    assert same_bits(watcher.final_estimate(), offline)


def test_wrong_type_on_a_topic_is_named(start, watcher):
    watcher.node.create_publisher(PointStamped, 'samples', 10)
    start('transform')
    wrong = '/bench/watcher has the type geometry_msgs/msg/PointStamped'
    sentence = watcher.health_of('transform: samples', wrong, level=2)
    assert 'identnl_msgs/msg/SampleBlock' in sentence


def test_layout_that_does_not_fit_is_told_until_one_fits(start, watcher, description, publish):
    transform = start('transform')
    layout = description.layout
    blind = replace(layout, sensors=layout.sensors[:3])
    publish([], describe=replace(description, layout=blind))
    assert watcher.health_of('transform: node', 'cannot see', level=2)
    assert transform.process.poll() is None
    publish([], describe=description)
    watcher.until(lambda: watcher.health['bench/transform: node'].level == 0)
