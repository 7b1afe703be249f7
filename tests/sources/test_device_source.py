# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Devices become a stream of SI samples that survives whatever the devices do."""

import threading
import time

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.good_news import GoodNews
from identnl_ros.core.measurement.blocks import ChannelStatus
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.sources.device import DeviceChannel, DeviceLost
from identnl_ros.sources.device_channels import sensors_of_devices
from identnl_ros.sources.device_reader import Patience
from identnl_ros.sources.device_source import DeviceSource
import numpy as np
import pytest

from tests.sources.scripted_device import BEGIN, RATE, ScriptedDevice

HASTY = Patience(silence=0.3, pause=0.01, longest_pause=0.02)
SIZE = 50  # of a block at this rate


def probe(name, **options):
    return Sensor(name, SensorKind.DISPLACEMENT, body='table', **options)


def layout(*sensors):
    return Layout(sensors or (probe('x', column='a'), probe('y', column='b')))


class Stream:
    """Blocks of a source, taken one by one."""

    def __init__(self, *devices, sensors=(), **options):
        self.told = []
        options = {'patience': HASTY, 'tell': self.told.append, **options}
        self.source = DeviceSource(devices, layout(*sensors), **options)
        self._blocks = self.source.blocks()

    def take(self, count):
        return [next(self._blocks) for _ in range(count)]

    def rest(self):
        self.source.end()
        return list(self._blocks)


@pytest.fixture
def stream():
    streams = []

    def make(*devices, **options):
        streams.append(Stream(*devices, **options))
        return streams[-1]

    yield make
    for one in streams:
        one.source.end()


@pytest.fixture
def device():
    return ScriptedDevice({'a': '', 'b': ''})


def ramp(first, count, channels=2):
    """Make samples that tell their index and channel."""
    return np.add.outer(np.arange(first, first + count, dtype=float), np.arange(channels) / 4)


@pytest.mark.parametrize('size', [1, 7, 50, 130])
def test_samples_of_one_device_pass_bit_for_bit_in_blocks_of_the_usual_size(stream, device, size):
    run = stream(device)
    for first in range(0, 300, size):
        device.give(5000 + first, ramp(first, min(size, 300 - first)))
    blocks = run.take(6)
    assert [block.first_index for block in blocks] == [0, 50, 100, 150, 200, 250]
    assert np.array_equal(np.concatenate([block.samples for block in blocks]), ramp(0, 300))
    # The first sample has the number 5000 of the device, at 1 kHz.
    stamps = [BEGIN + (5000 + block.first_index) * 10**6 for block in blocks]
    assert [block.stamp_ns for block in blocks] == stamps
    (last,) = run.rest()
    assert last.last
    assert (last.first_index, len(last.samples)) == (300, 0)
    assert device.closed == 1


def test_unfinished_block_is_given_out_at_the_end(stream, device):
    run = stream(device)
    device.give(0, ramp(0, 70))
    run.take(1)
    tail, last = run.rest()
    assert np.array_equal(tail.samples, ramp(50, 20))
    assert last.first_index == 70


def test_samples_the_device_lost_are_a_jump_of_the_index(stream, device):
    run = stream(device)
    device.give(0, ramp(0, 60))
    device.give(90, ramp(90, 60))
    blocks = run.take(3)
    spans = [(block.first_index, block.next_index) for block in blocks]
    assert spans == [(0, 50), (50, 60), (90, 140)]
    assert np.array_equal(blocks[2].samples, ramp(90, 50))
    assert run.source.devices[0].lost_samples == 30


def test_recorded_numbers_become_the_quantity_in_si(stream):
    # 80 mV/um, 0.5 V at zero, creeping by 2 mV/s: what the probe gives while the table is at 3 um.
    sensors = (
        probe('x', column='b', recorded_unit='V', gain=80e3, offset=0.5, drift=2e-3),
        probe('y', column='a', recorded_unit='um', gain=1e6),
    )
    device = ScriptedDevice({'a': 'nm', 'b': 'mV'})
    run = stream(device, sensors=sensors)
    for first in (0, 4000):
        time = (first + np.arange(SIZE)) / RATE
        volts = 80e-3 * 3 + 0.5 + 2e-3 * time
        device.give(first, np.column_stack((np.full(SIZE, 2500.0), 1e3 * volts)))
    for block in run.take(2):
        np.testing.assert_allclose(block.samples, [[3e-6, 2.5e-6]] * SIZE, rtol=1e-12)
        assert block.channel_status.tolist() == [0, 0]


