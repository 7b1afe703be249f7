# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A validation as tables for people: micrometres, percent, and a verdict in words."""

from collections.abc import Iterator, Sequence
import math

from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.validation.agreement import (
    Agreement,
    FALSE_ALARM_RATE,
    ScaleTest,
    StreamComparison,
)
from identnl_ros.reports.paper_units import PaperUnit
from identnl_ros.reports.validation_document import AGREES, DIFFERS, verdict
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

_UNITS = {
    SensorKind.DISPLACEMENT: PaperUnit('µm', 1e-6),
    SensorKind.VELOCITY: PaperUnit('mm/s', 1e-3),
}


def show_validation(agreement: Agreement, notes: Sequence[str], console: Console) -> None:
    """
    Print the tables of one validation, the verdict and what bears on its trust.

    Parameters
    ----------
    agreement : Agreement
    notes : sequence of str
    console : rich.console.Console

    """
    for i, stream in enumerate(agreement.streams, start=1):
        for table in _tables(agreement, stream):
            console.print(table)
        many = f'Stream {i}: ' if len(agreement.streams) > 1 else ''
        console.print(
            f'{many}{stream.samples} samples in {stream.runs} '
            f'{"run" if stream.runs == 1 else "runs"} at {stream.sample_rate:g} Hz'
        )
    for sentence in _where(agreement):
        console.print(sentence, markup=False)
    for i, note in enumerate(notes, start=1):
        console.print(f'[{i}] {note}', markup=False)
    if agreement.agrees:
        console.print(
            f'[bold green]The model {AGREES}[/]: nothing beyond what the noise of the sensors '
            'and the uncertainty of parameters and force explain.'
        )
    else:
        console.print(
            f'[bold red]The model {DIFFERS}[/] from the measurement. A right one would be told '
            f'to differ in {FALSE_ALARM_RATE:.0%} of all cases.'
        )


def _tables(agreement: Agreement, stream: StreamComparison) -> Iterator[Table]:
    """Yield a table for every kind of sensor."""
    for kind in dict.fromkeys(channel.sensor.kind for channel in stream.channels):
        unit = _UNITS.get(kind, PaperUnit(kind.unit.replace('^2', '²'), 1.0))
        table = Table(
            title=escape(f'{kind.value.capitalize()} [{unit.name}]'), title_justify='left',
            box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0),
        )  # fmt: skip
        table.add_column('sensor')
        for heading in ('error', 'noise', 'band', 'NRMSE %', 'floor %', 'ratio'):
            table.add_column(heading, justify='right', no_wrap=True)
        table.add_column('verdict', no_wrap=True)
        for channel in stream.channels:
            if channel.sensor.kind is not kind:
                continue
            words = verdict(agreement, channel)
            table.add_row(
                escape(channel.sensor.name),
                *(
                    _significant(value / unit.size)
                    for value in (channel.error, channel.noise, channel.band)
                ),
                _significant(100 * channel.nrmse),
                _significant(100 * channel.floor),
                _significant(channel.ratio),
                'agrees' if words == AGREES else f'[bold red]{words}[/]',
            )
        yield table


def _where(agreement: Agreement) -> list[str]:
    """Say of the worst sensor, and of all together, what differs."""
    sentences = []
    for stream in agreement.streams:
        wrong = [one for one in stream.channels if agreement.differs(one.tests)]
        # The most improbable one; of those beyond all numbers, the farthest off.
        wrong.sort(key=lambda one: (one.worst.probability, -one.worst.ratio) if one.worst else ())
        if wrong and wrong[0].worst is not None:
            sentences.append(
                f'{len(wrong)} of {len(stream.channels)} sensors differ, most clearly '
                f'{wrong[0].sensor.name}: {_described(wrong[0].worst, stream.sample_rate)}.'
            )
        elif agreement.differs(stream.joint_tests):
            worst = min(stream.joint_tests, key=lambda one: (one.probability, -one.ratio))
            sentences.append(
                'No sensor differs by itself, all together do: '
                f'{_described(worst, stream.sample_rate)}.'
            )
    return sentences


def _described(test: ScaleTest, sample_rate: float) -> str:
    what = (
        'its error is'
        if test.average == 1
        else f'averaged over {1e3 * test.average / sample_rate:.3g} ms ({test.average} samples), '
        'its error is'
    )
    allowed = 'noise and force explain, whatever the parameters are within their uncertainty'
    return (
        f'{what} {test.ratio:.3g} times what '
        f'{allowed if test.beyond_band else "noise, band and force explain"} '
        f'(probability {test.probability:.1g})'
    )


def _significant(value: float) -> str:
    return '-' if not math.isfinite(value) else f'{value:.3g}'
