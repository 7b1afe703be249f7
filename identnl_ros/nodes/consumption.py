# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A consumer tells how far it is, so that a source that could go faster waits for it."""

from collections.abc import Callable

from identnl_msgs.msg import Consumed
from identnl_ros.nodes import qos
from rclpy.node import Node

REPORT_EVERY = 20  # blocks; a source stays 200 ahead
STREAMS_KEPT = 4
BEAT = 0.1  # [s] between attempts to tell of a stream


class Progress:
    """
    Reports of one consumer on the topic `consumed`, while it is active.

    Parameters
    ----------
    node : Node
    is_ready : callable
        Whether nothing would be lost if the source began now.

    """

    def __init__(self, node: Node, is_ready: Callable[[], bool] = lambda: True) -> None:
        self._node = node
        self._is_ready = is_ready
        self._next: dict[int, int] = {}
        self._told: set[int] = set()
        self._blocks = 0
        self._publisher = node.create_publisher(Consumed, 'consumed', qos.consumed())

    def expect(self, stream_id: int) -> None:
        """
        Learn of a stream, before its first block.

        Parameters
        ----------
        stream_id : int

        """
        self._next.setdefault(stream_id, 0)
        while len(self._next) > STREAMS_KEPT:
            self._told.discard(next(iter(self._next)))
            del self._next[next(iter(self._next))]
        self.announce()

    def advance(self, stream_id: int, next_index: int, last: bool) -> None:
        """
        Note that a block has been worked through, used or not.

        Parameters
        ----------
        stream_id : int
        next_index : int
        last : bool
            Tell it now.

        """
        if stream_id not in self._next:
            return
        self._next[stream_id] = max(self._next[stream_id], next_index)
        self._blocks += 1
        if last or self._blocks % REPORT_EVERY == 0:
            self._tell(stream_id)

    def announce(self) -> None:
        """Tell of streams that have not been told of, as soon as all is ready."""
        for stream_id in self._next.keys() - self._told:
            if self._is_ready():
                self._tell(stream_id)

    def close(self) -> None:
        """Be waited for no more."""
        self._node.destroy_publisher(self._publisher)

    def _tell(self, stream_id: int) -> None:
        self._told.add(stream_id)
        self._publisher.publish(
            Consumed(
                consumer=self._node.get_fully_qualified_name(),
                stream_id=stream_id,
                next_sample_index=self._next[stream_id],
            )
        )
