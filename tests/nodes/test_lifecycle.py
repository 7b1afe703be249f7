# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Nodes are managed: asked for what is possible they do it, else they say no and live."""

import signal

from identnl_ros.storage.bag_reader import open_bag
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import pytest
from rcl_interfaces.srv import DescribeParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter

pytestmark = pytest.mark.ros

EXECUTABLES = ('sensor_bridge', 'transform', 'identifier', 'recorder')


def state_of(watcher, name):
    return watcher.call(GetState, f'{name}/get_state').current_state.label


def change(watcher, name, transition, label=''):
    request = Transition(id=transition, label=label)
    return watcher.call(ChangeState, f'{name}/change_state', transition=request).success


def test_node_goes_through_its_states(start, watcher, bridge_settings):
    start('sensor_bridge', **{**bridge_settings, 'speed': 1.0}, autostart=False)
    assert state_of(watcher, 'sensor_bridge') == 'unconfigured'
    assert not change(watcher, 'sensor_bridge', 99)
    assert not change(watcher, 'sensor_bridge', Transition.TRANSITION_ACTIVATE)
    assert not change(watcher, 'sensor_bridge', 0, 'no such label')
    for transition, state in (
        (Transition.TRANSITION_CONFIGURE, 'inactive'),
        (Transition.TRANSITION_ACTIVATE, 'active'),
        (Transition.TRANSITION_DEACTIVATE, 'inactive'),
        (Transition.TRANSITION_CLEANUP, 'unconfigured'),
        (Transition.TRANSITION_CONFIGURE, 'inactive'),
        (Transition.TRANSITION_ACTIVATE, 'active'),
        (Transition.TRANSITION_ACTIVE_SHUTDOWN, 'finalized'),
    ):
        assert change(watcher, 'sensor_bridge', transition)
        assert state_of(watcher, 'sensor_bridge') == state
    assert not change(watcher, 'sensor_bridge', Transition.TRANSITION_CONFIGURE)


def test_pause_makes_the_time_of_the_stand_stand_still(
    start, watcher, bridge_settings, offline, same_bits
):
    start('identifier')
    start('transform')
    start('sensor_bridge', **{**bridge_settings, 'speed': 0.5})
    watcher.until(lambda: watcher.estimates)
    assert change(watcher, 'sensor_bridge', Transition.TRANSITION_DEACTIVATE)
    assert not watcher.estimates[-1].stream_ended
    assert change(watcher, 'sensor_bridge', Transition.TRANSITION_ACTIVATE)
    assert same_bits(watcher.final_estimate(), offline)


def test_failed_configuration_is_told_in_a_sentence(start, watcher, tmp_path):
    bag = tmp_path / 'there.mcap'
    bag.write_bytes(b'')
    start('recorder', path=bag, autostart=False)
    assert not change(watcher, 'recorder', Transition.TRANSITION_CONFIGURE)
    assert state_of(watcher, 'recorder') == 'unconfigured'
    assert 'never overwritten' in watcher.health_of('recorder: node', 'exists', level=2)


@pytest.mark.parametrize(
    ('module', 'settings', 'sentence'),
    [
        ('recorder', {}, 'parameter path is empty'),
        ('sensor_bridge', {}, 'parameter machine_file is empty'),
        ('sensor_bridge', {'source': 'radio'}, 'source "radio" is not installed'),
        ('sensor_bridge', {'source': 'list'}, 'installed are bag, nidaqmx, opendaq, simulated'),
        ('sensor_bridge', {'source': 'bag', 'bag': 'nowhere'}, 'nowhere'),
        ('identifier', {'estimator': 'magic'}, 'expected one of: weak, pointwise'),
        ('transform', {'machine_file': 'nowhere.yaml'}, 'nowhere.yaml'),
        ('sensor_bridge', {'duration': 5}, 'with a point, e.g. 5.0'),
        ('sensor_bridge', {'topics.topics': '/rig/cell'}, 'write a list: ["/rig/cell"]'),
        ('sensor_bridge', {'topics.topics': 5}, 'write a list: ["5"]'),
        ('sensor_bridge', {'machine_file': 5}, 'write a text in two kinds of quotes: "\'5\'"'),
        ('sensor_bridge', {'seed': 2.5}, 'a whole number without a point'),
        ('sensor_bridge', {'autostart': 1}, 'write true or false'),
        ('sensor_bridge', {'duration': -5.0}, 'out of its range'),
    ],
)
def test_unsound_parameter_ends_a_node_that_starts_itself(start, module, settings, sentence):
    process = start(module, **settings)
    assert process.exit_code() == 1
    assert sentence in process.output
    assert 'Traceback' not in process.output


def test_recording_without_a_message_does_not_block_the_next_start(
    start, watcher, bridge_settings, tmp_path
):
    bag = tmp_path / 'run.mcap'
    settings = {**bridge_settings, 'path': bag}
    failed = start('stand', **{**settings, 'source': 'bag', 'bag': 'nowhere'})
    assert failed.exit_code() == 1
    assert f'{bag} is empty and removed' in failed.output
    assert not bag.exists()
    again = start('stand', **settings)
    assert watcher.final_estimate().samples_used
    again.signal(signal.SIGTERM)
    assert again.exit_code() == 0
    assert sum(len(block.samples) for block in open_bag(bag).blocks())


@pytest.mark.parametrize('module', EXECUTABLES)
def test_every_parameter_says_what_it_is(start, watcher, module):
    start(module, autostart=False)
    names = watcher.call(ListParameters, f'{module}/list_parameters').result.names
    answer = watcher.call(DescribeParameters, f'{module}/describe_parameters', names=names)
    silent = [item.name for item in answer.descriptors if not item.description]
    assert len(names) > 3
    assert set(silent) <= {'start_type_description_service'}  # ROS's own, cannot be changed


def test_parameter_that_cannot_take_effect_is_refused(start, watcher):
    start('identifier')
    rate = Parameter('publish_rate', value=5.0).to_parameter_msg()
    answer = watcher.call(SetParameters, 'identifier/set_parameters', parameters=[rate])
    assert not answer.results[0].successful
    assert 'next configuration' in answer.results[0].reason
    folder = Parameter('state_directory', value='/tmp').to_parameter_msg()
    answer = watcher.call(SetParameters, 'identifier/set_parameters', parameters=[folder])
    assert answer.results[0].successful
