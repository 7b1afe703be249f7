# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Topics that other nodes publish raw samples on, as devices."""

from collections import deque
from collections.abc import Callable
import contextlib
from dataclasses import dataclass
import importlib
import itertools
from operator import attrgetter
import os
import queue
import threading
import time
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.nodes.topic_clock import Numbered, TopicClock
from identnl_ros.sources.device import Device, DeviceBlock, DeviceChannel, DeviceLost
from identnl_ros.sources.setting import Setting, without_empty
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

WAIT = 5.0  # [s] for a publisher and the messages that tell the rate
COLLECTION_TIME = 0.02  # [s]; messages of this time are delivered together
DEPTH = 5000
MESSAGES_FOR_RATE = 50
# A rate that is given may differ by so much from that of the messages, by few of them [-].
RATE_TOLERANCE = 0.05
GRAPH_INTERVAL = 0.2  # [s]
_numbers = itertools.count()


@dataclass(frozen=True)
class _Kind:
    """What is read of a type of message."""

    fields: tuple[str, ...]
    unit: str
    is_stamped: bool = True
    covariance: str = ''


def _axes(field: str) -> tuple[str, ...]:
    return tuple(f'{field}.{axis}' for axis in 'xyz')


KINDS = {
    'geometry_msgs/msg/AccelStamped': _Kind(_axes('accel.linear'), 'm/s^2'),
    'geometry_msgs/msg/WrenchStamped': _Kind(_axes('wrench.force'), 'N'),
    'sensor_msgs/msg/Imu': _Kind(
        _axes('linear_acceleration'), 'm/s^2', covariance='linear_acceleration_covariance'
    ),
    'std_msgs/msg/Float64': _Kind(('data',), '', is_stamped=False),
}


@dataclass(frozen=True)
class _Message:
    """A message that has come; without stamp: 0."""

    stamp_ns: int
    arrival_ns: int
    values: Any


class TopicDevice:
    """
    A topic, each message of which is a sample.

    Parameters
    ----------
    topic : str
        Absolute name.
    type_name : str
        Of its messages; empty: that which its publisher states.
    rate : float
        Messages per second [Hz]; 0: that of the first ones.
    patience : float
        How long the topic may be without publisher [s].

    """

    def __init__(self, topic: str, type_name: str, rate: float, patience: float) -> None:
        self._topic = topic
        self._type_name = type_name
        self._rate = rate
        self._patience = patience
        self._context: Context | None = None
        self._node: Any = None
        self._executor: SingleThreadedExecutor | None = None
        self._thread: threading.Thread | None = None
        self._messages: queue.SimpleQueue[_Message] = queue.SimpleQueue()
        self._ready: deque[DeviceBlock] = deque()
        self._published = self._looked = 0.0
        self._given = rate > 0
        self._times: list[int] | None = None

    @property
    def name(self) -> str:
        """Name of the topic."""
        return self._topic

    @property
    def sample_rate(self) -> float:
        """Nominal rate [Hz]."""
        if self._rate <= 0:
            raise DataError('its rate is not known before it is open')
        return self._rate

    @property
    def dropped(self) -> int:
        """Messages that were duplicates or came after later ones, since it was opened."""
        return self._clock.dropped

    def open(self) -> tuple[DeviceChannel, ...]:
        """Subscribe and wait for messages; see `Device`."""
        # Of its own, so that nothing of the node that reads it is touched.
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self._node = rclpy.create_node(
            f'identnl_topic_reader_{os.getpid()}_{next(_numbers)}',
            context=self._context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        end = time.monotonic() + WAIT
        type_name = self._type_name or self._published_type(end)
        kind = KINDS.get(type_name)
        if kind is None:
            raise DataError(f'its messages are {type_name}, expected {", ".join(sorted(KINDS))}')
        self._kind = kind
        self._values = attrgetter(*kind.fields)
        package, _, message = type_name.partition('/msg/')
        self._node.create_subscription(
            getattr(importlib.import_module(f'{package}.msg'), message),
            self._topic,
            self._receive,
            # It takes what reliable publishers send too.
            QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT),
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, args=(self._executor,), daemon=True)
        self._thread.start()
        first = self._first_messages(end)
        self._is_stamped = kind.is_stamped and first[0].stamp_ns != 0
        if not self._is_stamped:
            self._node.get_logger().warning(
                f'{self._topic}: messages without stamp; the time of their arrival is taken, '
                'with all its jitter'
            )
        if self._rate <= 0:
            self._rate = _rate([self._time_of(one) for one in first], self._is_stamped)
        self._times = [] if self._given else None
        self._clock = TopicClock(self._rate, self._is_stamped)
        self._published = time.monotonic()
        self._ready.extend(self._blocks(first))
        return tuple(DeviceChannel(f'{self._topic}.{one}', kind.unit) for one in kind.fields)

    def read(self, timeout: float) -> DeviceBlock | None:
        """Give the messages that have come; see `Device`."""
        if self._node is None:
            raise DeviceLost('it is not open')
        if not self._ready:
            try:
                messages = [self._messages.get(timeout=max(timeout, 0.0))]
            except queue.Empty:
                self._look_for_publisher()
                return None
            time.sleep(COLLECTION_TIME)
            while not self._messages.empty():
                messages.append(self._messages.get())
            self._published = time.monotonic()
            self._ready.extend(self._blocks(messages))
        return self._ready.popleft() if self._ready else None

    def close(self) -> None:
        """Let go of it; never raises."""
        if self._executor is not None:
            self._executor.shutdown()
        if self._thread is not None:
            self._thread.join()
        if self._node is not None:
            self._node.destroy_node()
        if self._context is not None:
            self._context.try_shutdown()
        self._context = self._node = self._executor = self._thread = None
        self._messages = queue.SimpleQueue()
        self._ready.clear()

    def _published_type(self, end: float) -> str:
        while True:
            infos = self._node.get_publishers_info_by_topic(self._topic)
            names = sorted({info.topic_type for info in infos})
            if len(names) > 1:
                raise DataError(
                    f'its publishers disagree on the type ({", ".join(names)}); '
                    f'name one in topics: {self._topic}:{names[0]}'
                )
            if names:
                return str(names[0])
            if time.monotonic() > end:
                raise DeviceLost('nobody publishes it')
            time.sleep(0.02)

    def _first_messages(self, end: float) -> list[_Message]:
        """Wait for the first message, or for as many as tell the rate."""
        messages: list[_Message] = []
        count = 1 if self._rate > 0 else MESSAGES_FOR_RATE
        while len(messages) < count:
            try:
                messages.append(self._messages.get(timeout=max(end - time.monotonic(), 1e-3)))
            except queue.Empty:
                raise DeviceLost(
                    f'{len(messages)} messages have come in {WAIT:g} s, expected {count}'
                ) from None
        return messages

    def _receive(self, message: Any) -> None:
        arrival_ns, stamp_ns = time.time_ns(), 0
        if self._kind.is_stamped:
            stamp = message.header.stamp
            stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        values: Any = self._values(message)
        if self._kind.covariance and getattr(message, self._kind.covariance)[0] == -1.0:
            values = np.full(len(self._kind.fields), np.nan)  # the sensor does not measure it
        self._messages.put(_Message(stamp_ns, arrival_ns, values))

    def _time_of(self, message: _Message) -> int:
        return message.stamp_ns if self._is_stamped else message.arrival_ns

    def _blocks(self, messages: list[_Message]) -> list[DeviceBlock]:
        """Join messages without gap."""
        self._compare_rate(messages)
        found: list[tuple[Numbered, list[Any]]] = []
        for message in messages:
            at = self._clock.number(self._time_of(message))
            if at is None:
                continue
            if not found or at.index != found[-1][0].index + len(found[-1][1]):
                found.append((at, []))
            found[-1][1].append(message.values)
        width = len(self._kind.fields)
        return [
            DeviceBlock(at.index, at.stamp_ns, np.array(values, dtype=float).reshape(-1, width))
            for at, values in found
        ]

    def _compare_rate(self, messages: list[_Message]) -> None:
        """Tell once if the first messages do not come at the rate that was given."""
        if self._times is None:
            return
        self._times += [self._time_of(one) for one in messages]
        if len(self._times) < MESSAGES_FOR_RATE:
            return
        times, self._times = self._times, None
        with contextlib.suppress(DataError):  # stamps that tell none
            told = _rate(times, self._is_stamped)
            if abs(told / self._rate - 1) > RATE_TOLERANCE:
                self._node.get_logger().warning(
                    f'{self._topic}: publishes {told:.4g} Hz, topics.rate says {self._rate:g}; '
                    'correct it (0: measured)'
                )

    def _look_for_publisher(self) -> None:
        now = time.monotonic()
        if now - self._looked < GRAPH_INTERVAL:
            return
        self._looked = now
        if self._node.count_publishers(self._topic):
            self._published = now
        elif now - self._published > self._patience:
            raise DeviceLost(f'nobody has published it for {self._patience:g} s')

    @staticmethod
    def _spin(executor: SingleThreadedExecutor) -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()


