# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A planned run as tables for people, in daN and micrometres."""

from collections.abc import Sequence
import math

from identnl_ros.core.design.design import Expectation, Outlook
from identnl_ros.core.design.plan_search import Comparison
from identnl_ros.core.design.sensor_choice import SensorImportance
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.reports.design_advice import (
    advice_on_comparison,
    advice_on_run,
    force_in_words,
    percent,
    plan_in_words,
    remarks,
    sensors_in_words,
    short_name,
    time_in_words,
)
from identnl_ros.reports.paper_units import readable_unit
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

SENSORS_SHOWN = 10


def show_design(
    outlook: Outlook,
    layout: Layout,
    importances: Sequence[SensorImportance],
    console: Console,
    comparison: Comparison | None = None,
) -> None:
    """
    Print what a planned run would tell, and the advice.

    Parameters
    ----------
    outlook : Outlook
    layout : Layout
    importances : sequence of SensorImportance
        The most important first.
    console : rich.console.Console
    comparison : Comparison or None
        That the plan is the best of.

    """
    if comparison is not None:
        console.print(_plans(comparison))
    wanted = None if comparison is None else comparison.wanted
    title = f'Expected of: {plan_in_words(outlook.plan)}'
    console.print(_parameters(title, outlook.expectation, wanted))
    console.print(_sensors(importances, layout))
    advice = advice_on_run(outlook) if comparison is None else advice_on_comparison(comparison)
    for line in (*sensors_in_words(importances, layout), *remarks(outlook)):
        console.print(line, markup=False, highlight=False)
    for failure in () if comparison is None else comparison.failures:
        console.print(f'Not compared: {failure}', markup=False, highlight=False)
    console.print()
    console.print(advice, markup=False, style='bold', highlight=False)


def _parameters(title: str, expected: Expectation, wanted: float | None) -> Table:
    table = _table(title)
    table.add_column('parameter', no_wrap=True)
    table.add_column('unit', no_wrap=True)
    for heading in ('value', 'std error', '%'):
        table.add_column(heading, justify='right', no_wrap=True)
    table.add_column('identifiable', no_wrap=True)
    for one in expected.parameters:
        unit = readable_unit(one.unit, one.value)
        enough = one.relative <= (1.0 if wanted is None else wanted) or not one.value
        relative = _significant(100 * one.relative)
        table.add_row(
            escape(short_name(one)),
            unit.name,
            f'{one.value / unit.size:.6g}',
            _significant(one.standard_deviation / unit.size),
            relative if enough else f'[red]{relative}[/]',
            'yes' if one.identifiable else '[bold red]no[/]',
        )
    return table


def _plans(comparison: Comparison) -> Table:
    table = _table(f'Plans compared: every parameter under {percent(comparison.wanted)}')
    table.add_column('plan', no_wrap=True)
    for heading in ('peak daN', 'error in 1 s', 'needs'):
        table.add_column(heading, justify='right', no_wrap=True)
    table.add_column('bottleneck', no_wrap=True)
    for one in comparison.candidates:
        plan, expected = one.outlook.plan, one.outlook.expectation
        lost = sum(not parameter.identifiable for parameter in expected.parameters)
        bottleneck = short_name(expected.bottleneck) if expected.bottleneck else '-'
        remark = '' if plan.advisable else ' *'
        chosen = one is comparison.best and comparison.met
        table.add_row(
            escape(force_in_words(plan)) + remark,
            f'{max(plan.peak_forces().values()) / 10:.3g}',
            percent(expected.repeated(1 / plan.duration).worst),
            time_in_words(one.needed) if math.isfinite(one.needed) else 'no time',
            f'{lost} not identifiable' if lost else escape(bottleneck),
            style='bold' if chosen else None,
        )
    if not all(one.outlook.plan.advisable for one in comparison.candidates):
        table.caption = '* stronger than the machine file says: see --largest-amplitude'
    return table


def _sensors(importances: Sequence[SensorImportance], layout: Layout) -> Table:
    shown = importances[:SENSORS_SHOWN]
    first = f', the first {len(shown)}' if len(shown) < len(importances) else ''
    table = _table(f'Without one sensor{first}')
    table.add_column('sensor', no_wrap=True)
    table.add_column('largest error grows by', justify='right', no_wrap=True)
    for one in shown:
        growth = percent(one.growth) if math.isfinite(one.growth) else 'not identifiable'
        table.add_row(escape(layout.sensors[one.channel].name), growth)
    return table


def _table(title: str) -> Table:
    return Table(
        title=title, title_justify='left', caption_justify='left', box=SIMPLE_HEAD,
        pad_edge=False, padding=(0, 1, 0, 0),
    )  # fmt: skip


def _significant(value: float) -> str:
    return '-' if math.isnan(value) else f'{value:.3g}'
