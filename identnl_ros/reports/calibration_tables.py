# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A calibration as tables for people."""

from collections.abc import Iterator
import math

from identnl_ros.core.calibration.findings import Calibrated, CONSPICUOUS, Findings, Property
from identnl_ros.core.calibration.quiet_record import QuietChannel
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.reports.calibration_document import towards, unit_of
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

_MOTION = (Property.GAIN, Property.DIRECTION, Property.DELAY, Property.FRONT_MASS)


def show_calibration(
    layout: Layout, findings: Findings, channels: tuple[QuietChannel, ...], console: Console
) -> None:
    """
    Print what was found, what was not, and what bears on trust.

    Parameters
    ----------
    layout : Layout
        Before the calibration.
    findings : Findings
    channels : tuple of QuietChannel
    console : rich.console.Console

    """
    sensors = {sensor.name: sensor for sensor in layout.sensors}
    found = [one for one in findings.calibrated if one.what in _MOTION]
    if found:
        console.print(_calibrated('Gain, direction, delay, front mass', found, sensors))
    if channels:
        rest = [one for one in findings.calibrated if one.what not in _MOTION]
        for table in _quiet(channels):
            console.print(table)
        console.print(_calibrated('Noise, resolution, offset', rest, sensors))
    for sentence in _undetermined(findings):
        console.print(sentence, markup=False)
    for i, remark in enumerate(findings.remarks, start=1):
        console.print(f'[{i}] {remark}', markup=False)
    wrong = sum(one.conspicuous for one in findings.calibrated if one.what in _MOTION)
    if wrong:
        console.print(
            f'{wrong} of {len(found)} gains, directions, delays and front masses differ from the '
            f'layout by more than {CONSPICUOUS:g} standard errors.'
        )
    for doubt in findings.doubts:
        console.print(f'[bold red]In doubt:[/] {escape(doubt)}')


def _calibrated(title: str, found: list[Calibrated], sensors: dict[str, Sensor]) -> Table:
    table = _table(title)
    table.add_column('sensor', no_wrap=True)
    table.add_column('what', no_wrap=True)
    for heading in ('layout', 'found', '+-'):
        table.add_column(heading, justify='right', no_wrap=True)
    table.add_column('unit', no_wrap=True)
    table.add_column('sigmas', justify='right', no_wrap=True)
    for one in found:
        unit, size = unit_of(one.what, sensors[one.sensor]), 1.0
        if one.what is Property.DIRECTION:
            unit, size = '°', math.degrees(1)
        if one.what is Property.DELAY:
            unit, size = 'µs', 1e6
        sigmas = '-' if math.isnan(one.deviation) else f'{one.deviation:.1f}'
        axis = f' to {towards(one)}' if towards(one) else ''
        table.add_row(
            escape(one.sensor),
            one.what.value.replace('_', ' ') + axis,
            _significant(one.before * size, 6),
            _significant(one.value * size, 6),
            _significant(one.standard_error * size, 2),
            escape(unit),
            f'[bold red]{sigmas}[/]' if one.conspicuous else sigmas,
        )
    return table


def _quiet(channels: tuple[QuietChannel, ...]) -> Iterator[Table]:
    """Yield a table for every kind of sensor."""
    for kind in dict.fromkeys(one.sensor.kind for one in channels):
        table = _table(escape(f'Quiet record: {kind.value} [{kind.unit}]'))
        table.add_column('sensor', no_wrap=True)
        for heading in ('noise', '+-', 'per √Hz', 'step', 'mean', '+-'):
            table.add_column(heading, justify='right', no_wrap=True)
        table.add_column('noise is', no_wrap=True)
        for one in channels:
            if one.sensor.kind is not kind:
                continue
            table.add_row(
                escape(one.sensor.name),
                _significant(one.noise, 3),
                _significant(one.noise * one.relative_error, 2),
                _significant(one.density, 3),
                _significant(one.resolution or math.nan, 3),
                _significant(one.mean, 3),
                _significant(one.mean_error, 2),
                'white' if one.white else 'not white',
            )
        yield table


def _undetermined(findings: Findings) -> Iterator[str]:
    """Say what stays as it is, sensors with one reason together."""
    groups: dict[tuple[Property, str], list[str]] = {}
    for one in findings.undetermined:
        groups.setdefault((one.what, one.reason), []).append(one.sensor)
    for (what, reason), names in groups.items():
        title = what.value.replace('_', ' ').capitalize()
        yield f'{title} left as it is ({reason}): {", ".join(names)}'


def _table(title: str) -> Table:
    return Table(
        title=title, title_justify='left', box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0)
    )


def _significant(value: float, digits: int) -> str:
    return '-' if not math.isfinite(value) else f'{value:.{digits}g}'
