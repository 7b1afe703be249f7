# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers with prefixes, for people."""

import math

_PREFIXES = ((1.0, ''), (1e-3, 'm'), (1e-6, 'u'), (1e-9, 'n'), (1e-12, 'p'))


def readable(value: float, unit: str, digits: int = 3) -> str:
    """
    Write a number with a prefix people use.

    Parameters
    ----------
    value : float
    unit : str
        SI.
    digits : int

    Returns
    -------
    str

    """
    if not math.isfinite(value) or value == 0:
        return f'{value:g} {unit}'.strip()
    factor, prefix = next(
        (pair for pair in _PREFIXES if abs(value) >= 0.9995 * pair[0]), _PREFIXES[-1]
    )
    rounded = float(f'{value / factor:.{digits}g}')
    return f'{rounded:g} {prefix}{unit}'
