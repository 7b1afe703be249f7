# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The node that turns samples of sensors into motion of bodies."""

from collections.abc import Sequence
import sys
from typing import Any, ClassVar

from identnl_msgs.msg import BodyMotionBlock, DataQuality, SampleBlock as SampleBlockMessage
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.core.quality.monitored_transform import MonitoredTransform
from identnl_ros.nodes import qos
from identnl_ros.nodes.consumer_node import ConsumerNode
from identnl_ros.nodes.conversions import block_from_message, motion_to_message
from identnl_ros.nodes.diagnosis import Health, Level
from identnl_ros.nodes.quality_conversion import quality_to_message
from identnl_ros.nodes.running import run
from identnl_ros.sources.setting import Setting
from identnl_ros.storage.stand_description import StandDescription
from rclpy.duration import Duration

CONFIRMATION_TIME = 0.5  # [s]

IGNORED = Setting(
    'ignored_sensors',
    [''],
    'Sensors that are not to be used, by name; an empty name counts for nothing.',
)


class Transform(ConsumerNode):
    """Consumes `samples`, publishes `motion` and what is wrong with the samples, `quality`."""

    settings: ClassVar[tuple[Setting, ...]] = (*ConsumerNode.settings, IGNORED)
    topic: ClassVar[str] = 'samples'
    message_type: ClassVar[type] = SampleBlockMessage
    type_name: ClassVar[str] = 'identnl_msgs/msg/SampleBlock'

    def __init__(self, **options: Any) -> None:
        self._pipeline: MonitoredTransform | None = None
        super().__init__('transform', **options)

    @property
    def follower(self) -> StreamFollower | None:
        return None if self._pipeline is None else self._pipeline.follower

    def configure(self) -> None:
        super().configure()
        self._motion = self.publish_on(BodyMotionBlock, 'motion', qos.blocks())
        self._quality = self.publish_on(DataQuality, 'quality', qos.blocks())

    def clean_up(self) -> None:
        super().clean_up()
        self._pipeline = None

    def convert(self, message: SampleBlockMessage) -> SampleBlock:
        return block_from_message(message)

    def open(self, description: StandDescription) -> None:
        self._pipeline = None
        self._pipeline = MonitoredTransform(
            self.model(description),
            description.layout,
            description.sample_rate,
            [name for name in self.setting(IGNORED.name) if name],
        )
        if derived := self._pipeline.transform.derived:
            self.get_logger().info(
                f'stand {description.stand}: {" and ".join(derived)} (partly) '
                'derived from the displacement'
            )

    def use(self, block: SampleBlock) -> None:
        if self._pipeline is None:
            return
        for motion in self._pipeline.add(block):
            self._motion.publish(motion_to_message(motion))
        for cleaned, quality in self._pipeline.quality:
            for finding in quality.findings:
                self.get_logger().warning(finding.sentence)
            self._quality.publish(quality_to_message(quality, cleaned))

    def is_connected(self) -> bool:
        # All that want motion or quality are connected: they get it from the first block on.
        return all(
            publisher.get_subscription_count() >= self.count_subscribers(publisher.topic_name)
            for publisher in (self._motion, self._quality)
        )

    def finish(self) -> None:
        if self.is_active:
            for publisher in (self._motion, self._quality):
                publisher.wait_for_all_acked(Duration(seconds=CONFIRMATION_TIME))

    def diagnose(self) -> list[Health]:
        readings = Health('readings')
        if self._pipeline is not None:
            summary = self._pipeline.monitor.summary()
            for channel in summary.channels:
                if channel.excluded:
                    readings.values[f'readings of {channel.name} left out'] = channel.excluded
                for cause, count in channel.causes.items():
                    readings.values[f'{cause.in_words} readings of {channel.name}'] = count
            for finding in summary.findings:
                readings.add(Level.WARN, finding.sentence)
            for sentence in self._pipeline.transform.degradation:
                readings.add(Level.WARN, sentence)
        return [*super().diagnose(), readings]

    @staticmethod
    def _length(message: SampleBlockMessage) -> int:
        return len(message.samples) // max(1, int(message.channel_count))


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
    return run(lambda: [Transform()], args)


if __name__ == '__main__':
    sys.exit(main())
