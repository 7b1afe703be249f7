# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers for people: daN and micrometres."""

from identnl_ros.reports.estimate_document import number
from identnl_ros.reports.paper_units import paper_unit, readable_unit
import pytest


@pytest.mark.parametrize(
    ('si_unit', 'si_value', 'name', 'value'),
    [
        ('N/m^2', 3.8e15, 'daN/µm²', 380),
        ('N/m', 1.5e8, 'daN/µm', 15),
        ('N', 1000.0, 'daN', 100),
        ('N/m^1.8', 10 * 10**10.8, 'daN/µm^1.8', 1),
        ('kg', 900.0, 'kg', 900),
        ('N*s/m', 8e3, 'N*s/m', 8e3),
        ('N*m', 5.0, 'N*m', 5),
    ],
)
def test_unit_of_the_paper(si_unit, si_value, name, value):
    unit = paper_unit(si_unit)
    assert unit.name == name
    assert si_value / unit.size == pytest.approx(value)


def test_unreadable_size_stays_in_si():
    assert readable_unit('N/m^3', 4.0).name == 'N/m^3'
    assert readable_unit('N/m^2', 3.8e15).name == 'daN/µm²'


def test_json_knows_no_nan():
    assert number(float('nan')) is None
    assert number(float('inf')) is None
    assert number(2) == 2.0
