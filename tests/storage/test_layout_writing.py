# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Layouts written as files: read again, they are the same to the last bit."""

from dataclasses import fields
from pathlib import Path

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.storage.layout_file import load_layout, read_layout
from identnl_ros.storage.layout_writing import layout_text
import numpy as np
import pytest

CONFIG = Path(__file__).parents[2] / 'config'
LAYOUTS = sorted(CONFIG.glob('*_layout.yaml'))

EVERYTHING = """\
stand: everything
sample_rate: 610.3515625 Hz
gravity: [0, 0.3, -9.79]
sensors:
  cell: {kind: force, excitation: shaker, unit: daN, gain: 0.983, offset: -3}
  strange: {kind: force, excitation: shaker, unit: count, gain: 13.7 count/N, noise: 0}
  probe: {kind: displacement, body: block, relative_to: table, point: [0.1, 20 cm, 300 mm],
          direction: [0.3, -0.7, 0.2], unit: um, gain: -1.013, noise: 10 nm, resolution: 3 nm,
          full_scale: 0.41 mm}
  laser: {kind: velocity, body: block, point: [0, 0, 0], direction: -y, unit: mV,
          gain: 0.5 V/(mm/s), delay: -25 us, column: 'Voltage: 3 (mV)'}
  accelerometer: {kind: acceleration, body: block, point: [0, 0, 0], direction: [0, 3, 4],
          unit: '%', gain: 1.7 %/(m/s^2), offset: 20, drift: -0.3 %/s, noise: 0.1 %,
          resolution: 0.002 m/s^2, dropout_probability: 0.1 %, full_scale: 70, reads_gravity: true}
  impedance_head: {kind: force, excitation: shaker, unit: pC, gain: 4 pC/N, front_mass: 13.7 g}
"""


def written(layout):
    return read_layout(layout_text(layout, 'written'), 'written')


def assert_same(layout, other):
    assert (layout.stand, layout.sample_rate) == (other.stand, other.sample_rate)
    assert len(layout.sensors) == len(other.sensors)
    np.testing.assert_array_equal(layout.gravity, other.gravity)
    for sensor, again in zip(layout.sensors, other.sensors, strict=True):
        for field in fields(Sensor):
            np.testing.assert_array_equal(
                getattr(sensor, field.name), getattr(again, field.name), err_msg=field.name
            )


@pytest.mark.parametrize('path', LAYOUTS, ids=lambda path: path.stem)
def test_shipped_layouts_come_back(path):
    layout = load_layout(path).layout
    assert_same(layout, written(layout))


def test_all_that_a_file_can_say_comes_back():
    layout = read_layout(EVERYTHING, 'everything')
    assert_same(layout, written(layout))
    assert {sensor.kind for sensor in layout.sensors} == set(SensorKind)


def test_written_text_is_short_and_in_the_usual_order():
    assert layout_text(read_layout(EVERYTHING, 'everything'), 'One\ntwo').startswith(
        """\
# One
# two

stand: everything
sample_rate: 610.3515625
gravity: [0, 0.3, -9.79]

sensors:
  cell:
    kind: force
    excitation: shaker
    unit: daN
    gain: 0.983
    offset: -3
  strange:
    kind: force
    excitation: shaker
    unit: count
    gain: 13.7 count/N
    noise: 0
"""
    )


def test_layouts_without_a_file_come_back():
    generator = np.random.default_rng(2)
    sensors = tuple(
        Sensor(
            f'{unit}_{i}', SensorKind.ACCELERATION, 'block', *generator.normal(size=(2, 3)),
            recorded_unit=unit, gain=generator.normal(), noise=generator.uniform(),
        )
        for i in range(10)
        for unit in ('V', 'mV')
    )  # fmt: skip
    layout = Layout(sensors)
    assert_same(layout, written(layout))


def test_an_unknown_unit_cannot_be_written():
    sensor = Sensor('cell', SensorKind.FORCE, excitation='shaker', recorded_unit='furlongish')
    with pytest.raises(LayoutError, match=r'^sensor cell: "furlongish" is no known unit$'):
        layout_text(Layout((sensor,)), '')
