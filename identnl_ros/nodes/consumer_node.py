# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the consumers of blocks have in common: streams, damage, loss, progress."""

from abc import abstractmethod
import copy
import time
from typing import Any, ClassVar

from identnl_msgs.msg import StandDescription as StandDescriptionMessage
from identnl_ros.core.errors import DataError, IdentnlError, MachineError
from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.model import Model
from identnl_ros.nodes import qos
from identnl_ros.nodes.consumption import BEAT, Progress
from identnl_ros.nodes.diagnosis import check_topic, Health, Level
from identnl_ros.nodes.managed_node import ManagedNode
from identnl_ros.sources.setting import Setting
from identnl_ros.storage.machine_file import load_machine, read_machine
from identnl_ros.storage.message_reading import description_from_message
from identnl_ros.storage.stand_description import StandDescription
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.serialization import serialize_message

QUIET_TIME = 0.2  # [s] nothing for so long from nobody: all has arrived
LONGEST_QUIET = 2.0  # [s] nothing for so long, though somebody is there
GRACE_NS = 2 * NANOSECONDS  # what a source publishes later is not waited for
DESCRIPTIONS_KEPT = 8

MACHINE_FILE = Setting(
    'machine_file',
    '',
    'Machine file (YAML); empty: the one that comes with the description of the stand.',
)


