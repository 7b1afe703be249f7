# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The source that the parameters of the sensor bridge ask for, out of those installed."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.sources.device import Device
from identnl_ros.sources.device_reader import Patience
from identnl_ros.sources.device_source import DeviceSource
from identnl_ros.sources.registry import (
    installed_sources,
    InstalledSource,
    KindOfDevice,
    KindOfSource,
    Values,
)
from identnl_ros.sources.setting import Setting
from identnl_ros.sources.source import Source
from identnl_ros.storage.layout_file import default_layout_path, load_layout
from identnl_ros.storage.machine_file import load_machine

# Their settings are parameters of the bridge without prefix.
UNPREFIXED = ('simulated', 'bag')
# Parameters that every source can read.
SHARED = ('machine_file', 'layout_file', 'sample_rate')

SETTINGS = (
    Setting(
        'source',
        'simulated',
        'Where the samples come from: simulated, bag, or a kind of device that is installed; '
        'several kinds of device are joined by "+".',
    ),
    Setting('machine_file', '', 'Machine file (YAML) of the stand; not needed for a bag.'),
    Setting(
        'layout_file',
        '',
        'Sensor layout file (YAML); empty: the one beside the machine file.',
    ),
    Setting(
        'sample_rate',
        0.0,
        'Sample rate of the simulated stand, or common rate of several devices [Hz]; 0: that of '
        'the layout file, or else 10 kHz, or that of the slowest device.',
        0.0,
        1e7,
    ),
    Setting(
        'device_silence',
        3.0,
        'A device from which nothing comes for longer is lost and opened again [s].',
        0.1,
        1e6,
    ),
    Setting(
        'reconnect_pause',
        0.5,
        'Pause before a lost device is opened again [s]; doubled each time that it is in vain.',
        0.01,
        1e3,
    ),
    Setting('reconnect_longest_pause', 5.0, 'Longest such pause [s].', 0.01, 1e3),
)


def settings_of_sources() -> tuple[Setting, ...]:
    """
    Give the settings of all installed sources as parameters of the bridge.

    Returns
    -------
    tuple of Setting
        Named ``<source>.<setting>``; without prefix where the source is of `UNPREFIXED`.

    """
    return tuple(
        replace(setting, name=_parameter(source, setting.name))
        for source in installed_sources()
        for setting in source.settings
    )


def make_source(setting: Values, tell: Callable[[str], None] = lambda _: None) -> Source:
    """
    Make the source.

    Parameters
    ----------
    setting : callable
        Gives the value of a parameter by its name.
    tell : callable
        Takes sentences for the user, from any thread.

    Returns
    -------
    Source

    Raises
    ------
    IdentnlError
        If a file, a number or a source is unsound.

    """
    names = [name.strip() for name in setting('source').split('+')]
    sources = [installed_sources()[name] for name in names]
    if len(set(names)) < len(names):
        raise DataError(f'source is "{setting("source")}", expected every kind of device once')
    makers = [one for one in sources if not _is_kind_of_device(one)]
    if not makers:
        return _device_source(sources, setting, tell)
    if len(sources) > 1:
        raise DataError(
            f'source is "{setting("source")}", but {makers[0].name} cannot be joined with '
            'others; only devices can'
        )
    maker = cast(KindOfSource, makers[0].kind)
    return cast(Source, _made(makers[0], maker.make, setting))


def _device_source(
    sources: list[InstalledSource], setting: Values, tell: Callable[[str], None]
) -> DeviceSource:
    if not setting('machine_file'):
        raise DataError(
            'parameter machine_file is empty; give the machine file of the stand that the '
            'devices measure'
        )
    machine = load_machine(setting('machine_file'))
    layout = load_layout(Path(setting('layout_file') or default_layout_path(machine.path)))
    devices: list[Device] = []
    for source in sources:
        devices += _made(source, cast(KindOfDevice, source.kind).devices, setting)
    return DeviceSource(
        devices,
        layout.layout,
        setting('sample_rate') or None,
        machine.text,
        layout.text,
        assemble(machine.machine),
        Patience(
            setting('device_silence'),
            setting('reconnect_pause'),
            setting('reconnect_longest_pause'),
        ),
        tell,
    )


def _is_kind_of_device(source: InstalledSource) -> bool:
    return callable(getattr(source.kind, 'devices', None))


def _made(source: InstalledSource, make: Callable[[Values], Any], setting: Values) -> Any:
    """Call foreign code; what it raises beside the errors meant for the user names its package."""

    def own(name: str) -> Any:
        if any(one.name == name for one in source.settings):
            return setting(_parameter(source, name))
        if name in SHARED:
            return setting(name)
        raise KeyError(f'setting "{name}" is not declared')

    try:
        return make(own)
    except IdentnlError:
        raise
    except Exception as error:
        raise DataError(
            f'source "{source.name}" of the package {source.distribution} failed: '
            f'{type(error).__name__}: {error}'
        ) from error


def _parameter(source: InstalledSource, name: str) -> str:
    return name if source.name in UNPREFIXED else f'{source.name}.{name}'
