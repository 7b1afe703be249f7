# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The node that writes topics to a bag."""

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
import sys
import time
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from identnl_msgs.msg import (
    BodyMotionBlock,
    Consumed,
    DataQuality,
    DiscrepancyReport,
    ParameterEstimateArray,
    SampleBlock,
    StandDescription,
)
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.nodes import qos
from identnl_ros.nodes.consumption import BEAT, Progress
from identnl_ros.nodes.diagnosis import check_topic, Health, Level
from identnl_ros.nodes.managed_node import ManagedNode
from identnl_ros.nodes.running import run
from identnl_ros.sources.setting import Setting
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.message_reading import block_position
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

FLUSH_INTERVAL = 1.0  # [s] what a sudden death can cost
QUIET_TIME = 0.3  # [s] nothing for so long from nobody: all has arrived
LONGEST_QUIET = 2.0  # [s] nothing for so long, though somebody is there
GRACE_NS = NANOSECONDS  # what is published later is not waited for

TYPES = {
    'samples': SampleBlock,
    'motion': BodyMotionBlock,
    'quality': DataQuality,
    'stand_description': StandDescription,
    'estimates': ParameterEstimateArray,
    'discrepancy': DiscrepancyReport,
    'consumed': Consumed,
    '/diagnostics': DiagnosticArray,
}
LATCHED = ('stand_description', 'estimates', 'discrepancy')


