# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Following one stream of blocks: what is lost, repeated, late or somebody else's."""

from dataclasses import dataclass
from enum import Enum

# Blocks in a row that another stream must deliver alone before it takes over.
TAKEOVER_BLOCKS = 20


class Arrival(Enum):
    """How a block relates to what came before."""

    FIRST = 'first block of a stream'
    IN_ORDER = 'in order'
    AFTER_GAP = 'blocks were lost before this one'
    REPEATED = 'repeated or late'
    FOREIGN = 'from a second source'

    @property
    def usable(self) -> bool:
        """Whether the block's samples are new data of the stream followed."""
        return self in (Arrival.FIRST, Arrival.IN_ORDER, Arrival.AFTER_GAP)


@dataclass
class StreamFollower:
    """
    Decide for every arriving block whether it continues the stream.

    The decision depends on the blocks alone, never on the time of arrival, so that a bag gives
    the same result as the live stream. A source that restarts takes a new stream id; it is
    followed once the old one has ended or has been silent for `TAKEOVER_BLOCKS` of its blocks.

    Parameters
    ----------
    replays : bool
        A stream that has ended may come once more, from its beginning; else it is a repetition.

    """

    replays: bool = False
    stream_id: int | None = None
    next_index: int = 0
    ended: bool = False
    lost_samples: int = 0
    repeated_blocks: int = 0
    foreign_blocks: int = 0
    blocks_after_end: int = 0
    _foreign_id: int | None = None
    _foreign_run: int = 0
    _began_at: int | None = None

    def accept(self, stream_id: int, first_index: int, next_index: int, last: bool) -> Arrival:
        """
        Judge one block and remember it.

        Parameters
        ----------
        stream_id : int
        first_index, next_index : int
            First sample of the block and first sample after it.
        last : bool
            The source says that nothing follows.

        Returns
        -------
        Arrival

        """
        if stream_id != self.stream_id:
            if not self._take_over(stream_id):
                self.foreign_blocks += 1
                return Arrival.FOREIGN
            self.stream_id = stream_id
            self._began_at = first_index
            self.next_index, self.ended = next_index, last
            return Arrival.FIRST
        self._foreign_run = 0
        if self.replays and self.ended and first_index == self._began_at:
            self.next_index, self.ended = next_index, last
            return Arrival.FIRST
        if self.ended or first_index < self.next_index:
            self.repeated_blocks += 1
            # Of these, those that are new but come after the end.
            self.blocks_after_end += int(first_index >= self.next_index)
            return Arrival.REPEATED
        lost = first_index - self.next_index
        self.lost_samples += lost
        self.next_index, self.ended = next_index, last
        return Arrival.AFTER_GAP if lost else Arrival.IN_ORDER

    def resume(self, stream_id: int, next_index: int) -> None:
        """
        Go on where another follower has stopped; any other stream may take over at once.

        Parameters
        ----------
        stream_id : int
        next_index : int
            First sample of the stream not seen yet.

        """
        self.stream_id, self.next_index, self.ended = stream_id, next_index, False
        self._foreign_run = TAKEOVER_BLOCKS
        self._foreign_id = None

    def _take_over(self, stream_id: int) -> bool:
        if self.stream_id is None or self.ended:
            return True
        if stream_id != self._foreign_id and self._foreign_id is not None:
            self._foreign_run = 0
        self._foreign_run += 1
        self._foreign_id = stream_id
        if self._foreign_run < TAKEOVER_BLOCKS:
            return False
        self._foreign_run = 0
        return True
