# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A calibration as a document for programs."""

from typing import Any

from identnl_ros.core.calibration.findings import Calibrated, Findings, Property
from identnl_ros.core.calibration.quiet_record import QuietChannel
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.reports.estimate_document import number
import numpy as np

# Standard errors to either side of 95 % of a normal distribution.
INTERVAL = 1.96


def calibration_document(
    layout: Layout, findings: Findings, channels: tuple[QuietChannel, ...]
) -> dict[str, Any]:
    """
    Build the document of one calibration.

    Parameters
    ----------
    layout : Layout
        Before the calibration.
    findings : Findings
    channels : tuple of QuietChannel

    Returns
    -------
    dict
        Ready for json.dumps.

    """
    sensors = {sensor.name: sensor for sensor in layout.sensors}
    return {
        'agrees': not findings.doubts,
        'doubts': list(findings.doubts),
        'calibrated': [
            {
                'sensor': one.sensor,
                'property': one.what.value,
                'towards': towards(one) or None,
                'unit': unit_of(one.what, sensors[one.sensor]),
                'before': number(one.before),
                'value': number(one.value),
                'standard_error': number(one.standard_error),
                'interval': [
                    number(one.value + sign * INTERVAL * one.standard_error) for sign in (-1, 1)
                ],
                'shares': {name: number(share) for name, share in one.shares.items()},
                'deviation': number(one.deviation),
                'conspicuous': one.conspicuous,
            }
            for one in findings.calibrated
        ],
        'undetermined': [
            {'sensor': one.sensor, 'property': one.what.value, 'reason': one.reason}
            for one in findings.undetermined
        ],
        'quiet': [_quiet(one) for one in channels],
        'remarks': list(findings.remarks),
    }


def towards(one: Calibrated) -> str:
    """
    Name the axis of the machine that a direction's angle leans to.

    Parameters
    ----------
    one : Calibrated

    Returns
    -------
    str
        ``x``, ``y`` or ``z``; empty where it is no direction.

    """
    if one.what is not Property.DIRECTION:
        return ''
    return 'xyz'[int(np.argmax(np.abs(one.axis)))]


def unit_of(what: Property, sensor: Sensor) -> str:
    """
    Give the unit of a calibrated number.

    Parameters
    ----------
    what : Property
    sensor : Sensor

    Returns
    -------
    str

    """
    recorded, unit = sensor.recorded_unit, sensor.kind.unit
    return {
        Property.GAIN: '1' if recorded == unit else f'({recorded})/({unit})',
        Property.DIRECTION: 'rad',
        Property.DELAY: 's',
        Property.OFFSET: recorded,
        Property.FRONT_MASS: 'kg',
    }.get(what, unit)


def _quiet(one: QuietChannel) -> dict[str, Any]:
    """Write what a quiet record shows, SI by the gain that the layout had."""
    return {
        'sensor': one.sensor.name,
        'unit': one.sensor.kind.unit,
        'noise': number(one.noise),
        'noise_interval': [
            number(one.noise * (1 + sign * INTERVAL * one.relative_error)) for sign in (-1, 1)
        ],
        'noise_density': number(one.density),
        'white': one.white,
        'resolution': number(one.resolution),
        'mean': number(one.mean),
        'mean_standard_error': number(one.mean_error),
        'drift': number(one.drift),
        'drift_standard_error': number(one.drift_error),
        'lines': [
            {'frequency': line.frequency, 'amplitude': number(line.amplitude)}
            for line in one.lines
        ],
        'low_frequency': one.low_frequency,
    }