class TopicDevices:
    """The topics that the settings name, each with a clock of its own."""

    settings = (
        Setting(
            'topics',
            [''],
            'Topics to read, such as /spindle/imu, or /spindle/imu:sensor_msgs/msg/Imu to name '
            f'the type; types: {", ".join(sorted(KINDS))}.',
        ),
        Setting(
            'rate',
            0.0,
            'Messages per second of each topic [Hz]; 0: measured with the first messages.',
            0.0,
            1e5,
        ),
        Setting(
            'publisher_timeout',
            1.0,
            'A topic that nobody has published for so long is lost [s].',
            0.0,
            1e6,
        ),
    )

    def devices(self, setting: Callable[[str], Any]) -> list[Device]:
        """Make what the settings describe; see `KindOfDevice`."""
        entries = without_empty(setting('topics'))
        if not entries:
            raise DataError('setting topics is empty; give topics such as ["/spindle/imu"]')
        devices: list[Device] = []
        for entry in dict.fromkeys(entries):
            topic, _, type_name = entry.partition(':')
            if type_name and type_name not in KINDS:
                raise DataError(
                    f'setting topics: {entry} has the type {type_name}, '
                    f'expected {", ".join(sorted(KINDS))}'
                )
            topic = topic if topic.startswith('/') else f'/{topic}'
            rate, patience = setting('rate'), setting('publisher_timeout')
            devices.append(TopicDevice(topic, type_name, rate, patience))
        return devices


def _rate(stamps: list[int], is_stamped: bool) -> float:
    """Measure the rate; that of stamps is not misled by some lost or doubled messages."""
    if not is_stamped:
        return (len(stamps) - 1) * 1e9 / max(stamps[-1] - stamps[0], 1)
    periods = np.diff(np.sort(stamps))
    period = float(np.median(periods[periods > 0])) if (periods > 0).any() else 0.0
    near = periods[np.abs(periods - period) < 0.5 * period]
    if period == 0 or near.size < len(stamps) // 2:
        raise DataError('its stamps do not tell its rate; give it in the setting rate')
    return float(1e9 / near.mean())


source = TopicDevices()
