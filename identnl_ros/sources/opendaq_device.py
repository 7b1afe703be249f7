# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Devices that speak openDAQ, the open protocols of many measuring amplifiers."""

from collections import deque
from collections.abc import Callable
import time
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.sources.device import Device, DeviceBlock, DeviceChannel, DeviceLost
from identnl_ros.sources.opendaq_clock import clock_of, DomainClock
from identnl_ros.sources.opendaq_connection import Connection
from identnl_ros.sources.setting import Setting, without_empty
from identnl_ros.storage.optional_library import library
import numpy as np

_MOST_SAMPLES = 1 << 16  # of one read
# The reader itself waits until it has all that it was asked for, or the whole timeout.
_PAUSE = 5e-3  # [s]


class OpenDaqDevice:
    """
    An openDAQ device; all its channels on one time base.

    Unit, scaling and clock are those that the device states. Samples are numbered by the
    device's clock from its origin on, so that the numbers go on after a connection was lost.

    Parameters
    ----------
    address : str
        Connection string, e.g. ``daq.nd://192.168.1.5:7420``.
    channels : tuple of str
        Names of signals; empty: all that have a time base.
    sample_rate : float
        To set [Hz]; 0: leave it.
    sdk : module
        The openDAQ SDK.

    """

    def __init__(
        self, address: str, channels: tuple[str, ...], sample_rate: float, sdk: Any
    ) -> None:
        self._address = address
        self._wanted = channels
        self._wanted_rate = sample_rate
        self._sdk = sdk
        self._connection: Connection | None = None
        self._reader: Any = None
        self._clock: DomainClock | None = None
        self._origin_ns: int | None = None
        self._has_begun = False
        self._ready: deque[DeviceBlock] = deque()

    @property
    def name(self) -> str:
        """Its address."""
        return self._address

    @property
    def sample_rate(self) -> float:
        """Rate of its clock [Hz]."""
        if self._clock is None:
            raise DataError('its sample rate is not known before it is open')
        return self._clock.sample_rate

    def open(self) -> tuple[DeviceChannel, ...]:
        """Connect and begin to sample; see `Device`."""
        self._connection = Connection(self._sdk, self._address)
        if self._wanted_rate > 0:
            self._connection.set_sample_rate(self._wanted_rate)
        signals = self._chosen(self._connection.signals)
        clock = self._common_clock(signals)
        if self._wanted_rate > 0 and abs(clock.sample_rate / self._wanted_rate - 1) > 1e-9:
            raise DataError(
                f'it samples at {clock.sample_rate:g} Hz although '
                f'{self._wanted_rate:g} Hz was set; give a rate that it has'
            )
        if clock != self._clock:
            self._clock, self._origin_ns = clock, clock.origin_ns
        self._reader = self._make_reader(list(signals.values()))
        return tuple(DeviceChannel(name, _unit(signal)) for name, signal in signals.items())

    def read(self, timeout: float) -> DeviceBlock | None:
        """Give the samples that have come; see `Device`."""
        end = time.monotonic() + timeout
        while not self._ready:
            if self._reader is None or self._connection is None:
                raise DeviceLost('it is not open')
            self._fetch()
            if self._ready:
                break
            if self._connection.is_lost:
                raise DeviceLost('the connection is down')
            if time.monotonic() >= end:
                return None
            time.sleep(_PAUSE)
        return self._ready.popleft()

    def close(self) -> None:
        """Let go of it; never raises."""
        # In this order: each holds the next.
        self._reader = None
        self._connection = None
        self._has_begun = False
        self._ready.clear()

    def _fetch(self) -> None:
        """Take what the reader has."""
        clock = self._clock
        assert clock is not None
        samples, ticks, status = self._reader.read_with_domain(_MOST_SAMPLES, 0, True)
        if status.read_status != self._sdk.ReadStatus.Ok:
            self._look_at_change(status)
            return
        if ticks.size == 0:
            return
        samples, ticks = np.atleast_2d(samples, ticks)  # of one signal it gives no rows
        if (ticks != ticks[0]).any():
            raise DeviceLost('its channels are out of step; connect again')
        ticks = ticks[0]
        if self._origin_ns is None:
            first = clock.stamp_ns(int(ticks[-1]) + clock.step, 0)
            self._origin_ns = time.time_ns() - first
        self._has_begun = True
        for run in clock.runs(ticks):
            first = int(ticks[run.start])
            self._ready.append(
                DeviceBlock(
                    clock.index(first),
                    clock.stamp_ns(first, self._origin_ns),
                    np.ascontiguousarray(samples[:, run].T, dtype=float),
                )
            )

    def _look_at_change(self, status: Any) -> None:
        """Go on after the event with which every stream begins; else the device has changed."""
        if not self._has_begun and status.read_status == self._sdk.ReadStatus.Event:
            return
        raise DeviceLost(
            'its sample rate, a unit or the scaling of a channel was changed; connect again'
        )

    def _chosen(self, signals: dict[str, Any]) -> dict[str, Any]:
        # Of several devices, each has some of the channels that are named.
        chosen = {name: signals[name] for name in self._wanted or signals if name in signals}
        if not chosen:
            raise DataError(
                f'it has no channel {" or ".join(self._wanted) or "at all"}; '
                f'with a time base it has {", ".join(signals) or "none"}'
            )
        return chosen

    def _common_clock(self, signals: dict[str, Any]) -> DomainClock:
        of_clock: dict[DomainClock, list[str]] = {}
        for name, signal in signals.items():
            where = f'channel {name}'
            if signal.descriptor is None:
                raise DeviceLost(f'{where} has no description yet')
            of_clock.setdefault(clock_of(signal, where), []).append(name)
        if len(of_clock) > 1:
            groups = '; '.join(
                f'{clock.sample_rate:g} Hz: {", ".join(names)}'
                for clock, names in of_clock.items()
            )
            raise DataError(
                f'it has channels of different sample rates or clocks ({groups}); '
                'name those of one of them in channels'
            )
        return next(iter(of_clock))

    def _make_reader(self, signals: list[Any]) -> Any:
        sdk = self._sdk
        builder = sdk.MultiReaderBuilder()
        for signal in signals:
            builder.add_signal(signal)
        builder.value_read_type = sdk.SampleType.Float64
        builder.domain_read_type = sdk.SampleType.Int64
        builder.read_mode = sdk.ReadMode.Scaled
        try:
            return builder.build()
        except RuntimeError as error:
            raise DataError(f'its channels cannot be read: {error}') from None


