# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Connection to an openDAQ device by its address."""

from collections import Counter
import re
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.sources.device import DeviceLost

# Protocols that send samples, the better first, and what their addresses begin with.
_STREAMINGS = {'OpenDAQNativeStreaming': 'daq.ns', 'OpenDAQLTStreaming': 'daq.lt'}
_ADDRESS = re.compile(r'(?P<kind>[\w.]+)://(?P<host>\[[^]]*\]|[^:/]*)(:(?P<port>\d+))?')
_SEARCHED = 'daq'  # the SDK looks such devices up in the network, by multicast DNS
_RATES = ('SampleRate', 'GlobalSampleRate')  # names of the property; the standard has none


class Connection:
    """
    A connected device.

    The device is made by the module of the SDK that knows its kind of address; `add_device` of
    the SDK does the same, but asks the whole network by multicast DNS before.

    Parameters
    ----------
    sdk : module
        The openDAQ SDK.
    address : str
        Such as ``daq.nd://192.168.1.5:7420``.

    Raises
    ------
    DeviceLost
        If nothing answers.
    DataError
        If the address is unsound or the device has no samples.

    """

    def __init__(self, sdk: Any, address: str) -> None:
        self._sdk = sdk
        self.address = address
        builder = sdk.InstanceBuilder()
        builder.global_log_level = sdk.LogLevel.Critical
        self._instance: Any = builder.build()
        try:
            self.device = self._made()
            self._stream()
        except RuntimeError as error:
            raise _as_ours(error) from None
        self.signals = self._named_signals()

    @property
    def is_lost(self) -> bool:
        """Whether a connection is down; the SDK notes a silent one after 1.5 s."""
        statuses = self.device.connection_status_container.statuses
        return any(str(statuses[name]) != 'ConnectionStatusType.Connected' for name in statuses)

    def set_sample_rate(self, rate: float) -> None:
        """
        Set the sample rate of all channels.

        Parameters
        ----------
        rate : float
            [Hz].

        Raises
        ------
        DataError
            If the device has no such property, or refuses the value.

        """
        holders = [self.device, *self.device.channels_recursive]
        found = [(one, name) for one in holders for name in _RATES if one.has_property(name)]
        if not found:
            raise DataError(
                f'it has no property {" or ".join(_RATES)} by which to set '
                f'{rate:g} Hz; set it with the tools of the device and leave sample_rate at 0'
            )
        try:
            for holder, name in found:
                holder.set_property_value(name, type(holder.get_property_value(name))(rate))
        except RuntimeError as error:
            raise DataError(f'it refuses the sample rate {rate:g} Hz: {error}') from None

    def _made(self) -> Any:
        kind = self.address.partition('://')[0]
        if kind == _SEARCHED:
            return self._instance.add_device(self.address)
        known = set()
        for module in self._instance.module_manager.modules:
            try:
                types = module.available_device_types.values()
            except RuntimeError:
                continue  # a module without devices
            for one in types:
                prefix = self._sdk.IDeviceType.cast_from(one).connection_string_prefix
                known.add(prefix)
                if prefix == kind:
                    return module.create_device(self.address, self._instance, None)
        raise DataError(
            f'openDAQ knows no address of the form "{self.address}"; expected one that begins '
            f'with {", ".join(f"{one}://" for one in sorted(known))}'
        )

    def _stream(self) -> None:
        """Let a remote device that is not only a stream send its samples."""
        sdk = self._sdk
        if self.address.startswith(f'{_SEARCHED}://') or not (
            sdk.IMirroredDevice.can_cast_from(self.device)
        ):
            return
        device = sdk.IMirroredDevice.cast_from(self.device)
        if device.streaming_sources:
            return
        offered = {one.protocol_id: one for one in device.info.server_capabilities}
        found = _ADDRESS.match(self.address)
        for protocol, kind in _STREAMINGS.items():
            if protocol in offered and found is not None:
                # The native protocols share a port, which a router may have translated.
                is_native = (found['kind'], kind) == ('daq.nd', 'daq.ns')
                port = (is_native and found['port']) or int(offered[protocol].port)
                streaming = device.add_streaming(f'{kind}://{found["host"]}:{port}')
                signals = list(device.signals_recursive)
                streaming.add_signals(signals)
                streaming.active = True
                for one in signals:
                    signal = sdk.IMirroredSignalConfig.cast_from(one)
                    if streaming.connection_string in list(signal.streaming_sources):
                        signal.active_streaming_source = streaming.connection_string
                return
        raise DataError(
            f'it sends no samples by {" or ".join(_STREAMINGS)}; it offers '
            f'{", ".join(sorted(offered)) or "nothing"}'
        )

    def _named_signals(self) -> dict[str, Any]:
        """Find the signals with a time base; by their path where names are not unique."""
        found = [one for one in self.device.signals_recursive if one.domain_signal is not None]
        count = Counter(one.name for one in found)
        own = f'{self.device.global_id}/'
        return {
            one.name if count[one.name] == 1 else one.global_id.removeprefix(own): one
            for one in found
        }


def _as_ours(error: RuntimeError) -> DataError:
    """Tell a device that does not answer from an address that can never be right."""
    words = str(error).strip().splitlines()[0] if str(error).strip() else 'no reason given'
    if 'connect' in words.lower() or 'timeout' in words.lower():
        return DeviceLost(f'does not answer: {words}')
    return DataError(f'cannot be used: {words}')
