# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The units in which machine-tool engineers read stiffness: daN and micrometres."""

from dataclasses import dataclass
import math
import re

_FORCE_PER_LENGTH = re.compile(r'N(?:/m(?:\^(?P<power>[\d.]+))?)?')


@dataclass(frozen=True)
class PaperUnit:
    """
    A unit for people and its size.

    Parameters
    ----------
    name : str
    size : float
        In the SI unit that it stands for.

    """

    name: str
    size: float


def paper_unit(si_unit: str) -> PaperUnit:
    """
    Choose the unit in which to show a quantity.

    Parameters
    ----------
    si_unit : str
        E.g. ``N/m^2``.

    Returns
    -------
    PaperUnit
        E.g. daN/µm²; the SI unit itself where the literature has no other.

    """
    match = _FORCE_PER_LENGTH.fullmatch(si_unit)
    if match is None:
        return PaperUnit(si_unit, 1.0)
    if si_unit == 'N':
        return PaperUnit('daN', 10.0)
    power = float(match['power'] or 1)
    suffix = {1.0: '', 2.0: '²', 3.0: '³'}.get(power, f'^{power:g}')
    return PaperUnit(f'daN/µm{suffix}', 10.0 * 10 ** (6 * power))


def readable_unit(si_unit: str, value: float) -> PaperUnit:
    """
    Choose the paper's unit where it gives a number that can be read, else the SI unit.

    Parameters
    ----------
    si_unit : str
    value : float
        [si_unit].

    Returns
    -------
    PaperUnit

    """
    unit = paper_unit(si_unit)
    size = abs(value) / unit.size
    readable = not size or not math.isfinite(size) or 1e-6 <= size < 1e7
    return unit if readable else PaperUnit(si_unit, 1.0)
