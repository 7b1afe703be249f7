# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Reads one device in a thread of its own, and opens it again whenever it is lost."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import threading
import time

from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.core.good_news import GoodNews
from identnl_ros.core.measurement.blocks import NANOSECONDS, stamp_after
from identnl_ros.sources.device import Device, DeviceBlock, DeviceChannel, DeviceLost
from identnl_ros.sources.device_state import DeviceState
from identnl_ros.sources.inbox import Inbox
import numpy as np

POLL = 0.1  # [s]
LONGEST_OPENING = 10.0  # [s]
LONGEST_QUEUE = 2.0  # [s]
LONGEST_JUMP = 60.0  # [s] beyond the time since the last samples
LARGEST_INDEX = 2**62
LARGEST_STAMP = (2**31 - 1) * NANOSECONDS
# A clock of stamps that disagrees more than this with the computer's steady one was set [s].
LARGEST_STEP = 1.0


@dataclass(frozen=True)
class Patience:
    """
    How long to wait for a device.

    Parameters
    ----------
    silence : float
        A device from which nothing comes for longer is lost [s].
    pause : float
        Before it is opened again [s]; doubled each time that this is in vain.
    longest_pause : float
        [s].

    """

    silence: float = 3.0
    pause: float = 0.5
    longest_pause: float = 5.0


