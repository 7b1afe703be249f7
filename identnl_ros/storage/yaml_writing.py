# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Text of YAML files as people write them: blocks of keys, vectors in one line, bare numbers."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
import yaml

Data = str | Sequence['Data'] | Mapping[str, 'Data']

_TAG = 'tag:yaml.org,2002:'
_WIDTH = 99
# Multiples of a unit vector that are tried until one comes out as the same to the last bit.
_MULTIPLES = range(2, 100)


class Inline(dict[str, Data]):
    """Keys and values that are written in one line, between braces."""


def number(value: float) -> str:
    """
    Write a number so that the same one is read.

    Parameters
    ----------
    value : float

    Returns
    -------
    str
        As few digits as tell it from its neighbours; with a power of ten if that is shorter.

    """
    if not np.isfinite(value):
        return repr(float(value))
    plain = np.format_float_positional(value, trim='-')
    power = np.format_float_scientific(value, trim='-', exp_digits=1).replace('e+', 'e')
    return min(plain, power, key=len)


def vector(values: Iterable[float]) -> list[Data]:
    """
    Write a list of numbers.

    Parameters
    ----------
    values : iterable of float

    Returns
    -------
    list of str

    """
    return [number(float(value)) for value in values]


def direction(unit: NDArray[np.float64]) -> Data:
    """
    Write a direction so that the same unit vector comes out when it is normalised.

    Parameters
    ----------
    unit : ndarray, shape (3,)
        Of length 1.

    Returns
    -------
    str or list of str
        ``+x`` and the like where it is an axis; else a vector of any length. In rare cases
        none is found that gives all last bits.

    """
    (places,) = np.nonzero(unit)
    if len(places) == 1:
        return f'{"-" if unit[places[0]] < 0 else "+"}{"xyz"[places[0]]}'
    for factor in (1.0, 1 / np.abs(unit).max(), *_MULTIPLES):
        multiple = factor * unit
        if np.array_equal(multiple / np.linalg.norm(multiple), unit):
            return vector(multiple)
    return vector(unit)


def yaml_text(headline: str, sections: Mapping[str, Data]) -> str:
    """
    Write a YAML file.

    Parameters
    ----------
    headline : str
        Comment on top, of any number of lines; empty: none.
    sections : mapping of str to str, sequence or mapping
        Content, in its order; parts with keys of their own stand apart.

    Returns
    -------
    str

    """
    text = ''.join(f'# {line}'.rstrip() + '\n' for line in headline.splitlines())
    apart = bool(text)
    for key, data in sections.items():
        block = isinstance(data, Mapping)
        text += '\n' if text and (apart or block) else ''
        text += yaml.serialize(
            _node({key: data}), Dumper=_Dumper, allow_unicode=True, width=_WIDTH
        )
        apart = block
    return text


class _Dumper(yaml.BaseDumper):
    """Indents lists below their key."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)


def _node(data: Data) -> yaml.Node:
    if isinstance(data, str):
        return yaml.ScalarNode(f'{_TAG}str', data)
    if isinstance(data, Mapping):
        pairs = [(_node(key), _node(value)) for key, value in data.items()]
        return yaml.MappingNode(f'{_TAG}map', pairs, flow_style=isinstance(data, Inline))
    table = any(isinstance(item, list) for item in data)
    return yaml.SequenceNode(f'{_TAG}seq', [_node(item) for item in data], flow_style=not table)