def test_saturated_and_missing_samples_are_marked(stream):
    sensors = (
        probe('x', column='a', recorded_unit='V', gain=1e6, full_scale=10.0),
        probe('y', column='b', recorded_unit='V', gain=1e6),
    )
    device = ScriptedDevice({'a': 'mV', 'b': 'V'})
    run = stream(device, sensors=sensors)
    samples = np.ones((100, 2))
    samples[3, 0], samples[4, 0] = 9_999.0, -10_000.0
    samples[10, 1], samples[11, 1] = np.nan, np.inf
    device.give(0, samples)
    first, second = run.take(2)
    assert first.channel_status.tolist() == [
        ChannelStatus.SATURATED,
        ChannelStatus.MISSING_SAMPLES,
    ]
    assert np.argwhere(np.isnan(first.samples)).tolist() == [[4, 0], [10, 1], [11, 1]]
    assert second.channel_status.tolist() == [0, 0]


def test_missing_channel_is_told_with_what_there_is_the_closest_first():
    device = ScriptedDevice({'force': '', 'ai10': '', 'ai1': ''})
    with pytest.raises(LayoutError, match=r'sensor x: found no channel "AI_1".*of ai1, ai10, for'):
        DeviceSource([device], layout(probe('x', column='AI_1')))
    assert device.closed == 1


def test_channels_of_several_devices_are_told_as_a_layout_writes_them():
    # As topics name their channels; a name that both devices have needs its device.
    devices = [
        ('/rig/cell', (DeviceChannel('/rig/cell.wrench.force.x', 'N'), DeviceChannel('t', ''))),
        ('/rig/probe', (DeviceChannel('/rig/probe.data', ''), DeviceChannel('t', ''))),
    ]

    def told(column):
        with pytest.raises(LayoutError) as error:
            sensors_of_devices(layout(probe('x', column=column)), devices, print)
        return str(error.value)

    wrong = told('/rig/cell.force.x')
    assert wrong.endswith('; did you mean "/rig/cell.wrench.force.x"?')
    _, _, listed = wrong.partition(', expected one of ')
    names = listed.partition(';')[0].split(', ')
    assert sorted(names) == [
        '/rig/cell.wrench.force.x',
        '/rig/cell/t',
        '/rig/probe.data',
        '/rig/probe/t',
    ]
    for name in names:
        force = Sensor('f', SensorKind.FORCE, excitation='shaker', column=name)
        place = probe('x', column=name)
        sensors_of_devices(layout(force if 'force' in name else place), devices, print)
    assert 'did you mean' not in told('speed')


def test_unit_of_another_quantity_is_refused():
    device = ScriptedDevice({'a': 'm/s', 'b': ''})
    with pytest.raises(LayoutError, match=r'sensor x: device box gives channel a in m/s.* m \('):
        DeviceSource([device], layout())


def test_unknown_unit_is_taken_for_that_of_the_layout_and_told(stream):
    device = ScriptedDevice({'a': 'furlgons', 'b': ''})
    run = stream(device)
    assert 'furlgons, which is no known unit; taken for m' in run.told[0]


def test_channel_that_two_devices_have_needs_the_device():
    devices = [ScriptedDevice({'a': '', 'b': ''}, name) for name in ('left', 'right')]
    with pytest.raises(LayoutError, match='any of left/a, right/a; write it with its device'):
        DeviceSource(devices, layout())


def test_device_without_a_sensor_is_not_used(stream, device):
    other = ScriptedDevice({'a': '', 'c': ''}, 'other')
    sensors = (probe('x', column='box/a'), probe('y', column='b'))
    run = stream(other, device, sensors=sensors)
    other.give(0, ramp(0, SIZE))
    device.give(0, ramp(0, SIZE))
    assert np.array_equal(run.take(1)[0].samples, ramp(0, SIZE))
    assert [state.name for state in run.source.devices] == ['box']
    assert 'other: no sensor of the layout is read from it' in run.told[0]


@pytest.mark.parametrize(
    ('opening', 'kind', 'words'),
    [
        (DeviceLost('no answer from 10.0.0.7'), DeviceLost, 'device box: no answer from 10.0.0.7'),
        (DataError('no task'), DataError, 'device box: no task'),
        (KeyError('task'), DataError, 'device box: unexpected error .*KeyError'),
    ],
)
def test_device_that_cannot_be_opened_is_told(opening, kind, words):
    device = ScriptedDevice({'a': '', 'b': ''}, openings=[opening])
    with pytest.raises(kind, match=words):
        DeviceSource([device], layout())
    end = time.monotonic() + 5
    while 'close' not in device.calls and time.monotonic() < end:
        time.sleep(0.01)
    assert device.calls == ['open', 'close']


