# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Topics of others, over DDS, as devices."""

from itertools import pairwise
import threading
import time

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy')

from geometry_msgs.msg import AccelStamped, WrenchStamped  # noqa: E402
from identnl_ros.core.errors import DataError  # noqa: E402
from identnl_ros.nodes.topic_clock import TopicClock  # noqa: E402
from identnl_ros.nodes.topic_device import source  # noqa: E402
from identnl_ros.sources.device import DeviceChannel, DeviceLost  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: E402
from sensor_msgs.msg import Imu  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402

from tests.nodes.conftest import PATIENCE  # noqa: E402

pytestmark = pytest.mark.ros

RATE = 500.0
PERIOD = round(1e9 / RATE)
BEGIN = 1_700_000_000 * 10**9


class Publisher:
    """Publishes messages in a thread, one each 2 ms, until told to stop."""

    def __init__(self, kind, topic, make, plan, reliable=True):
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('sensor', context=self.context, use_global_arguments=False)
        reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self.publisher = self.node.create_publisher(
            kind, topic, QoSProfile(depth=1000, reliability=reliability)
        )
        self.make, self.plan = make, plan
        self.stopped = threading.Event()
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self):
        while not self.publisher.get_subscription_count() and not self.stopped.is_set():
            time.sleep(0.01)
        time.sleep(0.3)  # the subscription must know the publisher too
        for number in self.plan:
            if self.stopped.is_set():
                return
            self.publisher.publish(self.make(number))
            time.sleep(0.002)

    def stop(self):
        self.stopped.set()
        self.thread.join()
        if self.context.ok():
            self.node.destroy_node()
            rclpy.shutdown(context=self.context)


@pytest.fixture
def publish(ros_domain):
    started = []

    def begin(*arguments, **options):
        started.append(Publisher(*arguments, **options))
        return started[-1]

    yield begin
    for publisher in started:
        publisher.stop()


@pytest.fixture
def device_of(ros_domain):
    made = []

    def make(topics, **settings):
        values = {one.name: one.default for one in source.settings}
        devices = source.devices({**values, 'topics': topics, **settings}.__getitem__)
        made.extend(devices)
        return devices[0]

    yield make
    for device in made:
        device.close()


def stamped(message, number, jitter_ns=0):
    nanoseconds = BEGIN + number * PERIOD + jitter_ns
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)
    return message


def read(device, samples):
    blocks, end = [], time.monotonic() + PATIENCE
    while sum(len(block.samples) for block in blocks) < samples:
        assert time.monotonic() < end, f'{samples} samples did not come'
        if block := device.read(0.2):
            blocks.append(block)
    return blocks


@pytest.mark.parametrize('reliable', [True, False])
def test_imu_with_jitter_losses_duplicates_and_late_messages(publish, device_of, reliable):
    jitter = np.random.default_rng(7).uniform(-0.3 * PERIOD, 0.3 * PERIOD, 400).astype(int)
    plan = [*range(100), 99, *range(103, 200), 150, *range(200, 400)]

    def imu(number):
        message = stamped(Imu(), number, int(jitter[number]))
        force = message.linear_acceleration
        force.x, force.y, force.z = float(number), -float(number), 9.81
        message.angular_velocity.x = 1e6
        return message

    publish(Imu, '/spindle/imu', imu, plan, reliable=reliable)
    device = device_of(['/spindle/imu'], rate=RATE)
    channels = device.open()
    blocks = read(device, 397)
    assert channels == tuple(
        DeviceChannel(f'/spindle/imu.linear_acceleration.{axis}', 'm/s^2') for axis in 'xyz'
    )
    assert device.sample_rate == RATE
    assert device.dropped == 2
    begin = blocks[0].samples[0, 0]
    for block in blocks:
        # The value is the number of the message: so the index is right, over the gap too.
        expected = begin + block.first_index + np.arange(len(block.samples))
        np.testing.assert_array_equal(block.samples[:, 0], expected)
        np.testing.assert_array_equal(
            block.samples[:, 1:], np.stack([-expected, 0 * expected + 9.81]).T
        )
        truth = BEGIN + expected[0] * PERIOD
        # An error of 0.3 periods in the first stamp fades.
        assert abs(block.stamp_ns - truth) < 0.35 * PERIOD
    assert (
        sum(
            following.first_index != block.first_index + len(block.samples)
            for block, following in pairwise(blocks)
        )
        == 1
    )


