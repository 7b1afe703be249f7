# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Known inputs of sensors on the command line."""

import re
from typing import TYPE_CHECKING

from identnl_ros.core.errors import DataError

if TYPE_CHECKING:
    from identnl_ros.core.calibration.known_input import KnownAmplitude, KnownMass
    from identnl_ros.core.measurement.layout import Layout

_AMPLITUDE = re.compile(r'([^=]+)=([^@]+?)(?:\+-([^@]+))?(?:@(.+))?')
_MASS = re.compile(r'([^=]+)=([^:]+?)(?:\+-([^:]+))?:(.+)')


def amplitude(text: str, layout: 'Layout') -> 'KnownAmplitude':
    """
    Read what a calibrator does.

    Parameters
    ----------
    text : str
        E.g. ``ring=10 m/s^2 +- 1% @ 159.155 Hz``; uncertainty and frequency may be left out.
    layout : Layout

    Returns
    -------
    KnownAmplitude

    Raises
    ------
    DataError
        If it cannot be understood.

    """
    from identnl_ros.core.calibration.known_input import channel_of, KnownAmplitude

    match = _AMPLITUDE.fullmatch(text)
    if match is None:
        raise DataError(
            f'--known: found "{text}", expected SENSOR=AMPLITUDE, e.g. '
            '"ai3=10 m/s^2 +- 1% @ 159.155 Hz"'
        )
    name, value, error, frequency = (part and part.strip() for part in match.groups())
    unit = layout.sensors[channel_of(layout, name)].kind.unit
    return KnownAmplitude(
        name,
        _positive('--known', value, unit, f'an amplitude (rms) such as "10 {unit}"'),
        _positive('--known', frequency, 'Hz', 'a frequency such as "80 Hz"')
        if frequency
        else None,
        _positive('--known', error, '', 'an uncertainty such as "1 %"') if error else 0.0,
    )


def mass(text: str) -> 'KnownMass':
    """
    Read what hangs on a force cell.

    Parameters
    ----------
    text : str
        E.g. ``cell=5 kg +- 0.1%: ring_1, ring_2``; the uncertainty may be left out.

    Returns
    -------
    KnownMass

    Raises
    ------
    DataError
        If it cannot be understood.

    """
    from identnl_ros.core.calibration.known_input import KnownMass

    match = _MASS.fullmatch(text)
    if match is None:
        raise DataError(
            f'--known-mass: found "{text}", expected CELL=MASS:ACCELEROMETER,..., e.g. '
            '"cell=5 kg +- 0.1%: ring_1, ring_2"'
        )
    cell, value, error, names = match.groups()
    return KnownMass(
        cell.strip(),
        _positive('--known-mass', value, 'kg', 'a mass such as "5 kg"'),
        tuple(name.strip() for name in names.split(',')),
        _positive('--known-mass', error, '', 'an uncertainty such as "1 %"') if error else 0.0,
    )


def _positive(option: str, text: str, unit: str, expected: str) -> float:
    from identnl_ros.storage.quantities import Quantity

    try:
        value = Quantity(unit, expected).number(text.strip())
    except ValueError as error:
        raise DataError(f'{option}: {error}') from None
    if value <= 0:
        raise DataError(f'{option}: found "{text.strip()}", expected {expected}, more than 0')
    return value
