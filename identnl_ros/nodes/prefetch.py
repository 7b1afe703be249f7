# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Blocks made ahead of time in a thread, so that making them never delays publishing them."""

from collections.abc import Iterator
import queue
import threading
import traceback

from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.core.measurement.blocks import SampleBlock

AHEAD = 64  # blocks
POLL = 0.1  # [s]


class Prefetch:
    """
    Iterator over blocks that are made in a thread of their own.

    Parameters
    ----------
    blocks : iterator of SampleBlock
        Errors in it appear where the blocks are taken.

    """

    def __init__(self, blocks: Iterator[SampleBlock]) -> None:
        self._blocks = blocks
        self._queue: queue.Queue[SampleBlock | IdentnlError | None] = queue.Queue(AHEAD)
        self._is_stopped = threading.Event()
        self._thread = threading.Thread(target=self._make, name='blocks ahead', daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[SampleBlock]:
        """Yield the blocks in order; end early when stopped."""
        while not self._is_stopped.is_set():
            try:
                item = self._queue.get(timeout=POLL)
            except queue.Empty:
                continue
            if item is None:
                return
            if isinstance(item, IdentnlError):
                raise item
            yield item

    @property
    def ready(self) -> int:
        """Number of blocks made and not yet taken."""
        return self._queue.qsize()

    def stop(self) -> None:
        """Make no more blocks and wait until none is being made."""
        self._is_stopped.set()
        self._thread.join(timeout=2.0)

    def _make(self) -> None:
        try:
            for block in self._blocks:
                if not self._put(block):
                    return
            self._put(None)
        except IdentnlError as error:
            self._put(error)
        except Exception:
            self._put(DataError(f'unexpected error, please report:\n{traceback.format_exc()}'))

    def _put(self, item: SampleBlock | IdentnlError | None) -> bool:
        while not self._is_stopped.is_set():
            try:
                self._queue.put(item, timeout=POLL)
            except queue.Full:
                continue
            return True
        return False
