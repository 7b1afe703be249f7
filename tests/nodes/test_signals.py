# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Ctrl-C and SIGTERM in the middle of a run lose nothing that has arrived."""

import signal

from identnl_ros.storage.bag_reader import open_bag
import pytest

pytestmark = pytest.mark.ros

ENDLESS = {'duration': 1000.0, 'speed': 1.0}


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signal_to_all_processes_ends_with_everything_used(
    start, watcher, bridge_settings, tmp_path, number
):
    bag = tmp_path / 'run.mcap'
    processes = [
        start('recorder', path=bag),
        start('identifier', publish_rate=10.0),
        start('transform'),
        start('sensor_bridge', **{**bridge_settings, **ENDLESS, 'wait_for_consumers': 3}),
    ]
    watcher.until(lambda: watcher.estimates and watcher.estimates[-1].samples_used > 1000)
    for process in processes:
        process.signal(number)
    final = watcher.final_estimate()
    codes = [process.exit_code() for process in processes]
    assert codes == [0, 0, 0, 0]
    assert 'Traceback' not in ''.join(process.output for process in processes)

    recorded = list(open_bag(bag).blocks())
    assert recorded[-1].last
    # Derivatives need neighbours: a few samples at both ends are not given out.
    assert recorded[-1].next_index - 40 < final.samples_used <= recorded[-1].next_index
    first = recorded[0].first_index
    assert sum(len(block.samples) for block in recorded) == recorded[-1].next_index - first


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signal_to_one_process_ends_with_everything_used(
    start, watcher, bridge_settings, tmp_path, number
):
    bag = tmp_path / 'run'
    stand = start('stand', **bridge_settings, path=bag) if number == signal.SIGTERM else start(
        'stand', **{**bridge_settings, **ENDLESS}, path=bag, publish_rate=10.0
    )  # fmt: skip
    watcher.until(lambda: watcher.estimates)
    stand.signal(number)
    stand.signal(number)  # a launcher sends its own after the terminal's
    final = watcher.final_estimate()
    assert stand.exit_code() == 0
    assert 'Traceback' not in stand.output
    assert list(open_bag(bag).blocks())[-1].next_index - 40 < final.samples_used


def test_bag_of_a_killed_recorder_is_readable(start, watcher, bridge_settings, tmp_path):
    bag = tmp_path / 'run'
    recorder = start('recorder', path=bag)
    start('sensor_bridge', **{**bridge_settings, **ENDLESS, 'wait_for_consumers': 1})
    watcher.listen('samples')
    watcher.until(lambda: len(watcher.blocks) > 250)
    recorder.signal(signal.SIGKILL)
    recorder.exit_code()
    blocks = list(open_bag(bag).blocks())
    # It is written out every second, at 100 blocks a second.
    assert len(blocks) > 100
    assert [block.first_index for block in blocks] == [50 * i for i in range(len(blocks))]


def test_vanished_consumer_does_not_hold_up_the_source(start, watcher, bridge_settings, tmp_path):
    start('recorder', path=tmp_path / 'kept.mcap')
    lost = start('recorder', path=tmp_path / 'lost.mcap', node_name='lost')
    settings = {**bridge_settings, 'duration': 10.0, 'wait_for_consumers': 2}
    watcher.listen('samples')
    bridge = start('sensor_bridge', **settings)
    watcher.until(lambda: watcher.blocks)
    lost.signal(signal.SIGSTOP)
    watcher.until(lambda: watcher.blocks[-1].last_block)
    assert '/bench/lost' in bridge.output
    assert 'no longer waited for' in bridge.output
