# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Blocks of a source given out at the right time, in a thread of their own."""

from collections.abc import Callable
from dataclasses import replace
import threading
import time
import traceback
from typing import cast

from identnl_ros.core.errors import IdentnlError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.nodes.credit import Credit
from identnl_ros.nodes.prefetch import Prefetch
from identnl_ros.sources.device_state import DeviceState
from identnl_ros.sources.source import LiveSource, Source, Timing

WINDOW = 200  # blocks ahead of the slowest consumer
SETTLING_TIME = 0.2  # [s] for connections that one side takes for made
LATE = 0.5  # [s]


class BlockStream:
    """
    Publish the blocks of a source, paced by their stamps, by their consumers or by devices.

    A live source is never held up: what comes while the stream is paused is dropped.

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
        self._is_awaiting = True
        self._waiting_since: float | None = None
        self.credit = Credit(source.description.stream_id, 0)
        self.failure = ''
        self.blocks = 0
        self.next_index = 0
        self.late_blocks = 0
        self.dropped_samples = 0
        self.has_ended = False
        self.is_complete = False
        self._live: LiveSource | None = None
        self._blocks: Prefetch | None = None
        if source.timing is Timing.LIVE:
            self._live = cast(LiveSource, source)
        else:
            self._blocks = Prefetch(source.blocks())
        self._thread = threading.Thread(target=self._run, name='publishing', daemon=True)
        self._thread.start()

    @property
    def blocks_ready(self) -> int:
        """Number of blocks made ahead."""
        return self._blocks.ready if self._blocks else 0

    @property
    def devices(self) -> tuple[DeviceState, ...]:
        """How the devices are; none where the source is not live."""
        return self._live.devices if self._live else ()

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
        if self._live:
            self._live.end()

    def stop(self) -> None:
        """End at once and wait for the threads."""
        self.pause()
        self.end()
        if self._blocks:
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
            if self._blocks:
                self._wait_for_consumers()
                self._pace(self._blocks)
            elif self._live:
                threading.Thread(target=self._wait_for_consumers, daemon=True).start()
                for block in self._live.blocks():
                    self._give_out(block)
            self.has_ended = True
        except IdentnlError as error:
            self._fail(str(error))
        except Exception:
            self._fail(f'unexpected error, please report:\n{traceback.format_exc()}')
        finally:
            if self._blocks:
                self._blocks.stop()
            if self._live:
                self._live.end()

    def _fail(self, sentence: str) -> None:
        self.failure = sentence
        self._tell(sentence)

    def _pace(self, blocks: Prefetch) -> None:
        clock = time.monotonic()
        first: SampleBlock | None = None
        for block in blocks:
            if first is None:
                first = block
                self.credit.window = WINDOW * max(1, block.samples.shape[0])
            if self._speed > 0:
                # A block is complete when its last sample has been taken.
                after = (block.next_index - first.first_index) / block.sample_rate
                clock += self._wait_until(clock + after / self._speed)
            else:
                self._wait_for_credit(block)
            is_last = self._is_stopping
            self._give_out(replace(block, last=True) if is_last else block)
            if is_last:
                return
            self.is_complete = block.last

    def _wait_for_consumers(self) -> None:
        try:
            self._await_consumers()
        finally:
            self._is_awaiting = False

    def _await_consumers(self) -> None:
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
            if not self._is_running or self._is_awaiting:
                self.dropped_samples += block.samples.shape[0]
                return
            self._publish(block)
            self.blocks += 1
            self.next_index = self.credit.published = block.next_index
