# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Parameter files of ROS, checked against the parameters that the nodes have."""

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
import re
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.sources.setting import Setting
import yaml

_PARAMETERS = 'ros__parameters'
# What every node has beside its settings.
_OF_ALL = ('use_sim_time', 'qos_overrides.')


def read_parameter_file(
    path: Path, namespace: str, nodes: Mapping[str, tuple[Setting, ...]]
) -> dict[str, dict[str, Any]]:
    """
    Read a parameter file for the nodes of a stand.

    Sections are named as ROS names them, such as ``/**``, ``/stand/transform``,
    ``/**/transform``, or by a node's name in the namespace of the stand. Of several that give
    a parameter to a node the last one counts.

    Parameters
    ----------
    path : Path
    namespace : str
        Of the stand.
    nodes : mapping of str to tuple of Setting
        The parameters of every node by its name.

    Returns
    -------
    dict of str to dict
        Values by the names of node and parameter.

    Raises
    ------
    DataError
        If the file cannot be read, or names a node, a parameter or a value that cannot be.

    """
    found: dict[str, dict[str, Any]] = {node: {} for node in nodes}
    for section, values in _sections(_content(path)):
        meant = [node for node in nodes if _means(section, namespace, node)]
        if not meant:
            raise DataError(
                f'{path}: section "{section.strip("/")}" is for no node of the stand; expected '
                f'{", ".join(nodes)}, with or without /{namespace.strip("/")}/ before it, or /**'
            )
        for name, value in values.items():
            taken = [node for node in meant if _has(nodes[node], name)]
            if not taken:
                known = [setting.name for node in meant for setting in nodes[node]]
                raise DataError(_unknown(path, meant, name, known))
            for node in taken:
                found[node][name] = _checked(path, node, nodes[node], name, value)
    return found


def _content(path: Path) -> Mapping[str, Any]:
    try:
        content = yaml.safe_load(path.read_text('utf-8'))
    except OSError as error:
        raise DataError(f'{path} cannot be read: {error.strerror}') from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(f'{path} is not YAML: {" ".join(str(error).split())}') from None
    if not isinstance(content, dict) or not any(True for _ in _sections(content)):
        raise DataError(
            f'{path} is no parameter file of ROS; expected the name of a node, below it '
            f'"{_PARAMETERS}:", and below that the parameters'
        )
    return content


def _sections(tree: Mapping[Any, Any], name: str = '') -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters of every section; names may be written as levels of a tree."""
    for key, value in tree.items():
        if key == _PARAMETERS and isinstance(value, dict):
            yield name, dict(_flat(value))
        elif isinstance(value, dict):
            yield from _sections(value, f'{name}/{str(key).strip("/")}')


def _flat(tree: Mapping[Any, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def _means(section: str, namespace: str, node: str) -> bool:
    parts = section.strip('/').split('/')
    tokens = {'**': '(/[^/]+)*', '*': '/[^/]+'}
    pattern = re.compile(''.join(tokens.get(part, re.escape(f'/{part}')) for part in parts))
    full = f'/{namespace.strip("/")}/{node}'.replace('//', '/')
    return any(pattern.fullmatch(one) is not None for one in (full, f'/{node}'))


def _has(settings: Iterable[Setting], name: str) -> bool:
    return name.startswith(_OF_ALL) or any(one.name == name for one in settings)


def _unknown(path: Path, nodes: list[str], name: str, known: list[str]) -> str:
    close = get_close_matches(name, known, 1)
    hint = f'did you mean "{close[0]}"?' if close else f'known are {", ".join(known)}'
    return f'{path}: parameter "{name}" of {", ".join(nodes)} is unknown; {hint}'


def _checked(path: Path, node: str, settings: Iterable[Setting], name: str, value: Any) -> Any:
    for setting in settings:
        if setting.name == name:
            value = setting.converted(value)
            if reason := setting.refusal(value):
                raise DataError(f'{path}: {node}: {reason}')
    return value
