# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A number, text or choice that the user sets, with all that a tool has to show of it."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

_TYPES = {
    bool: 'true or false',
    int: 'a whole number',
    float: 'a number',
    str: 'a text',
    list: 'a list of texts',
}


@dataclass(frozen=True)
class Setting:
    """
    One parameter of a node or of a source.

    Parameters
    ----------
    name : str
    default : bool, int, float, str or list of str
        Also tells the type.
    description : str
        With the unit.
    lowest, highest : float or None
        Range of a number; None: not a number.
    choices : tuple of str
        What a text may be; empty: anything.
    live : bool
        May change while the node is configured; else it counts from the next configuration on.
    read_only : bool
        Can only be set as the node starts.

    """

    name: str
    default: Any
    description: str
    lowest: float | None = None
    highest: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False
    read_only: bool = False

    def converted(self, value: Any) -> Any:
        """
        Take what people write for what is meant: 2 and "1e3" are numbers, a text a list of one.

        Parameters
        ----------
        value : object

        Returns
        -------
        object

        """
        if isinstance(self.default, float) and type(value) in (int, str):
            with suppress(ValueError):  # YAML takes 1e3 for a text
                return float(value)
        if isinstance(self.default, list) and isinstance(value, str):
            return [value]
        return value

    def refusal(self, value: Any) -> str:
        """
        Say why a value cannot be taken.

        Parameters
        ----------
        value : object

        Returns
        -------
        str
            Empty: it can.

        """
        expected = ''
        if type(value) is not type(self.default):
            expected = _TYPES[type(self.default)]
        elif self.choices and value not in self.choices:
            expected = f'one of: {", ".join(self.choices)}'
        elif isinstance(value, list):
            expected = '' if all(isinstance(one, str) for one in value) else _TYPES[list]
        elif self.lowest is not None and self.highest is not None:
            within = self.lowest <= value <= self.highest
            expected = '' if within else f'{self.lowest:g} to {self.highest:g}'
        return f'{self.name} is {_shown(value)}, expected {expected}' if expected else ''


def without_empty(texts: Iterable[str]) -> tuple[str, ...]:
    """
    Take a list as people write it: an empty text in it, or blanks around one, mean nothing.

    Parameters
    ----------
    texts : iterable of str

    Returns
    -------
    tuple of str

    """
    return tuple(text.strip() for text in texts if text.strip())


def _shown(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)
