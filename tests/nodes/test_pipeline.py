# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""A live stand, a replayed bag and the core alone give the same bits."""

from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.storage.bag_reader import open_bag, read_estimates
from identnl_ros.storage.machine_file import load_machine
import pytest

pytestmark = pytest.mark.ros


def test_separate_processes_give_the_bits_of_the_core(
    start, watcher, bridge_settings, offline, same_bits
):
    start('identifier')
    start('transform')
    start('sensor_bridge', **bridge_settings)
    final = watcher.final_estimate()
    assert final.samples_used == offline.samples
    assert same_bits(final, offline)


def test_noisy_stream_gives_the_bits_of_the_core_and_the_truth(
    start, watcher, bridge_settings, compute, same_bits
):
    run = {'duration': 0.4, 'sample_rate': 10000.0, 'seed': 3, 'excitation': 'multisine'}
    _, _, offline = compute(run, 'weak')
    settings = {**bridge_settings, **run}
    start('identifier', estimator='weak')
    start('transform')
    start('sensor_bridge', **settings)
    final = watcher.final_estimate(240)
    assert final.estimator == 'weak'
    assert same_bits(final, offline)
    truth = {
        one.name: one.value
        for one in assemble(load_machine(bridge_settings['machine_file']).machine).parameters
    }
    for one in final.parameters:
        assert one.status == one.STATUS_OK, one.note
        assert abs(one.value - truth[one.name]) < 5 * one.standard_deviation
        assert one.lower < one.value < one.upper


def test_one_process_gives_the_bits_of_the_core(start, bridge_settings, offline, bits, tmp_path):
    bag = tmp_path / 'run'
    settings = {**bridge_settings, 'wait_for_consumers': 3}
    assert start('stand', **settings, path=bag, exit_at_end=True).exit_code() == 0
    *_, final = read_estimates(bag)
    assert final.stream_ended
    assert bits(final.estimate) == bits(offline)


def test_recorded_bag_replays_to_the_same_bits(
    start, watcher, bridge_settings, offline, same_bits, tmp_path, blocks
):
    bag = tmp_path / 'run.mcap'
    consumers = [start('recorder', path=bag), start('identifier'), start('transform')]
    bridge = start('sensor_bridge', **{**bridge_settings, 'wait_for_consumers': 3})
    live = watcher.final_estimate()
    for process in [bridge, *reversed(consumers)]:
        process.signal(15)
    assert [process.exit_code() for process in [bridge, *consumers]] == [0] * 4

    recorded = list(open_bag(bag).blocks())
    assert [block.samples.tobytes() for block in recorded] == [
        block.samples.tobytes() for block in blocks
    ]
    watcher.estimates.clear()
    start('stand', source='bag', bag=bag, speed=0.0, wait_for_consumers=2)
    replayed = watcher.final_estimate()
    assert same_bits(replayed, offline)
    assert replayed.header == live.header
    assert replayed.stream_id == live.stream_id
