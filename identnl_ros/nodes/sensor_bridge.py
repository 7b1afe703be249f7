# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The node that publishes the samples of a stand: simulated, recorded or from devices."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import sys
import time
from typing import Any, cast, ClassVar

from identnl_msgs.msg import (
    Consumed,
    SampleBlock as SampleBlockMessage,
    StandDescription as StandDescriptionMessage,
)
from identnl_ros.core.good_news import GoodNews
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.nodes import qos
from identnl_ros.nodes.block_stream import BlockStream
from identnl_ros.nodes.conversions import block_to_message
from identnl_ros.nodes.description_conversion import description_to_message
from identnl_ros.nodes.device_health import device_health
from identnl_ros.nodes.diagnosis import check_topic, full_names, Health, Level
from identnl_ros.nodes.managed_node import ManagedNode
from identnl_ros.nodes.running import run
from identnl_ros.nodes.source_choice import make_source, SETTINGS, settings_of_sources
from identnl_ros.sources.setting import Setting
from identnl_ros.sources.source import LiveSource, Source, Timing
from rclpy.duration import Duration

CHECK_INTERVAL = 0.25  # [s]
CONFIRMATION_TIME = 0.5  # [s]


@dataclass(frozen=True)
class Published:
    """
    What a bridge has published of a stream.

    Parameters
    ----------
    blocks : int
    next_index : int
        Index of the first sample that was not published.
    complete : bool
        The source came to its own end.

    """

    blocks: int = 0
    next_index: int = 0
    complete: bool = False


class SensorBridge(ManagedNode):
    """
    Publishes `samples` and, latched, `stand_description`.

    Blocks are made ahead in a thread and given out by another, so that neither the making nor
    the callbacks of this node delay them. Deactivating makes the stand's time stand still;
    activating goes on from there; cleaning up ends the stream. Devices cannot stand still: they
    are open from configuration on, and what they deliver while the node is inactive is lost.

    """

    settings: ClassVar[tuple[Setting, ...]] = (
        *SETTINGS,
        Setting(
            'speed',
            1.0,
            'Times real time [-]; 0: as fast as the consumers keep up. Devices set their own '
            'pace.',
            0.0,
            1e6,
        ),
        Setting(
            'wait_for_consumers',
            0,
            'Number of consumers that must have reported before the first block.',
            0,
            1000,
        ),
        Setting(
            'wait_timeout',
            10.0,
            'Longest time to wait for consumers [s]; then it begins without them.',
            0.0,
            1e6,
        ),
        Setting(
            'exit_at_end',
            False,
            'End the process after the last block. false: stay, so that consumers that join later '
            'can still read the description.',
            live=True,
        ),
    )

    def __init__(self, **options: Any) -> None:
        self._source: Source | None = None
        self._stream: BlockStream | None = None
        self._stamp_offset: int | None = None
        self._is_opened = False
        self.published = Published()
        super().__init__('sensor_bridge', **options)

    @classmethod
    def all_settings(cls) -> tuple[Setting, ...]:
        return (*cls.settings, *settings_of_sources())

    def configure(self) -> None:
        self._source = source = make_source(self.setting, self._log)
        self.stand = source.description.stand
        self._stamp_offset = None if source.timing is Timing.SIMULATED else 0
        self._is_opened = False
        self._samples = self.publish_on(SampleBlockMessage, 'samples', qos.blocks())
        self._descriptions = self.publish_on(
            StandDescriptionMessage, 'stand_description', qos.stand_description()
        )
        self._stream = BlockStream(
            source,
            self._publish_block,
            self.setting('speed'),
            self.setting('wait_for_consumers'),
            self.setting('wait_timeout'),
            self.get_logger().warning,
        )
        self.subscribe(Consumed, 'consumed', self._on_consumed, qos_profile=qos.progress())
        self.every(CHECK_INTERVAL, self._check)

    def _log(self, sentence: str) -> None:
        if isinstance(sentence, GoodNews):
            self.get_logger().info(sentence)
        else:
            self.get_logger().warning(sentence)

    def activate(self) -> None:
        assert self._source is not None, 'active without being configured'
        description = self._source.description
        if not self._is_opened:
            is_simulated = self._source.timing is Timing.SIMULATED
            opened = self._now() if is_simulated else description.stamp_ns
            self._descriptions.publish(
                description_to_message(replace(description, stamp_ns=opened))
            )
            self._is_opened = True
        if self._stream is not None:
            self._stream.resume()
        self.get_logger().info(
            f'stand {description.stand}: {len(description.layout.sensors)} channels at '
            f'{description.sample_rate:g} Hz, stream {description.stream_id}'
        )

    def deactivate(self) -> None:
        if self._stream is not None:
            self._stream.pause()

    def clean_up(self) -> None:
        if self._stream is not None:
            self._stream.stop()
            self.published = Published(
                self._stream.blocks, self._stream.next_index, self._stream.is_complete
            )
            self._stream = None
        elif self._source is not None and self._source.timing is Timing.LIVE:
            cast(LiveSource, self._source).end()  # there was no stream that does
        self._source = None

    def begin_to_end(self) -> None:
        if self._stream is not None:
            self._stream.end()

    def is_drained(self) -> bool:
        return self._stream is None or not self.is_active or self._stream.is_over

    def finish(self) -> None:
        if self.is_active:
            self._samples.wait_for_all_acked(Duration(seconds=CONFIRMATION_TIME))

    def diagnose(self) -> list[Health]:
        if (stream := self._stream) is None:
            return []
        health = Health(
            'stream',
            {
                'stream': stream.credit.stream_id,
                'source': self.setting('source'),
                'blocks published': stream.blocks,
                'next sample index': stream.next_index,
                'blocks made ahead': stream.blocks_ready,
                'blocks late': stream.late_blocks,
                'samples not published': stream.dropped_samples,
                'ended': stream.has_ended,
                **{
                    f'progress of {name} [samples]': index
                    for name, index in stream.credit.progress.items()
                },
            },
        )
        if stream.failure:
            health.add(Level.ERROR, stream.failure.splitlines()[0])
        health.warn_of(stream.late_blocks, 'blocks were late: the computer is too slow')
        topic = Health('samples')
        check_topic(self, self._samples.topic_name, 'identnl_msgs/msg/SampleBlock', topic)
        return [health, topic, *map(device_health, stream.devices)]

    def _publish_block(self, block: SampleBlock) -> None:
        if self._stamp_offset is None:
            duration = block.samples.shape[0] / block.sample_rate
            self._stamp_offset = self._now() - round(duration * 1e9) - block.stamp_ns
        stamp = block.stamp_ns + self._stamp_offset
        self._samples.publish(block_to_message(replace(block, stamp_ns=stamp)))

    def _on_consumed(self, message: Consumed) -> None:
        if self._stream is not None:
            self._stream.report(message.consumer, message.stream_id, message.next_sample_index)

    def _check(self) -> None:
        if self._stream is None:
            return
        topic = self.resolve_topic_name('consumed')
        self._stream.drop_vanished(full_names(self.get_publishers_info_by_topic(topic)))
        if self._stream.is_over and self.setting('exit_at_end'):
            self.wants_to_exit = True

    def _now(self) -> int:
        # The acquisition clock: a simulated ROS time may stand still or begin at zero.
        return time.time_ns()


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
    return run(lambda: [SensorBridge()], args)


if __name__ == '__main__':
    sys.exit(main())
