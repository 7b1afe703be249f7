# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The node that turns samples of sensors into motion of bodies."""

from collections.abc import Sequence
import sys
from typing import Any, ClassVar

from identnl_msgs.msg import BodyMotionBlock, SampleBlock as SampleBlockMessage
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.nodes import qos
from identnl_ros.nodes.consumer_node import ConsumerNode
from identnl_ros.nodes.conversions import block_from_message, motion_to_message
from identnl_ros.nodes.diagnosis import Health, Level
from identnl_ros.nodes.parameters import Setting
from identnl_ros.nodes.running import run
from identnl_ros.storage.stand_description import StandDescription
from rclpy.duration import Duration

CONFIRMATION_TIME = 0.5  # [s]

IGNORED = Setting(
    'ignored_sensors',
    [''],
    'Sensors that are not to be used, by name; an empty name counts for nothing.',
)


class Transform(ConsumerNode):
    """Consumes `samples`, publishes `motion`."""

    settings: ClassVar[tuple[Setting, ...]] = (*ConsumerNode.settings, IGNORED)
    topic: ClassVar[str] = 'samples'
    message_type: ClassVar[type] = SampleBlockMessage
    type_name: ClassVar[str] = 'identnl_msgs/msg/SampleBlock'

    def __init__(self, **options: Any) -> None:
        self._transform: MotionTransform | None = None
        super().__init__('transform', **options)

    @property
    def follower(self) -> StreamFollower | None:
        return None if self._transform is None else self._transform.follower

    def configure(self) -> None:
        super().configure()
        self._motion = self.publish_on(BodyMotionBlock, 'motion', qos.blocks())

    def clean_up(self) -> None:
        super().clean_up()
        self._transform = None

    def convert(self, message: SampleBlockMessage) -> SampleBlock:
        return block_from_message(message)

    def open(self, description: StandDescription) -> None:
        self._transform = None
        self._transform = MotionTransform(
            self.model(description),
            description.layout,
            description.sample_rate,
            [name for name in self.setting(IGNORED.name) if name],
        )
        if self._transform.derived:
            self.get_logger().info(
                f'stand {description.stand}: {" and ".join(self._transform.derived)} (partly) '
                'derived from the displacement'
            )

    def use(self, block: SampleBlock) -> None:
        motion = None if self._transform is None else self._transform.add(block)
        if motion is not None:
            self._motion.publish(motion_to_message(motion))

    def is_connected(self) -> bool:
        # All that want motion are connected: they get it from the first block on.
        wanted = self.count_subscribers(self._motion.topic_name)
        return bool(self._motion.get_subscription_count() >= wanted)

    def finish(self) -> None:
        if self.is_active:
            self._motion.wait_for_all_acked(Duration(seconds=CONFIRMATION_TIME))

    def diagnose(self) -> list[Health]:
        readings = Health('readings')
        if self._transform is not None:
            for name, count in self._transform.counts.samples_without_reading.items():
                readings.values[f'missing readings of {name}'] = count
                readings.warn_of(count, f'readings of {name} are missing (NaN)')
            for sentence in self._transform.degradation:
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
