# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""A live stand is diagnosed like its bag, on request or by itself, and nothing waits for it."""

from dataclasses import replace
import json
import math
import os
from pathlib import Path
import subprocess
import sys

from click.testing import CliRunner
from identnl_msgs.msg import DiscrepancyReport
from identnl_ros.cli.commands import cli
from identnl_ros.core.errors import DataError
from identnl_ros.nodes import qos
from identnl_ros.nodes.live_diagnosis import LiveDiagnosis
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.machine_file import read_machine
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from std_srvs.srv import Trigger

pytestmark = pytest.mark.ros

CONFIG = Path(__file__).resolve().parents[2] / 'config'
DURATION = 3.0
START_TIME = 30.0  # [s]
REPORT_TIME = 60.0  # [s]


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Record a stand with friction that its machine file does not tell."""
    path = tmp_path_factory.mktemp('friction') / 'run.mcap'
    layout = path.with_name('layout.yaml')
    text = (CONFIG / 'oscillator_layout.yaml').read_text('utf-8').rstrip()
    layout.write_text(f'{text}\n    noise: 0.1 mV\n', 'utf-8')
    made = CliRunner().invoke(cli, [
        'simulate', '--machine', str(CONFIG / 'oscillator.yaml'), '--layout', str(layout),
        '--duration', str(DURATION), '--hide', 'coulomb_friction:spring.axis_1:5%',
        '--out', str(path),
    ])  # fmt: skip
    assert made.exit_code == 0, made.output
    return path


@pytest.fixture
def reports(watcher):
    arrived = []
    watcher.node.create_subscription(
        DiscrepancyReport, 'discrepancy', arrived.append, qos.discrepancy()
    )
    return arrived


def diagnosed(bag, folder):
    """Ask the command line, with as many threads of linear algebra as a node has."""
    command = [sys.executable, '-m', 'identnl_ros.cli.main', 'diagnose', bag, '--json']
    done = subprocess.run(
        [*command, '--out', folder],
        env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'}, capture_output=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), (folder / 'machine.yaml').read_text('utf-8')


def children(process):
    """List the numbers of the processes that a process has started."""
    return Path(f'/proc/{process.pid}/task/{process.pid}/children').read_text().split()


def test_report_is_that_of_the_recorded_bag(start, watcher, reports, bag, tmp_path):
    recorded = tmp_path / 'recorded.mcap'
    stand = start('stand', source='bag', bag=bag, speed=0.0, path=recorded, wait_for_consumers=3)
    watcher.final_estimate()
    answer = watcher.call(Trigger, 'identifier/diagnose')
    assert answer.success, answer.message
    assert f'{round(DURATION * 610.3515625)} samples' in answer.message
    watcher.until(lambda: reports, REPORT_TIME)
    (report,) = reports
    words = watcher.health_of('identifier: discrepancy', 'Coulomb friction')
    assert words == report.sentence
    assert watcher.health['bench/identifier: discrepancy'].values['verdict'] == 'explained'
    stand.signal(15)
    assert stand.exit_code() == 0

    offline, machine_file = diagnosed(recorded, tmp_path / 'offline')
    assert open_bag(recorded).topics['/bench/discrepancy'] == 'identnl_msgs/msg/DiscrepancyReport'
    assert offline['verdict'] == 'explained'
    assert report.verdict == DiscrepancyReport.VERDICT_EXPLAINED
    assert report.sentence == offline['summary']
    found, expected = report.findings[0], offline['findings'][0]
    assert len(report.findings) == len(offline['findings']) == 1
    assert (found.effect, found.location) == (expected['effect'], expected['location'])
    assert (found.effect, found.location) == ('coulomb_friction', 'spring.axis_1')
    assert found.p_value == expected['p_value']
    for one, other in zip(found.parameters, expected['parameters'], strict=True):
        assert (one.name, one.unit, one.value) == (other['name'], other['unit'], other['value'])
        deviation = other['standard_deviation']
        assert one.standard_deviation == (math.nan if deviation is None else deviation)
        assert one.lower < one.value < one.upper
    held_out = offline['held_out']
    assert report.held_out_error_before == held_out['before']['relative_force_error']
    assert report.held_out_error_after == held_out['after']['relative_force_error']
    assert report.held_out_error_floor == held_out['noise_floor']['relative_force_error']
    assert report.machine_file == machine_file
    assert read_machine(report.machine_file, 'report').name == 'oscillator'
    # The last sample was taken one sample before the end.
    stamp = report.header.stamp.sec * 10**9 + report.header.stamp.nanosec
    blocks = list(open_bag(recorded).blocks())
    end = blocks[-1].stamp_ns + round(len(blocks[-1].samples) / 610.3515625 * 1e9)
    assert end - stamp == pytest.approx(1e9 / 610.3515625, abs=2)
    assert report.stream_id == blocks[-1].stream_id
    assert report.stand == 'oscillator'


def test_estimates_keep_coming_while_a_diagnosis_runs(start, watcher, reports, bag):
    start('transform')
    start('identifier', publish_rate=20.0)
    answer = watcher.call(Trigger, 'identifier/diagnose')
    assert not answer.success
    assert 'no samples have come' in answer.message
    start('sensor_bridge', source='bag', bag=bag, speed=1.0, wait_for_consumers=2)
    watcher.until(lambda: watcher.estimates, START_TIME)
    watcher.until(lambda: watcher.call(Trigger, 'identifier/diagnose').success)
    count = len(watcher.estimates)
    assert not watcher.estimates[-1].stream_ended
    again = watcher.call(Trigger, 'identifier/diagnose')
    assert not again.success
    assert 'a diagnosis has been running for' in again.message
    watcher.until(lambda: reports or watcher.estimates[-1].stream_ended)
    assert len(watcher.estimates) - count >= 5
    samples = [one.samples_used for one in watcher.estimates[count - 1 :]]
    assert samples == sorted(set(samples))
    watcher.final_estimate()
    assert watcher.health['bench/identifier: stream'].values['samples lost'] == '0'


def test_samples_that_cannot_be_diagnosed_are_refused_in_words(bag):
    description = open_bag(bag).description
    blocks = list(open_bag(bag).blocks())
    forceless = [
        replace(block, samples=np.where([True, False], np.nan, block.samples)) for block in blocks
    ]
    for few, words in (
        (blocks[:4], '200 uninterrupted samples hold no run'),
        (blocks[:8], '300 uninterrupted samples with force are too few for a diagnosis'),
        (blocks[:20] + blocks[21:29], '300 uninterrupted samples with force are too few'),
        (forceless, 'no run with a measured force'),
    ):
        live = LiveDiagnosis()
        for block in few:
            live.readings.add(block)
        with pytest.raises(DataError, match=words):
            live.begin({description.stream_id: description}, lambda _: None)
        assert not live.is_running
        assert words in live.health().values['diagnosis']


def test_diagnosis_begins_by_itself_and_ends_with_the_node(start, watcher, reports, bag):
    stand = start(
        'stand', source='bag', bag=bag, speed=0.0, diagnose_every=0.2, wait_for_consumers=2
    )
    watcher.until(lambda: children(stand.process), START_TIME)
    (child,) = children(stand.process)
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
        request = Transition(id=transition)
        assert watcher.call(ChangeState, 'identifier/change_state', transition=request).success
    assert not Path(f'/proc/{child}').exists()
    assert not reports
