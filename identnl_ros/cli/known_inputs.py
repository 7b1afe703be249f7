# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Known inputs of sensors on the command line."""

import re
from typing import TYPE_CHECKING

from identnl_ros.core.errors import DataError

if TYPE_CHECKING:
    from identnl_ros.core.calibration.force_cell import KnownMass
    from identnl_ros.core.calibration.known_input import KnownAmplitude
    from identnl_ros.core.measurement.layout import Layout
    from identnl_ros.sources.calibration_references import ReferenceUncertainty

# 1 %, or 1 % of a standard that others have in common.
_UNCERTAINTY = r'([^=@:]+?)(?:\s+of\s+([^=@:]+))?'
_AMPLITUDE = re.compile(rf'([^=]+)=([^@]+?)(?:\+-{_UNCERTAINTY})?(?:@(.+))?')
_MASS = re.compile(rf'([^=]+)=([^:]+?)(?:\+-{_UNCERTAINTY})?:(.+)')
_REFERENCE = re.compile(rf'([^=]+)={_UNCERTAINTY}')


def amplitude(text: str, layout: 'Layout') -> 'KnownAmplitude':
    """
    Read what a calibrator does.

    Parameters
    ----------
    text : str
        E.g. ``ring=10 m/s^2 +- 1% of calibrator @ 159.155 Hz``; uncertainty, its standard and
        frequency may be left out.
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
    name, value, error, standard, frequency = (part and part.strip() for part in match.groups())
    unit = layout.sensors[channel_of(layout, name)].kind.unit
    return KnownAmplitude(
        name,
        _positive('--known', value, unit, f'an amplitude (rms) such as "10 {unit}"'),
        _positive('--known', frequency, 'Hz', 'a frequency such as "80 Hz"')
        if frequency
        else None,
        _positive('--known', error, '', 'an uncertainty such as "1 %"') if error else 0.0,
        standard or '',
    )


def mass(text: str) -> 'KnownMass':
    """
    Read what hangs on a force cell.

    Parameters
    ----------
    text : str
        E.g. ``cell=5 kg +- 0.1% of scale: ring_1, ring_2``; the uncertainty and its standard may
        be left out. 0 kg: nothing hangs there.

    Returns
    -------
    KnownMass

    Raises
    ------
    DataError
        If it cannot be understood.

    """
    from identnl_ros.core.calibration.force_cell import KnownMass

    match = _MASS.fullmatch(text)
    if match is None:
        raise DataError(
            f'--known-mass: found "{text}", expected CELL=MASS:ACCELEROMETER,..., e.g. '
            '"cell=5 kg +- 0.1%: ring_1, ring_2"'
        )
    cell, value, error, standard, names = match.groups()
    return KnownMass(
        cell.strip(),
        _positive('--known-mass', value, 'kg', 'a mass such as "5 kg"', or_zero=True),
        tuple(name.strip() for name in names.split(',')),
        _positive('--known-mass', error, '', 'an uncertainty such as "1 %"') if error else 0.0,
        (standard or '').strip(),
    )


def reference_uncertainty(text: str) -> 'ReferenceUncertainty':
    """
    Read how well the gain of a reference is known.

    Parameters
    ----------
    text : str
        E.g. ``probe=0.5 %``, or ``displacement=0.5 % of laser``, by which all share one error.

    Returns
    -------
    ReferenceUncertainty

    Raises
    ------
    DataError
        If it cannot be understood.

    """
    from identnl_ros.sources.calibration_references import ReferenceUncertainty

    match = _REFERENCE.fullmatch(text)
    if match is None:
        raise DataError(
            f'--reference-uncertainty: found "{text}", expected SENSOR=UNCERTAINTY, e.g. '
            '"probe=0.5 %" or "displacement=0.5 % of laser"'
        )
    sensors, error, standard = match.groups()
    return ReferenceUncertainty(
        sensors.strip(),
        _positive('--reference-uncertainty', error, '', 'an uncertainty such as "1 %"'),
        (standard or '').strip(),
    )


def _positive(option: str, text: str, unit: str, expected: str, or_zero: bool = False) -> float:
    from identnl_ros.storage.quantities import Quantity

    try:
        value = Quantity(unit, expected).number(text.strip())
    except ValueError as error:
        raise DataError(f'{option}: {error}') from None
    if value < 0 or (value == 0 and not or_zero):
        least = 'at least 0' if or_zero else 'more than 0'
        raise DataError(f'{option}: found "{text.strip()}", expected {expected}, {least}')
    return value
