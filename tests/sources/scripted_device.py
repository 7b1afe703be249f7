# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""A device that does what a test tells it to."""

from collections.abc import Callable
import queue
import threading
import time

from identnl_ros.sources.device import DeviceBlock, DeviceChannel
import numpy as np

RATE = 1000.0
# A whole number of samples since 1970, so that stamps can be compared exactly.
BEGIN = 1_700_000_000 * 10**9


class ScriptedDevice:
    """
    Gives what is put into it; an error is raised.

    Parameters
    ----------
    channels : dict of str
        Units by name.
    name : str
    openings : list
        What each opening does: None, an error that is raised, or something to call. After the
        last one: None.

    """

    def __init__(
        self,
        channels: dict[str, str],
        name: str = 'box',
        openings: list[Exception | Callable[[], None] | None] | None = None,
        sample_rate: float = RATE,
    ) -> None:
        self.name = name
        self.sample_rate = sample_rate
        self.channels = tuple(DeviceChannel(name, unit) for name, unit in channels.items())
        self.items: queue.Queue[DeviceBlock | Exception] = queue.Queue()
        self.openings = openings or []
        self.opened = self.closed = 0
        self.calls: list[str] = []
        self.reopened = threading.Event()

    def open(self) -> tuple[DeviceChannel, ...]:
        self.opened += 1
        self.calls.append('open')
        match self.openings.pop(0) if self.openings else None:
            case None:
                pass
            case Exception() as error:
                raise error
            case call:
                call()
        if self.opened > 1:
            self.reopened.set()
        return self.channels

    def read(self, timeout: float) -> DeviceBlock | None:
        try:
            item = self.items.get(timeout=timeout)
        except queue.Empty:
            return None
        if isinstance(item, Exception):
            raise item
        return item

    def close(self) -> None:
        self.closed += 1
        self.calls.append('close')

    def give(self, first_index: int, samples: np.ndarray, stamp_ns: int | None = None) -> None:
        """Deliver samples, by default with the stamps of an ideal clock since `BEGIN`."""
        if stamp_ns is None:
            stamp_ns = BEGIN + round(first_index / self.sample_rate * 1e9)
        self.items.put(DeviceBlock(first_index, stamp_ns, np.asarray(samples, dtype=float)))

    def give_now(self, first_index: int, samples: np.ndarray) -> None:
        """Deliver samples the last of which is taken now."""
        duration = len(samples) / self.sample_rate
        self.give(first_index, samples, time.time_ns() - round(duration * 1e9))