class ConsumerNode(ManagedNode):
    """
    A node that works through the blocks of one stream, and survives all others.

    A node says what it consumes and overrides `convert`, `open`, `use` and `follower`.

    """

    settings: ClassVar[tuple[Setting, ...]] = (MACHINE_FILE,)
    topic: ClassVar[str]
    message_type: ClassVar[type]
    type_name: ClassVar[str]

    def __init__(self, name: str, **options: Any) -> None:
        self._descriptions: dict[int, StandDescription] = {}
        self._texts: dict[int, bytes] = {}
        self._stream_id: int | None = None
        self._progress: Progress | None = None
        self._past = (0, 0, 0)
        self._blocks = self._damaged = self._undescribed = 0
        self._damage = ''
        self._sources = self._incompatible = 0
        self._last_arrival = 0.0
        self._last_publication = self._end_began = 0
        super().__init__(name, **options)

    @property
    @abstractmethod
    def follower(self) -> StreamFollower | None:
        """Judge of the blocks; None while no stream can be used."""

    @abstractmethod
    def convert(self, message: Any) -> Any:
        """Make a block of a message."""

    @abstractmethod
    def open(self, description: StandDescription) -> None:
        """Prepare for the blocks of a stream."""

    @abstractmethod
    def use(self, block: Any) -> None:
        """Work through a block."""

    def is_connected(self) -> bool:
        """Tell whether a block would reach this node and all that follow it."""
        return True

    def configure(self) -> None:
        self._forget_streams()
        if path := self.setting('machine_file'):
            load_machine(path)
        self._input = self.subscribe(
            self.message_type,
            self.topic,
            self._on_block,
            qos_profile=qos.blocks(),
            event_callbacks=SubscriptionEventCallbacks(
                matched=self._on_matched, incompatible_qos=self._on_incompatible
            ),
        )
        self.subscribe(
            StandDescriptionMessage,
            'stand_description',
            self._on_description,
            qos_profile=qos.stand_description(),
        )
        self.every(BEAT, self._beat)

    def activate(self) -> None:
        self._progress = Progress(self, self.is_connected)
        for stream_id in self._descriptions:
            self._progress.expect(stream_id)

    def deactivate(self) -> None:
        if self._progress is not None:
            self._progress.close()
            self._progress = None

    def clean_up(self) -> None:
        self._forget_streams()

    def begin_to_end(self) -> None:
        self._end_began = time.time_ns()

    def is_drained(self) -> bool:
        now = time.monotonic()
        return (
            not self.is_active
            or self.follower is None
            or self.follower.ended
            or now - self._last_arrival > (LONGEST_QUIET if self._sources else QUIET_TIME)
            or self._last_publication - self._end_began > GRACE_NS
        )

    def model(self, description: StandDescription) -> Model:
        """
        Assemble the machine of a stand.

        Parameters
        ----------
        description : StandDescription

        Returns
        -------
        Model

        Raises
        ------
        MachineError
            If there is none or it is unsound.

        """
        if path := self.setting('machine_file'):
            return assemble(load_machine(path).machine)
        if not description.machine_text:
            raise MachineError(
                f'the description of stand {description.stand} has no machine file; '
                'set parameter machine_file'
            )
        where = f'machine file of stand {description.stand}'
        return assemble(read_machine(description.machine_text, where))

    def diagnose(self) -> list[Health]:
        counts = self._counts_so_far()
        health = Health(
            'stream',
            {
                'stream': self._stream_id if self._stream_id is not None else 'none',
                **{words: count for words, count in counts.items()},
                'ended': self.follower is not None and self.follower.ended,
            },
        )
        for words, count in counts.items():
            if words != 'blocks received':
                health.warn_of(count, words)
        if self._damage:
            health.add(Level.WARN, f'last damaged block: {self._damage}')
        if self._stream_id is None and not self.failure:
            health.add(Level.WARN, 'no description of the stand has come yet')
        topic = Health(self.topic)
        check_topic(self, self._input.topic_name, self.type_name, topic)
        if self._incompatible:
            topic.add(
                Level.ERROR,
                f'{self._incompatible} publisher(s) of {self._input.topic_name} offer a quality '
                'of service that does not suit: publish reliably',
            )
        return [health, topic]

    def _counts_so_far(self) -> dict[str, int]:
        follower = self.follower or StreamFollower()
        return {
            'blocks received': self._blocks,
            'samples lost': self._past[0] + follower.lost_samples,
            'blocks repeated or late': self._past[1] + follower.repeated_blocks,
            'blocks from a second source': self._past[2] + follower.foreign_blocks,
            'blocks damaged': self._damaged,
            'blocks without description': self._undescribed,
        }

    def _on_description(self, message: StandDescriptionMessage) -> None:
        text = bytes(serialize_message(message))
        if self._texts.get(message.stream_id) == text:
            return
        description = description_from_message(message)
        self._texts[description.stream_id] = text
        self._descriptions[description.stream_id] = description
        while len(self._descriptions) > DESCRIPTIONS_KEPT:
            oldest = next(iter(self._descriptions))
            del self._descriptions[oldest], self._texts[oldest]
        if self.follower is None or description.stream_id == self._stream_id:
            self._open(description)
        if self._progress is not None:
            self._progress.expect(description.stream_id)

    def _open(self, description: StandDescription) -> None:
        before = self.follower
        self._stream_id = description.stream_id
        self.stand = description.stand
        try:
            self.open(description)
        except IdentnlError as error:
            self.tell_failure(str(error))
        else:
            self.failure = ''
        if before is not None and self.follower is not before:
            lost, repeated, foreign = self._past
            self._past = (
                lost + before.lost_samples,
                repeated + before.repeated_blocks,
                foreign + before.foreign_blocks,
            )

    def _on_block(self, message: Any, info: dict[str, int]) -> None:
        self._last_arrival = time.monotonic()
        self._last_publication = info['source_timestamp']
        if not self.is_active:
            return
        self._blocks += 1
        try:
            block = self.convert(message)
            is_followed = block.stream_id == self._stream_id or self._takes_over(block)
            if is_followed and self.follower is not None:
                self.use(block)
        except DataError as error:
            self._damaged += 1
            if not self._damage:
                self.get_logger().warning(f'{error} (later ones are counted in /diagnostics)')
            self._damage = str(error)
        if self._progress is not None:
            self._progress.advance(
                message.stream_id,
                message.first_sample_index + self._length(message),
                message.last_block,
            )

    def _takes_over(self, block: Any) -> bool:
        """Whether to follow the block's stream from now on."""
        if block.stream_id not in self._descriptions:
            self._undescribed += 1
            return False
        arrival = (block.stream_id, block.first_index, block.next_index, block.last)
        if self.follower is not None and not copy.copy(self.follower).accept(*arrival).usable:
            self.follower.accept(*arrival)
            return False
        self._open(self._descriptions[block.stream_id])
        return True

    @staticmethod
    @abstractmethod
    def _length(message: Any) -> int:
        """Count the samples in a message, which may be damaged."""

    def _beat(self) -> None:
        if self._progress is not None:
            self._progress.announce()

    def _on_matched(self, event: Any) -> None:
        self._sources = event.current_count

    def _on_incompatible(self, event: Any) -> None:
        self._incompatible = event.total_count

    def _forget_streams(self) -> None:
        self._descriptions.clear()
        self._texts.clear()
        self._stream_id = None
        self._past = (0, 0, 0)
        self._blocks = self._damaged = self._undescribed = 0
        self._damage = ''
        self._sources = self._incompatible = 0
