# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers of a machine that are known, to be estimated, or tied to another number."""

from dataclasses import dataclass

from identnl_ros.core.errors import MachineError
import numpy as np


@dataclass(frozen=True)
class Tie:
    """
    A number that follows another one: ``number = times * other``.

    Parameters
    ----------
    same_as : str
        Name of the other parameter, e.g. ``slideway_6.normal_stiffness``.
    times : float
        Positive [-].

    Raises
    ------
    MachineError
        If the factor is not positive.

    """

    same_as: str
    times: float = 1.0

    def __post_init__(self) -> None:
        """Check the factor."""
        if not (np.isfinite(self.times) and self.times > 0):
            raise MachineError(
                f'the factor of a number that is the same as {self.same_as} is {self.times}, '
                'expected a positive number'
            )


@dataclass(frozen=True)
class Coefficient:
    """
    A number of the machine that is known, to be estimated, or tied to another one.

    Parameters
    ----------
    value : float
        SI; NaN when not known. For an estimated one: what the simulated stand uses and where
        iterations start. For a tied one it is not used: the value follows from the other.
    estimated : bool
        True: the identification treats it as unknown.
    tie : Tie or None
        What it follows; such a number is no unknown of its own.

    """

    value: float = float('nan')
    estimated: bool = False
    tie: Tie | None = None

    @property
    def absent(self) -> bool:
        """Known to be zero: the term does not exist."""
        return not self.estimated and self.tie is None and self.value == 0.0