class OpenDaqDevices:
    """The openDAQ devices that the settings name."""

    settings = (
        Setting(
            'connection',
            [''],
            'Connection strings of the devices, such as daq.nd://192.168.1.5:7420 or '
            'daq.ns://192.168.1.5; daq:// and a serial number searches the network.',
        ),
        Setting(
            'channels', [''], 'Names of the signals to read; empty: all that have a time base.'
        ),
        Setting(
            'sample_rate',
            0.0,
            'Sample rate to set [Hz]; 0: leave the device as it is set.',
            0.0,
            1e9,
        ),
    )

    def devices(self, setting: Callable[[str], Any]) -> list[Device]:
        """Make what the settings describe; see `KindOfDevice`."""
        addresses = without_empty(setting('connection'))
        if not addresses:
            raise DataError(
                'setting connection is empty; give the connection strings of the openDAQ devices, '
                'such as ["daq.nd://192.168.1.5:7420"]'
            )
        sdk = library('opendaq', 'opendaq', 'openDAQ devices')
        channels = without_empty(setting('channels'))
        return [
            OpenDaqDevice(address, channels, setting('sample_rate'), sdk)
            for address in dict.fromkeys(addresses)
        ]


def _unit(signal: Any) -> str:
    unit = signal.descriptor.unit
    return unit.symbol or '' if unit is not None else ''


source = OpenDaqDevices()
