# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A number, text or choice that the user sets, with all that a tool has to show of it."""

from dataclasses import dataclass
from typing import Any


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
        if self.choices and value not in self.choices:
            return f'{self.name} is "{value}", expected one of: {", ".join(self.choices)}'
        return ''
