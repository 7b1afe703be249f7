# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Blocks of a source given out at the right time, in a thread of their own."""

from collections.abc import Callable
from dataclasses import replace
import threading
import time

from identnl_ros.core.errors import IdentnlError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.nodes.credit import Credit
from identnl_ros.nodes.prefetch import Prefetch
from identnl_ros.sources.source import Source

WINDOW = 200  # blocks ahead of the slowest consumer
SETTLING_TIME = 0.2  # [s] for connections that one side takes for made
LATE = 0.5  # [s]


class BlockStream:
    """
    Publish the blocks of a source, paced by their stamps or by their consumers.

    Parameters
    ----------
    source : Source
    publish : callable
        Takes each block.
    speed : float
        Times real time; 0: as fast as the consumers keep up.
    consumers : int
        Wait for so many consumers to report before the first block.
    timeout : float
        Not longer than this [s].
    tell : callable
        Takes sentences for the user.

    """

    def __init__(
        self,
        source: Source,
        publish: Callable[[SampleBlock], None],
        speed: float,
        consumers: int,
        timeout: float,
        tell: Callable[[str], None],
    ) -> None:
        self._source = source
        self._publish = publish
        self._speed = speed
        self._consumers = consumers
        self._timeout = timeout
        self._tell = tell
        self._changed = threading.Condition()
        self._is_running = False
        self._is_stopping = False
        self._waiting_since: float | None = None
        self.credit = Credit(source.description.stream_id, 0)
        self.failure = ''
        self.blocks = 0
        self.next_index = 0
        self.late_blocks = 0
        self.has_ended = False
        self.is_complete = False
        self._blocks = Prefetch(source.blocks())
        self._thread = threading.Thread(target=self._run, name='publishing', daemon=True)
        self._thread.start()

    @property
    def blocks_ready(self) -> int:
        """Number of blocks made ahead."""
        return self._blocks.ready

    @property
    def is_over(self) -> bool:
        """Whether nothing more will be published."""
        return not self._thread.is_alive()

    def resume(self) -> None:
        """Go on, or begin."""
        with self._changed:
            self._is_running = True
            self._changed.notify_all()

    def pause(self) -> None:
        """Publish nothing more until resumed; the source's time stands still."""
        with self._changed:
            self._is_running = False
            self._changed.notify_all()

    def end(self) -> None:
        """Publish one more block, marked as the last; does not wait for it."""
        with self._changed:
            self._is_stopping = True
            self._changed.notify_all()

    def stop(self) -> None:
        """End at once and wait for the threads."""
        self.pause()
        self.end()
        self._blocks.stop()
        self._thread.join(timeout=2.0)

    def report(self, name: str, stream_id: int, next_index: int) -> None:
        """
        Note the progress of a consumer.

        Parameters
        ----------
        name : str
        stream_id : int
        next_index : int

        """
        with self._changed:
            self.credit.report(name, stream_id, next_index, time.monotonic())
            self._changed.notify_all()

    def drop_vanished(self, present: set[str]) -> None:
        """
        Forget consumers that are gone or stand still while they are waited for.

        Parameters
        ----------
        present : set of str
            Names of all nodes that report progress.

        """
        with self._changed:
            if self._waiting_since is None or self._speed > 0:
                return
            reasons = self.credit.drop_vanished(present, self._waiting_since, time.monotonic())
            self._changed.notify_all()
        for reason in reasons:
            self._tell(reason)

    def _run(self) -> None:
        try:
            self._wait_for_consumers()
            clock = time.monotonic()
            first: SampleBlock | None = None
            for block in self._blocks:
                if first is None:
                    first = block
                    self.credit.window = WINDOW * max(1, block.samples.shape[0])
                if self._speed > 0:
                    # A block is complete when its last sample has been taken.
                    after = (block.next_index - first.first_index) / block.sample_rate
                    clock += self._wait_until(clock + after / self._speed)
                else:
                    self._wait_for_credit(block)
                self._give_out(block)
                if self._is_stopping:
                    break
                self.is_complete = block.last
            self.has_ended = True
        except IdentnlError as error:
            self.failure = str(error)
            self._tell(self.failure)
        finally:
            self._blocks.stop()

    def _wait_for_consumers(self) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._is_running or self._is_stopping)
            if self._consumers == 0:
                return
            found = self._changed.wait_for(
                lambda: len(self.credit.progress) >= self._consumers or self._is_stopping,
                self._timeout,
            )
            if found:
                self._changed.wait_for(lambda: self._is_stopping, SETTLING_TIME)
                return
            names = ', '.join(self.credit.progress) or 'none'
        self._tell(
            f'{self._consumers} consumers are to be waited for, found after {self._timeout:g} s: '
            f'{names}; starting without the others'
        )

    def _wait_until(self, due: float) -> float:
        """Wait for a time; return how long the stream was paused meanwhile."""
        paused = 0.0
        with self._changed:
            while not self._is_stopping:
                now = time.monotonic()
                if not self._is_running:
                    self._changed.wait_for(lambda: self._is_running or self._is_stopping)
                    paused += time.monotonic() - now
                elif now >= due + paused:
                    self.late_blocks += now > due + paused + LATE
                    break
                else:
                    self._changed.wait(due + paused - now)
        return paused

    def _wait_for_credit(self, block: SampleBlock) -> None:
        def may_go() -> bool:
            return self._is_stopping or (self._is_running and self.credit.allows(block.next_index))

        with self._changed:
            if not may_go():
                self._waiting_since = time.monotonic()
                self._changed.wait_for(may_go)
                self._waiting_since = None

    def _give_out(self, block: SampleBlock) -> None:
        with self._changed:
            if not self._is_running:
                return
            self._publish(replace(block, last=True) if self._is_stopping else block)
            self.blocks += 1
            self.next_index = self.credit.published = block.next_index
