# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Devices of NI through the driver NI-DAQmx.

Written to the documentation of the package nidaqmx; it has never run with hardware.
"""

from collections.abc import Callable
import contextlib
import time
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.sources.device import Device, DeviceBlock, DeviceChannel, DeviceLost
from identnl_ros.sources.setting import Setting, without_empty
from identnl_ros.storage.optional_library import library
import numpy as np

_BUFFER = 10.0  # [s]
_PAUSE = 5e-3  # [s]
# Errors of a device that is not there; it may be plugged in again.
_ABSENT = (
    'DEV_ABSENT_OR_UNAVAILABLE',
    'DEV_CANNOT_BE_ACCESSED',
    'DEVICE_REMOVED',
    'INVALID_DEVICE_ID',
)


class NiDaqDevice:
    """
    One task: analogue inputs that share a sample clock; all in volts.

    Parameters
    ----------
    voltage, iepe : tuple of str
        Physical channels, e.g. ``cDAQ1Mod1/ai0:3``; those of `iepe` feed their sensors and
        block the constant part.
    sample_rate : float
        [Hz]; the device takes the nearest that it has.
    ranges : tuple of float
        Largest voltage of `voltage` and of `iepe` [V].
    terminal : str
        How voltages are connected: a name of ``nidaqmx.constants.TerminalConfiguration``.
    excitation : float
        Current of IEPE sensors [A].

    """

    name = 'nidaqmx'

    def __init__(
        self,
        voltage: tuple[str, ...],
        iepe: tuple[str, ...],
        sample_rate: float,
        ranges: tuple[float, float],
        terminal: str,
        excitation: float,
    ) -> None:
        self._voltage, self._iepe = voltage, iepe
        self._wanted_rate = sample_rate
        self._ranges = ranges
        self._terminal = terminal
        self._excitation = excitation
        self._ni = _package()
        self._task: Any = None
        self._reader: Any = None
        self._rate = float('nan')
        self._channels = 0
        self._next_index = 0
        self._start_ns = 0

    @property
    def sample_rate(self) -> float:
        """Rate of the sample clock [Hz]."""
        return self._rate

    def open(self) -> tuple[DeviceChannel, ...]:
        """Configure and start the task; see `Device`."""
        ni = self._ni
        try:
            task = self._task = ni.Task()
            self._add_channels(task)
            task.timing.cfg_samp_clk_timing(
                self._wanted_rate,
                sample_mode=ni.constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=round(_BUFFER * self._wanted_rate),
            )
            self._rate = float(task.timing.samp_clk_rate)
            self._reader = ni.stream_readers.AnalogMultiChannelReader(task.in_stream)
            names = list(task.channel_names)
            self._channels, self._next_index = len(names), 0
            task.start()
            self._start_ns = time.time_ns()
        except ni.errors.DaqNotFoundError as error:
            raise _no_driver(error) from None
        except ni.errors.Error as error:
            if self._is_absent(error):
                raise DeviceLost(f'it does not answer: {_words(error)}') from None
            raise DataError(f'it cannot be used as set: {_words(error)}') from None
        return tuple(DeviceChannel(name, 'V') for name in names)

    def read(self, timeout: float) -> DeviceBlock | None:
        """Give the samples that have come; see `Device`."""
        task, ni = self._task, self._ni
        if task is None:
            raise DeviceLost('it is not open')
        end = time.monotonic() + timeout
        try:
            while (count := int(task.in_stream.avail_samp_per_chan)) == 0:
                if time.monotonic() >= end:
                    return None
                time.sleep(_PAUSE)
            data = np.empty((self._channels, count))
            count = self._reader.read_many_sample(data, number_of_samples_per_channel=count)
        except ni.errors.Error as error:
            # Also an overrun: the task must be started again.
            raise DeviceLost(_words(error)) from None
        first = self._next_index
        self._next_index += count
        stamp_ns = self._start_ns + round(first * 1e9 / self._rate)
        return DeviceBlock(first, stamp_ns, np.ascontiguousarray(data[:, :count].T))

    def close(self) -> None:
        """Let go of it; never raises."""
        task, self._task, self._reader = self._task, None, None
        if task is not None:
            with contextlib.suppress(Exception):
                task.close()

    def _add_channels(self, task: Any) -> None:
        ni = self._ni
        for inputs in self._voltage:
            task.ai_channels.add_ai_voltage_chan(
                inputs,
                terminal_config=ni.constants.TerminalConfiguration[self._terminal],
                min_val=-self._ranges[0],
                max_val=self._ranges[0],
            )
        for inputs in self._iepe:
            channel = task.ai_channels.add_ai_voltage_chan(
                inputs,
                terminal_config=ni.constants.TerminalConfiguration.PSEUDO_DIFF,
                min_val=-self._ranges[1],
                max_val=self._ranges[1],
            )
            channel.ai_coupling = ni.constants.Coupling.AC
            channel.ai_excit_src = ni.constants.ExcitationSource.INTERNAL
            channel.ai_excit_val = self._excitation

    def _is_absent(self, error: Any) -> bool:
        codes = [self._ni.error_codes.DAQmxErrors[name].value for name in _ABSENT]
        return getattr(error, 'error_code', None) in codes


class NiDaqDevices:
    """The task that the settings describe."""

    settings = (
        Setting(
            'voltage', [''], 'Physical channels that measure voltages, such as cDAQ1Mod2/ai0:3.'
        ),
        Setting('iepe', [''], 'Physical channels with IEPE sensors, such as cDAQ1Mod1/ai0:3.'),
        Setting('sample_rate', 10000.0, 'Sample rate [Hz].', 1e-3, 1e7),
        Setting('voltage_range', 10.0, 'Largest voltage of the voltage channels [V].', 1e-6, 1e3),
        Setting('iepe_range', 5.0, 'Largest voltage of the IEPE channels [V].', 1e-6, 1e2),
        Setting(
            'terminal',
            'DEFAULT',
            'How voltages are connected.',
            choices=('DEFAULT', 'RSE', 'NRSE', 'DIFF', 'PSEUDO_DIFF'),
        ),
        Setting('excitation', 0.004, 'Current of the IEPE sensors [A].', 0.0, 0.1),
    )

    def devices(self, setting: Callable[[str], Any]) -> list[Device]:
        """Make what the settings describe; see `KindOfDevice`."""
        voltage, iepe = (without_empty(setting(name)) for name in ('voltage', 'iepe'))
        if not voltage and not iepe:
            raise DataError(
                'settings voltage and iepe are empty; give physical channels such as '
                '["cDAQ1Mod1/ai0:3"]'
            )
        ranges = (setting('voltage_range'), setting('iepe_range'))
        return [
            NiDaqDevice(
                voltage,
                iepe,
                setting('sample_rate'),
                ranges,
                setting('terminal'),
                setting('excitation'),
            )
        ]


def _package() -> Any:
    for module in ('constants', 'error_codes', 'errors', 'stream_readers'):
        library(f'nidaqmx.{module}', 'nidaqmx', 'NI-DAQmx devices')
    return library('nidaqmx', 'nidaqmx', 'NI-DAQmx devices')


def _no_driver(error: Exception) -> DataError:
    return DataError(
        f'the driver NI-DAQmx is not installed ({_words(error)}); '
        'install it as root: python -m nidaqmx installdriver'
    )


def _words(error: Exception) -> str:
    return ' '.join(str(error).split())


source = NiDaqDevices()
