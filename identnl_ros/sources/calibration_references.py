# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensors that a calibration trusts, and how well their gains are known."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
import math

from identnl_ros.core.calibration.findings import Findings, Property
from identnl_ros.core.calibration.known_input import channel_of
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout


@dataclass(frozen=True)
class ReferenceUncertainty:
    """
    How well gains of references are known.

    Parameters
    ----------
    sensors : str
        A name, a pattern such as ``knee_a*``, or a kind.
    relative_error : float
        Standard uncertainty of the gain over it.
    standard : str
        What the uncertainty comes from, which others may have in common; empty: every sensor
        has its own.

    """

    sensors: str
    relative_error: float
    standard: str = ''


def meant_sensors(layout: Layout, names: Iterable[str]) -> tuple[str, ...]:
    """
    Find the sensors that names, patterns and kinds mean.

    Parameters
    ----------
    layout : Layout
    names : iterable of str

    Returns
    -------
    tuple of str

    Raises
    ------
    DataError
        If a name means none.

    """
    found: dict[str, None] = {}
    for name in names:
        chosen = [
            sensor.name
            for sensor in layout.sensors
            if fnmatchcase(sensor.name, name) or sensor.kind.value == name
        ]
        if not chosen:
            channel_of(layout, name)
        found |= dict.fromkeys(chosen)
    return tuple(found)


def gain_errors(
    layout: Layout, uncertainties: Iterable[ReferenceUncertainty], trusted: Collection[str]
) -> dict[str, dict[str, float]]:
    """
    Collect the uncertainties of gains that are given.

    Parameters
    ----------
    layout : Layout
    uncertainties : iterable of ReferenceUncertainty
        Several of one sensor add up.
    trusted : collection of str
        Sensors whose gains are used.

    Returns
    -------
    dict of str to dict of str to float
        Relative errors by sensor and by what they come from.

    Raises
    ------
    DataError
        If a sensor is not trusted, so that its uncertainty would count for nothing.

    """
    errors: dict[str, dict[str, float]] = {}
    for one in uncertainties:
        for name in meant_sensors(layout, [one.sensors]):
            if name not in trusted:
                raise DataError(
                    f'{name}: an uncertainty is given, but the sensor is no reference, no '
                    'accelerometer on a known mass and no cell that is shaken alone; leave it '
                    'out, or name it as a reference'
                )
            of_sensor = errors.setdefault(name, {})
            source = one.standard or f'gain of {name}'
            of_sensor[source] = math.hypot(of_sensor.get(source, 0.0), one.relative_error)
    return errors


def errors_found(findings: Findings) -> dict[str, dict[str, float]]:
    """
    Collect the uncertainties of gains that were calibrated.

    Parameters
    ----------
    findings : Findings

    Returns
    -------
    dict of str to dict of str to float
        Relative errors by sensor and by what they come from.

    """
    return {
        one.sensor: one.relative_errors for one in findings.calibrated if one.what is Property.GAIN
    }
