# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Samples on their way from the threads that read devices to the one that makes blocks."""

from collections import Counter, deque
import threading

from identnl_ros.sources.device import DeviceBlock


class Inbox:
    """A queue of blocks of several devices that never holds more than a limit of each."""

    def __init__(self) -> None:
        self._items: deque[tuple[int, DeviceBlock | None]] = deque()
        self._waiting: Counter[int] = Counter()
        self._changed = threading.Condition()

    def put(self, device: int, block: DeviceBlock, limit: int) -> bool:
        """
        Add samples.

        Parameters
        ----------
        device : int
        block : DeviceBlock
        limit : int
            Not more samples of the device may wait, unless it is a single block.

        Returns
        -------
        bool
            False: there is no room, the samples are not taken.

        """
        with self._changed:
            waiting = self._waiting[device]
            if waiting and waiting + len(block.samples) > limit:
                return False
            self._waiting[device] += len(block.samples)
            self._items.append((device, block))
            self._changed.notify()
        return True

    def put_loss(self, device: int) -> None:
        """
        Note that nothing follows for the time being.

        Parameters
        ----------
        device : int

        """
        with self._changed:
            self._items.append((device, None))
            self._changed.notify()

    def take(self, timeout: float) -> tuple[int, DeviceBlock | None] | None:
        """
        Take the oldest item.

        Parameters
        ----------
        timeout : float
            [s].

        Returns
        -------
        tuple or None
            Device, and its samples, or None where it is lost; None: nothing came in time.

        """
        with self._changed:
            if not self._changed.wait_for(lambda: bool(self._items), timeout):
                return None
            device, block = self._items.popleft()
            if block is not None:
                self._waiting[device] -= len(block.samples)
            return device, block
