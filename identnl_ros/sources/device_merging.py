# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Samples of one device, or of several with clocks of their own, as blocks of one stream."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol, TYPE_CHECKING

from identnl_ros.core.measurement.blocks import ChannelStatus, samples_per_block
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
from identnl_ros.sources.block_cutter import BlockCutter
from identnl_ros.sources.device import DeviceBlock
from identnl_ros.sources.device_channels import Readings, SensorsOfDevice
from identnl_ros.sources.device_reader import DeviceReader
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from identnl_ros.core.synchronisation.stream_alignment import AlignedSamples

Piece = tuple[int, int, Readings]
"""Running index and stamp [ns] of the first sample, and all channels of the layout."""


class Merging(Protocol):
    """Makes what travels of what the devices deliver."""

    layout: Layout
    """With the noise that the samples given out have."""

    def add(self, device: int, block: DeviceBlock) -> Iterator[Piece]:
        """Take samples of a device; yield what is complete."""
        ...

    def lose(self, device: int) -> Iterator[Piece]:
        """Note that a device is away; yield what can be completed without it."""
        ...

    def end(self) -> Iterator[Piece]:
        """Yield what is left."""
        ...


class OneDevice:
    """
    Samples of a single device pass as they are, on its own clock.

    Parameters
    ----------
    reader : DeviceReader
    sensors : SensorsOfDevice
        All of the layout.
    layout : Layout

    """

    def __init__(self, reader: DeviceReader, sensors: SensorsOfDevice, layout: Layout) -> None:
        self.layout = layout
        self._rate = reader.sample_rate
        self._sensors = sensors
        self._cutter = BlockCutter(samples_per_block(self._rate), self._rate)

    def add(self, _device: int, block: DeviceBlock) -> Iterator[Piece]:
        """Take samples; yield complete blocks."""
        return self._converted(self._cutter.add(block))

    def lose(self, _device: int) -> Iterator[Piece]:
        """Yield what has come so far."""
        return self._converted(self._cutter.flush())

    def end(self) -> Iterator[Piece]:
        """Yield what is left."""
        return self._converted(self._cutter.flush())

    def _converted(self, blocks: Iterator[DeviceBlock]) -> Iterator[Piece]:
        for block in blocks:
            readings = self._sensors.to_si(block.samples, block.first_index, self._rate)
            yield block.first_index, block.stamp_ns, readings


class SeveralDevices:
    """
    Samples of several devices are brought to one clock.

    Parameters
    ----------
    readers : sequence of DeviceReader
    sensors : sequence of SensorsOfDevice
        For each reader.
    layout : Layout
    sample_rate : float
        Of the common clock [Hz].
    model : Model or None
        Of the machine, to find the delays between the devices by; None: not known.
    tell : callable
        Takes sentences for the user.

    """

    def __init__(
        self,
        readers: Sequence[DeviceReader],
        sensors: Sequence[SensorsOfDevice],
        layout: Layout,
        sample_rate: float,
        model: Model | None,
        tell: Callable[[str], None],
    ) -> None:
        from identnl_ros.core.synchronisation.stream_alignment import StreamAlignment
        from identnl_ros.core.synchronisation.stream_source import StreamSource

        streams = [
            StreamSource(
                reader.name,
                tuple(one.sensor.name for one in own.channels),
                reader.sample_rate,
            )
            for reader, own in zip(readers, sensors, strict=True)
        ]
        self._alignment = StreamAlignment(layout, streams, sample_rate, model)
        self.layout = self._alignment.layout
        self._sensors = sensors
        self._rates = [reader.sample_rate for reader in readers]
        self._tell = tell
        # What aligning does not carry along: it tells of the samples around.
        self._status = np.zeros(len(layout.sensors), dtype=np.uint8)
        self._before = [BlockCutter(samples_per_block(rate), rate) for rate in self._rates]
        self._after = BlockCutter(samples_per_block(sample_rate), sample_rate)

    def add(self, device: int, block: DeviceBlock) -> Iterator[Piece]:
        """Take samples of a device; yield blocks that all devices have contributed to."""
        self._align(device, self._before[device].add(block))
        yield from self._aligned()

    def lose(self, device: int) -> Iterator[Piece]:
        """Give on what has come of the device."""
        self._align(device, self._before[device].flush())
        yield from self._aligned()

    def end(self) -> Iterator[Piece]:
        """Yield what is left."""
        for device, cutter in enumerate(self._before):
            self._align(device, cutter.flush())
        yield from self._cut(map(_as_block, self._alignment.end()))
        for block in self._after.flush():
            yield self._piece(block)

    def _align(self, device: int, blocks: Iterator[DeviceBlock]) -> None:
        sensors = self._sensors[device]
        places = [one.place for one in sensors.channels]
        for block in blocks:
            readings = sensors.to_si(block.samples, block.first_index, self._rates[device])
            self._status[places] |= readings.status
            self._alignment.add(device, block.first_index, block.stamp_ns, readings.samples)

    def _aligned(self) -> Iterator[Piece]:
        for remark in self._alignment.remarks():
            self._tell(remark)
        yield from self._cut(map(_as_block, self._alignment.take()))

    def _cut(self, aligned: Iterable[DeviceBlock]) -> Iterator[Piece]:
        for samples in aligned:
            for block in self._after.add(samples):
                yield self._piece(block)

    def _piece(self, block: DeviceBlock) -> Piece:
        status: NDArray[np.uint8] = self._status
        self._status = np.zeros_like(status)
        # Also where a device is away while the others go on.
        without = np.isnan(block.samples).any(axis=0) & (status == ChannelStatus.OK)
        status[without] = ChannelStatus.MISSING_SAMPLES
        return block.first_index, block.stamp_ns, Readings(block.samples, status)


def _as_block(aligned: 'AlignedSamples') -> DeviceBlock:
    return DeviceBlock(aligned.first_index, aligned.stamp_ns, aligned.samples)