class Recorder(ManagedNode):
    """
    Writes messages as they come, without decoding them, except to follow the samples.

    The bag is opened on configuration, filled while the node is active and closed on clean-up
    or at the end of the process.

    """

    settings: ClassVar[tuple[Setting, ...]] = (
        Setting(
            'path',
            '',
            'Bag to write, must not exist: one MCAP file if it ends in .mcap, else a folder.',
        ),
        Setting(
            'topics',
            ['samples', 'stand_description', 'estimates', 'discrepancy', '/diagnostics'],
            'Topics to record, relative to the namespace of the node unless they begin with /. '
            'Motion and quality are left out because they follow from the samples.',
        ),
        Setting('compress', False, 'Compress the bag (zstd); costs computing time.'),
    )

    def __init__(self, **options: Any) -> None:
        self._bag: BagWriter | None = None
        self._progress: Progress | None = None
        self._last_arrival = self._end_began = 0.0
        self._last_publication = self._latest_publication = 0
        self._recorded: dict[str, Subscription] = {}
        self.messages: dict[str, int] = {}
        super().__init__('recorder', **options)

    def configure(self) -> None:
        if not self.setting('path'):
            raise DataError('parameter path is empty; give the path of the bag to write')
        self.messages.clear()
        self._recorded.clear()
        self._followed = StreamFollower()
        self._streams: set[int] = set()
        self._path = Path(self.setting('path'))
        self._bag = BagWriter(
            self._path,
            namespace=self.get_namespace(),
            keep_partial=True,
            compress=self.setting('compress'),
        )
        self._wanted = list(self.setting('topics'))
        self._subscribe_to_known()
        self.every(FLUSH_INTERVAL, self._tend)
        self.every(BEAT, self._beat)

    def activate(self) -> None:
        # A source waits for who tells where it is, which a recorder learns from the samples.
        if 'samples' not in self._recorded:
            return
        self._progress = Progress(self, self._is_connected)
        for stream_id in self._streams:
            self._progress.expect(stream_id)
        self.get_logger().info(f'recording to {self._path}')

    def deactivate(self) -> None:
        if self._progress is not None:
            self._progress.close()
            self._progress = None

    def clean_up(self) -> None:
        if self._bag is not None:
            bag, self._bag = self._bag, None
            bag.close()
            if bag.is_empty:
                self.get_logger().warning(f'no message came: {self._path} is empty and removed')
                return
            count = sum(self.messages.values())
            self.get_logger().info(f'{self._path} is complete: {count} messages')

    def begin_to_end(self) -> None:
        self._end_began = time.monotonic()
        self._latest_publication = time.time_ns() + GRACE_NS

    def is_drained(self) -> bool:
        now = time.monotonic()
        quiet = now - max(self._last_arrival, self._end_began)
        somebody = any(self.count_publishers(topic) for topic in TYPES if topic in self._recorded)
        return (
            not self.is_active
            or quiet > (LONGEST_QUIET if somebody else QUIET_TIME)
            or self._last_publication > self._latest_publication
        )

    def diagnose(self) -> list[Health]:
        health = Health('bag', {'path': self._path})
        for topic in self.setting('topics'):
            name = self.resolve_topic_name(topic)
            health.values[f'messages of {name}'] = self.messages.get(name, 0)
        health.values['samples lost'] = self._followed.lost_samples
        health.warn_of(self._followed.lost_samples, 'samples lost')
        health.warn_of(self._followed.repeated_blocks, 'blocks repeated or late')
        health.warn_of(self._followed.foreign_blocks, 'blocks from a second source')
        if self._bag is None:
            health.add(Level.ERROR, 'the bag is closed; nothing more is recorded')
        elif self._wanted:
            health.add(Level.WARN, f'nobody publishes {", ".join(self._wanted)} yet')
        parts = [health]
        for topic, message_type in TYPES.items():
            if topic in self.setting('topics') and topic in ('samples', 'stand_description'):
                part = Health(topic)
                name = self.resolve_topic_name(topic)
                check_topic(self, name, _type_name(message_type), part)
                parts.append(part)
        return parts

    def _subscribe_to_known(self) -> None:
        """Subscribe to all wanted topics whose type is known by now."""
        present = dict(self.get_topic_names_and_types())
        for topic in list(self._wanted):
            name = self.resolve_topic_name(topic)
            message_type = TYPES.get(topic) or _imported(present.get(name, []))
            if message_type is None:
                continue
            self._wanted.remove(topic)
            latched = topic in LATCHED
            subscription = self.subscribe(
                message_type,
                topic,
                self._writer_of(topic, name, _type_name(message_type), latched),
                qos_profile=qos.recording(latched),
                raw=True,
            )
            if topic != '/diagnostics':
                self._recorded[topic] = subscription

    def _is_connected(self) -> bool:
        # With all that publish what is recorded: nothing of it is missed.
        return all(
            subscription.get_publisher_count() >= self.count_publishers(subscription.topic_name)
            for subscription in self._recorded.values()
        )

    def _writer_of(
        self, topic: str, name: str, type_name: str, latched: bool
    ) -> Callable[[bytes, dict[str, int]], None]:
        def write(data: bytes, info: dict[str, int]) -> None:
            if topic == 'stand_description':
                self._expect(data)
            if not self.is_active and not latched:
                return
            if topic != '/diagnostics':
                self._last_arrival = time.monotonic()
                self._last_publication = info['source_timestamp']
            if self._bag is None:
                return
            now = int(self.get_clock().now().nanoseconds)
            try:
                self._bag.write_raw(name, type_name, data, now, latched=latched)
            except DataError:
                self.clean_up()
                raise
            self.messages[name] = self.messages.get(name, 0) + 1
            if topic == 'samples':
                self._follow(data)

        return write

    def _expect(self, data: bytes) -> None:
        stream_id = deserialize_message(data, StandDescription).stream_id
        self._streams.add(stream_id)
        if self._progress is not None:
            self._progress.expect(stream_id)

    def _follow(self, data: bytes) -> None:
        stream_id, first_index, next_index, last = block_position(data)
        self._followed.accept(stream_id, first_index, next_index, last)
        if self._progress is not None:
            self._progress.advance(stream_id, next_index, last)

    def _tend(self) -> None:
        if self._wanted:
            self._subscribe_to_known()
        if self._bag is not None:
            self._bag.flush()

    def _beat(self) -> None:
        if self._progress is not None:
            self._progress.announce()


def _type_name(message_type: type) -> str:
    return f'{message_type.__module__.split(".")[0]}/msg/{message_type.__name__}'


def _imported(names: Sequence[str]) -> type | None:
    """Class of the message type of a topic; None: not on the topic yet."""
    if not names:
        return None
    package, _, name = names[0].partition('/msg/')
    try:
        return getattr(import_module(f'{package}.msg'), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError):
        raise DataError(
            f'message type {names[0]} is not installed here, so its topic cannot be recorded; '
            'take the topic out of parameter topics'
        ) from None


def main(args: Sequence[str] | None = None) -> int:
    """
    Run the node.

    Parameters
    ----------
    args : sequence of str or None
        None: those of the process.

    Returns
    -------
    int
        Exit code.

    """
    return run(lambda: [Recorder()], args)


if __name__ == '__main__':
    sys.exit(main())