def test_wrench_gives_forces_and_the_rate_is_measured(publish, device_of):
    def wrench(number):
        message = stamped(WrenchStamped(), number)
        message.wrench.force.z = 2.0 * number
        message.wrench.torque.z = 1e6
        return message

    publish(WrenchStamped, '/table/force', wrench, range(200))
    device = device_of(['/table/force:geometry_msgs/msg/WrenchStamped'])
    channels = device.open()
    assert [one.unit for one in channels] == ['N'] * 3
    assert channels[2].name == '/table/force.wrench.force.z'
    assert device.sample_rate == pytest.approx(RATE, rel=1e-6)
    values = np.concatenate([block.samples for block in read(device, 200)])
    np.testing.assert_array_equal(values[:, 2], 2.0 * np.arange(200))


def test_number_without_stamp_is_counted_and_warned_of(publish, device_of, capfd):
    publish(Float64, '/gap', lambda number: Float64(data=float(number)), range(200))
    device = device_of(['gap'], rate=RATE)
    begin = time.time_ns()
    (channel,) = device.open()
    blocks = read(device, 200)
    assert channel == DeviceChannel('/gap.data', '')
    np.testing.assert_array_equal(
        np.concatenate([block.samples for block in blocks])[:, 0], np.arange(200)
    )
    assert blocks[-1].first_index + len(blocks[-1].samples) == 200
    assert begin < blocks[0].stamp_ns < blocks[-1].stamp_ns <= time.time_ns()
    assert 'messages without stamp' in capfd.readouterr().err


def test_sensor_that_does_not_measure_gives_no_numbers(publish, device_of):
    def imu(number):
        message = stamped(Imu(), number)
        message.linear_acceleration_covariance[0] = -1.0
        return message

    publish(Imu, '/imu', imu, range(50))
    device = device_of(['/imu'], rate=RATE)
    device.open()
    assert all(np.isnan(block.samples).all() for block in read(device, 50))


def test_silent_topic_gives_nothing_and_one_without_publisher_is_lost(publish, device_of):
    make = lambda number: stamped(AccelStamped(), number)  # noqa: E731
    publisher = publish(AccelStamped, '/head', make, range(100))
    device = device_of(['/head'], rate=RATE, publisher_timeout=0.3)
    device.open()
    read(device, 100)
    publisher.thread.join()
    assert device.read(0.5) is None
    assert device.read(0.5) is None
    publisher.stop()
    end = time.monotonic() + PATIENCE
    with pytest.raises(DeviceLost, match='nobody has published it'):  # noqa: PT012
        while time.monotonic() < end:
            device.read(0.1)
    before = threading.active_count()
    device.close()
    device.close()
    assert threading.active_count() < before


def test_unfit_topics_are_refused_in_words(publish, device_of, monkeypatch):
    from identnl_ros.nodes import topic_device
    from std_msgs.msg import String

    monkeypatch.setattr(topic_device, 'WAIT', 0.5)
    with pytest.raises(DeviceLost, match='nobody publishes it'):
        device_of(['/nothing']).open()
    publish(String, '/words', lambda _: String(), range(1))
    monkeypatch.setattr(topic_device, 'WAIT', PATIENCE)
    with pytest.raises(DataError, match='its messages are std_msgs/msg/String, expected geom'):
        device_of(['/words']).open()
    with pytest.raises(DataError, match='setting topics is empty'):
        device_of([''])
    with pytest.raises(DataError, match='has the type sensor_msgs/msg/Joy, expected'):
        device_of(['/pad:sensor_msgs/msg/Joy'])


@pytest.mark.parametrize('deviation', [-0.01, 0.0, 0.01])
def test_clock_follows_a_rate_beside_the_nominal_one(deviation):
    # 1 % beside the nominal rate: without following it the index is off after 50 messages.
    generator = np.random.default_rng(3)
    times = np.arange(5000) * 1e6 / (1 + deviation)
    stamps = times + generator.uniform(-0.2e6, 0.2e6, times.size)
    clock = TopicClock(1000.0, is_stamped=True)
    numbered = [clock.number(BEGIN + round(stamp)) for stamp in stamps]
    assert [one.index for one in numbered] == list(range(5000))
    error = np.array([one.stamp_ns - BEGIN for one in numbered[500:]]) - times[500:]
    assert np.abs(error).max() < 0.3e6


def test_a_rate_that_the_messages_deny_is_told(publish, device_of, capfd):
    publish(AccelStamped, '/cell', lambda i: stamped(AccelStamped(), i), range(10**6))
    device = device_of(['/cell'], rate=1250.0)
    device.open()
    read(device, 60)
    assert '/cell: publishes 500 Hz, topics.rate says 1250' in capfd.readouterr().err


def test_a_rate_that_is_right_is_not_told(publish, device_of, capfd):
    publish(AccelStamped, '/cell', lambda i: stamped(AccelStamped(), i), range(10**6))
    device = device_of(['/cell'], rate=RATE)
    device.open()
    read(device, 60)
    assert 'topics.rate' not in capfd.readouterr().err
