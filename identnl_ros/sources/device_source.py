# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Data acquisition devices as a source of samples that goes on until it is told to end."""

from collections.abc import Callable, Iterator, Sequence
import secrets
import threading
import time

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import SampleBlock, stamp_after
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
from identnl_ros.sources.device import Device
from identnl_ros.sources.device_channels import sensors_of_devices
from identnl_ros.sources.device_merging import Merging, OneDevice, Piece, SeveralDevices
from identnl_ros.sources.device_reader import DeviceReader, Patience, POLL
from identnl_ros.sources.device_state import DeviceState
from identnl_ros.sources.inbox import Inbox
from identnl_ros.sources.source import Timing
from identnl_ros.storage.stand_description import StandDescription
import numpy as np

LONGEST_CLOSING = 0.5  # [s] of all devices together
# Rates that differ by less are the same one, by different crystals.
ALIKE = 0.999


class DeviceSource:
    """
    The sensors of a layout, read from devices.

    The devices are open from the beginning; `end` closes them. A device that is lost is opened
    again and again, and the stream goes on with a jump of the running index.

    Parameters
    ----------
    devices : sequence of Device
        Those that no sensor is read from are closed again.
    layout : Layout
        Its key ``column`` names the channels: ``channel``, or ``device/channel`` where several
        devices have one of the name.
    sample_rate : float or None
        Of the common clock of several devices [Hz]; None: that of the layout, or else that of
        the slowest device, up to half of whose rate all channels have noise and motion. A single
        device keeps its own rate, which this must be, if given.
    machine_text, layout_text : str
        Files that machine and layout come from, for the stream's description.
    model : Model or None
        Of the machine, to align several devices by.
    patience : Patience
    tell : callable
        Takes sentences for the user, from any thread.

    Raises
    ------
    DeviceLost
        If a device cannot be reached.
    DataError
        If a device cannot be used.
    LayoutError
        If a sensor has no channel, or one of another unit.

    """

    timing = Timing.LIVE

    def __init__(
        self,
        devices: Sequence[Device],
        layout: Layout,
        sample_rate: float | None = None,
        machine_text: str = '',
        layout_text: str = '',
        model: Model | None = None,
        patience: Patience = Patience(),  # noqa: B008
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._ended = threading.Event()
        self._inbox = Inbox()
        self._readers = [
            DeviceReader(device, self._inbox, number, patience, tell)
            for number, device in enumerate(_with_different_names(devices))
        ]
        try:
            rate, self._merging = self._prepare(layout, sample_rate, model, tell)
        except BaseException:
            self.end()
            self._wait_until_closed()
            raise
        self._description = StandDescription(
            stand=layout.stand,
            stream_id=secrets.randbits(64),
            sample_rate=rate,
            layout=self._merging.layout,
            machine_text=machine_text,
            layout_text=layout_text,
            stamp_ns=time.time_ns(),
        )

    @property
    def description(self) -> StandDescription:
        """What the channels of the blocks are."""
        return self._description

    @property
    def devices(self) -> tuple[DeviceState, ...]:
        """How the devices are."""
        return tuple(reader.state for reader in self._readers)

    def end(self) -> None:
        """Close the devices and end the stream; does not wait for it."""
        self._ended.set()
        for reader in self._readers:
            reader.stop()

    def blocks(self) -> Iterator[SampleBlock]:
        """Yield blocks as they happen, at the end one without samples that is marked `last`."""
        next_index, next_stamp = 0, self._description.stamp_ns
        for first_index, stamp_ns, readings in self._pieces():
            block = SampleBlock(
                stream_id=self._description.stream_id,
                stamp_ns=stamp_ns,
                first_index=first_index,
                sample_rate=self._description.sample_rate,
                samples=readings.samples,
                channel_status=readings.status,
            )
            yield block
            next_index = block.next_index
            next_stamp = stamp_after(stamp_ns, len(readings.samples), block.sample_rate)
        channels = len(self._description.layout.sensors)
        yield SampleBlock(
            stream_id=self._description.stream_id,
            stamp_ns=next_stamp,
            first_index=next_index,
            sample_rate=self._description.sample_rate,
            samples=np.empty((0, channels)),
            channel_status=np.zeros(channels, dtype=np.uint8),
            last=True,
        )

    def _pieces(self) -> Iterator[Piece]:
        is_over = False
        while not is_over:
            # What came before the end is still waiting: a limited amount.
            is_over = self._ended.is_set()
            while item := self._inbox.take(0.0 if is_over else POLL):
                number, block = item
                device = self._positions.get(number)
                if device is None:
                    continue
                if block is None:
                    yield from self._merging.lose(device)
                else:
                    yield from self._merging.add(device, block)
        yield from self._merging.end()
        self._wait_until_closed()

    def _wait_until_closed(self) -> None:
        """Wait for the devices, but not for one that hangs."""
        deadline = time.monotonic() + LONGEST_CLOSING
        for reader in self._readers:
            reader.join(max(0.0, deadline - time.monotonic()))

    def _prepare(
        self,
        layout: Layout,
        sample_rate: float | None,
        model: Model | None,
        tell: Callable[[str], None],
    ) -> tuple[float, Merging]:
        """Wait for the devices; find the sensors in them and the rate of the stream."""
        for reader in self._readers:
            reader.wait_until_open()
        sensors = sensors_of_devices(
            layout, [(reader.name, reader.channels) for reader in self._readers], tell
        )
        for reader, own in zip(self._readers, sensors, strict=True):
            if not own.channels:
                reader.stop()
                tell(f'device {reader.name}: no sensor of the layout is read from it; not used')
        used = [i for i, own in enumerate(sensors) if own.channels]
        self._readers = [self._readers[i] for i in used]
        self._positions = {number: position for position, number in enumerate(used)}
        rates = [reader.sample_rate for reader in self._readers]
        if len(used) > 1:
            rate = sample_rate or layout.sample_rate
            if not rate:
                slowest = min(self._readers, key=lambda one: one.sample_rate)
                rate = slowest.sample_rate
                if rate < ALIKE * max(rates):
                    tell(
                        f'the common clock has {rate:g} Hz, the rate of the slowest device '
                        f'({slowest.name}); for another one, set sample_rate'
                    )
            own_sensors = [sensors[i] for i in used]
            return rate, SeveralDevices(self._readers, own_sensors, layout, rate, model, tell)
        if sample_rate is not None and sample_rate != rates[0]:
            raise DataError(
                f'sample_rate is {sample_rate:g} Hz, but device {self._readers[0].name} samples '
                f'at {rates[0]:g} Hz; leave sample_rate out, or set the device'
            )
        return rates[0], OneDevice(self._readers[0], sensors[used[0]], layout)


def _with_different_names(devices: Sequence[Device]) -> Sequence[Device]:
    names = [device.name for device in devices]
    if not devices:
        raise DataError('no device to read; name one in the settings of the source')
    for name in names:
        if names.count(name) > 1:
            raise DataError(f'two devices are called {name}; names must differ')
    return devices
