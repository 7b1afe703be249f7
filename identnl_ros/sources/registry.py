# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The installed sources of samples: entry points of the group `identnl_ros.sources`."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.metadata import entry_points, EntryPoint
import re
from typing import Any, Protocol

from identnl_ros.core.errors import DataError
from identnl_ros.sources.device import Device
from identnl_ros.sources.setting import Setting
from identnl_ros.sources.source import Source

GROUP = 'identnl_ros.sources'
_NAME = re.compile(r'[A-Za-z]\w*')
_TYPES = (bool, int, float, str, list)

Values = Callable[[str], Any]
"""Value by its name: of a setting of the source, of machine_file, layout_file, sample_rate."""


class KindOfSource(Protocol):
    """
    A source that makes its own blocks, as a simulation does: what an entry point names.

    Settings are read as a node starts, whether the source is used or not: whatever takes long
    to import belongs into `make`.

    """

    @property
    def settings(self) -> tuple[Setting, ...]:
        """What the user can set."""
        ...

    def make(self, setting: Values) -> Source:
        """
        Make the source.

        Raises
        ------
        IdentnlError
            If a setting is unsound, or what it needs is not there.

        """
        ...


class KindOfDevice(Protocol):
    """
    Data acquisition devices of one kind: what an entry point names.

    Settings are read as a node starts, whether the devices are used or not: the import of a
    manufacturer's software belongs into `devices`.

    """

    @property
    def settings(self) -> tuple[Setting, ...]:
        """What the user can set."""
        ...

    def devices(self, setting: Values) -> list[Device]:
        """
        Make the devices; they are opened later.

        Raises
        ------
        IdentnlError
            If a setting is unsound, or the software that they need is not installed.

        """
        ...


@dataclass(frozen=True)
class InstalledSource:
    """
    A source of samples that is installed, whether it works or not.

    Parameters
    ----------
    name : str
        Of its entry point, by which the user asks for it.
    distribution : str
        The package that it comes from.
    kind : object or None
        What makes it; None: it cannot be used.
    problem : str
        Why not, in a sentence; empty: it can.

    """

    name: str
    distribution: str
    kind: KindOfSource | KindOfDevice | None
    problem: str = ''

    @property
    def settings(self) -> tuple[Setting, ...]:
        """What the user can set; none where it cannot be used."""
        return self.kind.settings if self.kind is not None else ()


class Registry:
    """
    All installed sources.

    Parameters
    ----------
    found : iterable of EntryPoint
        Of two of one name, that of this package counts; two of others cannot be used.

    """

    def __init__(self, found: Iterable[EntryPoint]) -> None:
        by_name: dict[str, list[EntryPoint]] = {}
        for point in found:
            same = by_name.setdefault(point.name, [])
            if all(point.value != other.value for other in same):
                same.append(point)
        self._sources = {name: _loaded(name, points) for name, points in sorted(by_name.items())}

    @property
    def names(self) -> tuple[str, ...]:
        """What the user can ask for."""
        return tuple(self._sources)

    def __getitem__(self, name: str) -> InstalledSource:
        """
        Find a source that can be used.

        Parameters
        ----------
        name : str

        Returns
        -------
        InstalledSource

        Raises
        ------
        DataError
            If there is none of the name, or it cannot be used.

        """
        source = self._sources.get(name)
        if source is None:
            close = get_close_matches(name, self.names, 1)
            hint = f'did you mean "{close[0]}"?' if close else 'installed are ' + (
                ', '.join(self.names) or 'none: install the package identnl_ros'
            )  # fmt: skip
            raise DataError(f'source "{name}" is not installed; {hint}')
        if source.problem:
            raise DataError(source.problem)
        return source

    def __iter__(self) -> Iterator[InstalledSource]:
        """Yield all, those that cannot be used too."""
        return iter(self._sources.values())


@cache
def installed_sources() -> Registry:
    """
    Find the sources that are installed; looks once in the life of a process.

    Returns
    -------
    Registry

    """
    return Registry(entry_points(group=GROUP))


def _loaded(name: str, points: list[EntryPoint]) -> InstalledSource:
    own_package = __name__.partition('.')[0]
    own = [point for point in points if point.module.partition('.')[0] == own_package]
    *others, point = own or points
    packages = ' and '.join(_distribution(one) for one in (*others, point))
    if others:
        return InstalledSource(
            name,
            packages,
            None,
            f'source "{name}" comes from two packages, {packages}; uninstall one of them',
        )
    broken = f'source "{name}" of the package {packages} ({point.value}) cannot be used'
    try:
        kind = point.load()
        problem = _unsound(name, kind)
    # Whatever foreign code does as it is imported: the other sources must still work.
    except (Exception, SystemExit) as error:
        kind, problem = None, f'{type(error).__name__}: {error}'
    if problem:
        problem = f'{broken}: {" ".join(problem.split())}; reinstall or repair it'
        return InstalledSource(name, packages, None, problem)
    return InstalledSource(name, packages, kind)


def _unsound(name: str, kind: Any) -> str:
    """Say why a source cannot be used; empty: it can."""
    if not _NAME.fullmatch(name):
        return 'its name is no word of letters, digits and underscores'
    if not callable(getattr(kind, 'make', None)) and not callable(getattr(kind, 'devices', None)):
        return f'it is of type {type(kind).__name__} and has neither make() nor devices()'
    settings = kind.settings
    if not isinstance(settings, tuple) or not all(isinstance(one, Setting) for one in settings):
        return 'its settings are no tuple of identnl_ros.sources.setting.Setting'
    names = [one.name for one in settings]
    for one in settings:
        if not _NAME.fullmatch(one.name) or names.count(one.name) > 1:
            return f'the name of its setting "{one.name}" is no word, or not the only one'
        if not isinstance(one.default, _TYPES):
            return f'the default of its setting {one.name} is a {type(one.default).__name__}'
    return ''


def _distribution(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else 'unknown'
