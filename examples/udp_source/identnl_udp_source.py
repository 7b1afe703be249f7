# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
A device that sends its samples as UDP datagrams: an example of a source of one's own.

A datagram holds consecutive samples of all channels, numbers little-endian:
index of the first sample (uint64), its time in nanoseconds since 1970 (uint64), then the samples
(float64), all channels of the first, all channels of the second, and so on.

"""

from collections.abc import Callable
import socket
import struct
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.sources.device import Device, DeviceBlock, DeviceChannel, DeviceLost
from identnl_ros.sources.setting import Setting, without_empty
import numpy as np

HEAD = struct.Struct('<QQ')
LARGEST_DATAGRAM = 65535
BUFFER = 4 * 1024 * 1024  # bytes that the system keeps while nobody reads


class UdpDevice:
    """
    Listens for the datagrams of one device.

    Parameters
    ----------
    host : str
        Address of this computer to listen on.
    port : int
    sample_rate : float
        Of the device [Hz].
    channels : tuple of DeviceChannel

    """

    def __init__(
        self, host: str, port: int, sample_rate: float, channels: tuple[DeviceChannel, ...]
    ) -> None:
        self.name = f'{host}:{port}'
        self.sample_rate = sample_rate
        self._address = (host, port)
        self._channels = channels
        self._socket: socket.socket | None = None

    def open(self) -> tuple[DeviceChannel, ...]:
        """Listen."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            self._socket.bind(self._address)
        except OSError as error:
            raise DeviceLost(f'cannot listen on {self.name}: {error}') from None
        return self._channels

    def read(self, timeout: float) -> DeviceBlock | None:
        """Give the samples of the next datagram; a datagram of another form counts as none."""
        assert self._socket is not None, 'read before it was opened'
        self._socket.settimeout(timeout)
        try:
            data = self._socket.recv(LARGEST_DATAGRAM)
        except TimeoutError:
            return None
        except OSError as error:
            raise DeviceLost(f'{self.name}: {error}') from None
        row = 8 * len(self._channels)
        if len(data) <= HEAD.size or (len(data) - HEAD.size) % row:
            return None
        first_index, stamp_ns = HEAD.unpack_from(data)
        samples = np.frombuffer(data, '<f8', offset=HEAD.size).reshape(-1, len(self._channels))
        return DeviceBlock(first_index, stamp_ns, samples)

    def close(self) -> None:
        """Listen no more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class UdpDevices:
    """What the entry point names: the settings, and the device that they describe."""

    settings = (
        Setting('host', '127.0.0.1', 'Address of this computer to listen on.'),
        Setting('port', 9750, 'Port to listen on.', 1, 65535),
        Setting('sample_rate', 10_000.0, 'Sample rate of the device [Hz].', 1e-3, 1e7),
        Setting('channels', '', 'Names of the channels in order, with units: "cell:V, probe:um".'),
    )

    def devices(self, setting: Callable[[str], Any]) -> list[Device]:
        """Make the device; it is opened later."""
        channels = []
        for text in without_empty(setting('channels').split(',')):
            name, _, unit = text.partition(':')
            channels.append(DeviceChannel(name.strip(), unit.strip()))
        if not channels:
            raise DataError(
                'parameter udp.channels is empty; name the channels of a datagram in their order'
            )
        return [
            UdpDevice(setting('host'), setting('port'), setting('sample_rate'), tuple(channels))
        ]


source = UdpDevices()
