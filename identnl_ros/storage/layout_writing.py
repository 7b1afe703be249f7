# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensor layouts as text of a layout file."""

import math
import re

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.mechanics.machine import STANDARD_GRAVITY
from identnl_ros.storage.layout_file import read_layout
from identnl_ros.storage.quantities import convert, same_dimension, UnitError
from identnl_ros.storage.yaml_reading import KIND
from identnl_ros.storage.yaml_writing import Data, direction, number, vector, yaml_text
import numpy as np


def layout_text(layout: Layout, headline: str) -> str:
    """
    Write a layout as text of a layout file, without defaults for kinds of sensors.

    Numbers are bare SI; an offset is in the recorded unit, a gain to a recorded unit of another
    dimension has its unit.

    Parameters
    ----------
    layout : Layout
    headline : str
        Comment on top, of any number of lines.

    Returns
    -------
    str

    Raises
    ------
    LayoutError
        If the result is nothing that a layout file can say, e.g. a recorded unit is unknown.

    """
    sections: dict[str, Data] = {'stand': layout.stand}
    if layout.sample_rate is not None:
        sections['sample_rate'] = number(layout.sample_rate)
    if not np.array_equal(layout.gravity, STANDARD_GRAVITY):
        sections['gravity'] = vector(layout.gravity)
    sections['sensors'] = {sensor.name: _sensor(sensor) for sensor in layout.sensors}
    text = yaml_text(headline, sections)
    read_layout(text, f'layout {layout.stand} as written')
    return text


def _sensor(sensor: Sensor) -> Data:
    data: dict[str, Data] = {KIND: sensor.kind.value, **_place(sensor)}
    if sensor.column != sensor.name:
        data['column'] = sensor.column
    return data | _recording(sensor) | _quality(sensor)


def _place(sensor: Sensor) -> dict[str, Data]:
    if sensor.kind is SensorKind.FORCE:
        front = {'front_mass': number(sensor.front_mass)} if sensor.front_mass else {}
        return {'excitation': sensor.excitation, **front}
    relative = {'relative_to': sensor.reference_body} if sensor.reference_body else {}
    return {
        'body': sensor.body,
        **relative,
        'point': vector(sensor.point),
        'direction': direction(sensor.direction),
        **({'reads_gravity': 'true'} if sensor.reads_gravity else {}),
    }


def _recording(sensor: Sensor) -> dict[str, Data]:
    """Write unit and gain."""
    unit = sensor.recorded_unit
    try:
        if same_dimension(unit, sensor.kind.unit):
            correction = _correction(sensor.gain, convert(1.0, sensor.kind.unit, unit))
            gain = '' if correction == 1 else number(correction)
        else:
            gain = f'{number(sensor.gain)} {_factor(unit)}/{_factor(sensor.kind.unit)}'
    except UnitError:
        raise LayoutError(f'sensor {sensor.name}: "{unit}" is no known unit') from None
    return {'unit': unit, 'gain': gain} if gain else {'unit': unit}


def _correction(gain: float, of_unit: float) -> float:
    """Return the factor on the gain of the unit that gives a gain to the last bit, if one does."""
    near = gain / of_unit
    candidates = near, math.nextafter(near, math.inf), math.nextafter(near, -math.inf)
    return next((one for one in candidates if of_unit * one == gain), near)


def _factor(unit: str) -> str:
    return unit if re.fullmatch(r'\w+', unit) else f'({unit})'


def _quality(sensor: Sensor) -> dict[str, Data]:
    """How well it measures; no noise: not known."""
    numbers = {
        'offset': sensor.offset,
        'drift': sensor.drift,
        'delay': sensor.delay,
        'noise': sensor.noise,
        'resolution': sensor.resolution,
        'dropout_probability': sensor.dropout_probability,
    }
    absent = {key: math.isnan(one) if key == 'noise' else one == 0 for key, one in numbers.items()}
    written: dict[str, Data] = {
        key: number(one) for key, one in numbers.items() if not absent[key]
    }
    if not math.isnan(sensor.full_scale):
        written['full_scale'] = f'{number(sensor.full_scale)} {sensor.recorded_unit}'
    return written