class DeviceReader:
    """
    Puts the samples of a device into an inbox, until stopped.

    The running index begins at 0 with the first sample. Where the device begins to count anew,
    because it was lost or by itself, the index jumps as far as time has passed meanwhile.

    Parameters
    ----------
    device : Device
        Used by the thread of this reader alone.
    inbox : Inbox
    number : int
        Of the device in the inbox.
    patience : Patience
    tell : callable
        Takes sentences for the user.

    """

    def __init__(
        self,
        device: Device,
        inbox: Inbox,
        number: int,
        patience: Patience,
        tell: Callable[[str], None],
    ) -> None:
        self.name = device.name
        self.channels: tuple[DeviceChannel, ...] = ()
        self.sample_rate = float('nan')
        self._device = device
        self._inbox = inbox
        self._number = number
        self._patience = patience
        self._tell = tell
        self._stopped = threading.Event()
        self._answered = threading.Event()
        self._failure: IdentnlError | None = None
        self._problem = ''
        self._heard = time.monotonic()
        self._lost_since = 0.0
        self._samples = self._lost = self._reconnects = 0
        self._begun = False  # some sample has come since the device was opened
        self._offset = self._next_index = self._next_stamp = 0
        self._origin = self._newest = (0, 0)  # index and stamp [ns], of one clock
        self._thread = threading.Thread(target=self._run, name=f'{self.name}', daemon=True)
        self._thread.start()

    def wait_until_open(self) -> None:
        """
        Wait for the device to be open, from when on `channels` and `sample_rate` are known.

        Raises
        ------
        DeviceLost
            If it cannot be reached or does not answer.
        DataError
            If it can never be used as configured.

        """
        if not self._answered.wait(LONGEST_OPENING):
            raise DeviceLost(f'device {self.name}: does not answer within {LONGEST_OPENING:g} s')
        if self._failure is not None:
            raise self._failure

    def stop(self) -> None:
        """Read no more and close the device; does not wait for it."""
        self._stopped.set()

    def join(self, timeout: float) -> None:
        """
        Wait until the device is closed; one that hangs is left to itself.

        Parameters
        ----------
        timeout : float
            [s].

        """
        self._thread.join(timeout)

    @property
    def state(self) -> DeviceState:
        """How the device is."""
        silence = time.monotonic() - self._heard
        problem = self._problem
        if not problem and silence > self._patience.silence + 2 * POLL:
            problem = f'nothing for {silence:.0f} s, and its software does not return'
        (index, stamp), (origin_index, origin_stamp) = self._newest, self._origin
        duration = (stamp - origin_stamp) / NANOSECONDS
        return DeviceState(
            self.name,
            problem,
            self._samples,
            self._lost,
            self._reconnects,
            self.sample_rate,
            (index - origin_index) / duration if duration > 0 else float('nan'),
        )

    def _run(self) -> None:
        try:
            self._open_first()
            self._answered.set()
            pause = self._patience.pause
            while self._failure is None and (why := self._read_until_lost()):
                if not self._problem:
                    self._tell(f'device {self.name} is lost: {why}; trying to reach it again')
                    self._inbox.put_loss(self._number)
                    self._lost_since = time.monotonic()
                    pause = self._patience.pause
                self._problem = why
                pause = self._open_again(pause)
        finally:
            self._close()

    def _open_first(self) -> None:
        try:
            channels, rate = tuple(self._device.open()), float(self._device.sample_rate)
            names = [channel.name for channel in channels]
            if len(set(names)) < len(names) or not names:
                found = ', '.join(names) or 'none'
                raise DataError(f'expected channels with different names, found {found}')
            if not (np.isfinite(rate) and rate > 0):
                raise DataError(f'its sample rate is {rate} Hz, expected a positive number')
            self.channels, self.sample_rate = channels, rate
        except Exception as error:
            kind = type(error) if isinstance(error, IdentnlError) else DataError
            self._failure = kind(f'device {self.name}: {_words(error)}')
        self._heard = time.monotonic()

    def _open_again(self, pause: float) -> float:
        """Open the lost device, however often it takes; return the next pause."""
        while True:
            self._close()
            if self._stopped.wait(pause):
                return pause
            pause = min(2 * pause, self._patience.longest_pause)
            try:
                self._require_same(tuple(self._device.open()))
            except Exception as error:
                self._problem = _words(error)
                continue
            self._begun = False
            return pause

    def _require_same(self, channels: tuple[DeviceChannel, ...]) -> None:
        if channels != self.channels:
            raise DataError(
                f'has come back with the channels {_listed(channels)}, expected '
                f'{_listed(self.channels)} as before; set it up as before, or begin a new stream'
            )
        if self._device.sample_rate != self.sample_rate:
            raise DataError(
                f'has come back with {self._device.sample_rate:g} Hz, expected '
                f'{self.sample_rate:g} Hz as before; set it up as before, or begin a new stream'
            )

    def _read_until_lost(self) -> str:
        """Read; return why nothing comes any more, or nothing where it is stopped."""
        since = time.monotonic()
        try:
            while not self._stopped.is_set():
                block = self._device.read(POLL)
                if block is not None and len(block.samples):
                    self._take(block)
                    since = self._heard
                elif time.monotonic() - since > self._patience.silence:
                    return f'no samples for {self._patience.silence:g} s'
        # Also what a foreign device should not raise: to open it again may mend it.
        except Exception as error:
            return _words(error)
        return ''

    def _take(self, block: DeviceBlock) -> None:
        samples = np.asarray(block.samples, dtype=np.float64)
        if samples.ndim != 2 or samples.shape[1] != len(self.channels):
            raise DataError(
                f'delivers samples of shape {samples.shape}, expected {len(self.channels)} columns'
            )
        count = len(samples)
        if not (0 <= block.first_index < LARGEST_INDEX and 0 <= block.stamp_ns < LARGEST_STAMP):
            raise DataError(
                f'delivers samples of index {block.first_index} and stamp {block.stamp_ns} ns, '
                'which cannot be'
            )
        now = time.monotonic()
        index = self._index_of(block, now)
        lost = index - self._next_index
        self._next_index = index + count
        self._next_stamp = stamp_after(block.stamp_ns, count, self.sample_rate)
        self._newest = (index, block.stamp_ns)
        self._samples += count
        self._lost += lost
        self._heard = now
        if self._problem:
            self._reconnects += 1
            self._problem = ''
            self._tell(
                GoodNews(
                    f'device {self.name} is back after {now - self._lost_since:.1f} s; '
                    f'{lost} samples are lost'
                )
            )
        limit = round(LONGEST_QUEUE * self.sample_rate)
        if not self._inbox.put(self._number, replace(block, first_index=index, samples=samples),
                               limit):  # fmt: skip
            self._lost += count

    def _index_of(self, block: DeviceBlock, now: float) -> int:
        """Continue the running index of the stream."""
        index = int(block.first_index) + self._offset
        jump = index - self._next_index
        if self._begun and 0 <= jump <= (now - self._heard + LONGEST_JUMP) * self.sample_rate:
            return index
        passed = self._passed(block, now)
        if self._begun:
            self._tell(f'device {self.name}: its running index jumps by {jump}; it counts anew')
        elif self._samples and jump >= 0 and abs(jump - passed) < LARGEST_STEP * self.sample_rate:
            # Its clock has gone on while it was away.
            self._begun = True
            return index
        index = self._next_index + passed
        self._begun = True
        self._offset = index - int(block.first_index)
        self._origin = (index, block.stamp_ns)
        return index

    def _passed(self, block: DeviceBlock, now: float) -> int:
        """Count the samples between the last ones and these by the host's time."""
        if not self._samples:
            return 0
        elapsed = (block.stamp_ns - self._next_stamp) / NANOSECONDS
        steady = now - self._heard - len(block.samples) / self.sample_rate
        if abs(elapsed - steady) > LARGEST_STEP:
            elapsed = steady
        return max(1, round(elapsed * self.sample_rate))

    def _close(self) -> None:
        try:
            self._device.close()
        except Exception as error:  # must not happen, and must not end the thread
            self._problem = self._problem or _words(error)


def _listed(channels: tuple[DeviceChannel, ...]) -> str:
    return ', '.join(f'{one.name} ({one.unit})' if one.unit else one.name for one in channels)


def _words(error: Exception) -> str:
    if isinstance(error, IdentnlError):
        return ' '.join(str(error).split()) or 'it says no more'
    return f'unexpected error of its software, {type(error).__name__}: {error}'