def test_single_device_keeps_its_rate(device):
    with pytest.raises(DataError, match='500 Hz, but device box samples at 1000 Hz'):
        DeviceSource([device], layout(), sample_rate=500.0)


@pytest.mark.parametrize(
    'loss',
    [
        DeviceLost('cable'),
        RuntimeError('segment violated'),
        None,  # silence
        np.ones((5, 3)),  # a channel too many
    ],
    ids=['lost', 'foreign error', 'silence', 'other shape'],
)
def test_stream_goes_on_after_a_loss_as_far_as_time_has_passed(stream, device, loss):
    run = stream(device)
    device.openings = [DeviceLost('still away'), OSError('still away')]
    device.give_now(700, ramp(0, 60))
    before = run.take(1)
    if isinstance(loss, np.ndarray):
        device.give(760, loss)
    elif loss is not None:
        device.items.put(loss)
    before += run.take(1)  # what had come when it was lost
    assert [len(block.samples) for block in before] == [50, 10]
    assert device.reopened.wait(10)
    # Closed before each opening, also after one that failed, so that no device need clean up.
    assert device.calls == ['open', 'close', 'open', 'close', 'open', 'close', 'open']
    assert run.source.devices[0].problem
    device.give_now(0, ramp(0, SIZE))
    (after,) = run.take(1)
    assert after.stream_id == before[0].stream_id
    # 1 kHz: the index and the stamps [ns] go the same way.
    passed = (after.stamp_ns - before[0].stamp_ns) / 1e6
    assert after.first_index - before[0].first_index == pytest.approx(passed, abs=1)
    state = run.source.devices[0]
    assert (state.problem, state.reconnects) == ('', 1)
    assert state.lost_samples == after.first_index - 60
    assert [sentence.split(':')[0].split(' after')[0] for sentence in run.told] == [
        'device box is lost',
        'device box is back',
    ]
    assert [isinstance(sentence, GoodNews) for sentence in run.told] == [False, True]


def test_clock_of_the_device_counts_on_while_it_is_away(stream, device):
    run = stream(device)
    device.give_now(700, ramp(0, SIZE))
    run.take(1)
    device.items.put(DeviceLost('cable'))
    assert device.reopened.wait(10)
    # 123 samples by its clock, which the stamps of the host confirm roughly.
    device.give_now(700 + SIZE + 123, ramp(0, SIZE))
    assert run.take(1)[0].first_index == SIZE + 123


def test_device_that_counts_anew_by_itself_goes_on(stream, device):
    run = stream(device)
    device.give_now(10**6, ramp(0, SIZE))
    device.give_now(0, ramp(0, SIZE))
    first, second = run.take(2)
    assert second.first_index > first.next_index
    assert 'counts anew' in run.told[0]


def test_device_that_comes_back_changed_is_told_and_not_used(stream, device):
    run = stream(device)
    was = device.channels
    device.channels = was[::-1]
    device.items.put(DeviceLost('cable'))
    while 'has come back with the channels b, a' not in run.source.devices[0].problem:
        assert device.reopened.wait(10)
    device.channels = was
    device.give(0, ramp(0, SIZE))
    assert run.take(1)[0].first_index == 0


def test_stream_ends_while_a_device_hangs(stream, device):
    answers = threading.Event()
    run = stream(device)
    hangs = threading.Event()
    device.openings = [lambda: (hangs.set(), answers.wait(60))]
    device.give(0, ramp(0, SIZE))
    device.items.put(DeviceLost('cable'))
    assert hangs.wait(10)
    *_, last = run.rest()
    assert last.last
    assert not answers.is_set()
    answers.set()


def test_samples_that_nobody_takes_are_lost_and_counted(stream, device):
    run = stream(device)
    count = 10_000  # 10 s
    for first in range(0, count, 100):
        device.give(first, ramp(first, 100))
    device.items.put(DeviceLost('enough'))
    assert device.reopened.wait(10)
    blocks = run.rest()
    taken = sum(len(block.samples) for block in blocks)
    state = run.source.devices[0]
    assert 0 < taken <= 2.0 * RATE
    assert (state.samples, state.lost_samples) == (count, count - taken)


def test_measured_rate_is_that_of_the_stamps(stream, device):
    run = stream(device)
    for first in (0, 50, 100):
        # A clock that is 2 % fast.
        device.give(first, ramp(0, SIZE), BEGIN + round(first / 1020 * 1e9))
    run.take(3)
    assert run.source.devices[0].measured_rate == pytest.approx(1020, rel=1e-6)
