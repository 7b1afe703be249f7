# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as tables for people, on the screen and in Markdown."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import math

from identnl_ros.core.discrepancy.checked_diagnosis import CheckedDiagnosis
from identnl_ros.core.discrepancy.held_out import HeldOutError
from identnl_ros.core.discrepancy.library import EFFECTS
from identnl_ros.core.discrepancy.named_effect import NamedEffect
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.reports.diagnosis_document import summary
from identnl_ros.reports.paper_units import PaperUnit, readable_unit
from identnl_ros.reports.splitting_test import splitting_test
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

_UNITS = {
    SensorKind.DISPLACEMENT: PaperUnit('µm', 1e-6),
    SensorKind.VELOCITY: PaperUnit('mm/s', 1e-3),
}
_TITLES = {effect.name: effect.title for effect in EFFECTS}


@dataclass(frozen=True)
class Sheet:
    """
    One table.

    Parameters
    ----------
    title : str
    headings : tuple of str
    rows : tuple of tuple of str
    words : int
        So many columns, from the left, are words; the others are numbers.

    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int


def show_diagnosis(result: CheckedDiagnosis, console: Console) -> None:
    """
    Print the paragraph and the tables of one diagnosis.

    Parameters
    ----------
    result : CheckedDiagnosis
    console : rich.console.Console

    """
    console.print(summary(result), markup=False, highlight=False, soft_wrap=True)
    for sheet in sheets(result):
        table = Table(
            title=escape(sheet.title), title_justify='left', box=SIMPLE_HEAD, pad_edge=False,
            padding=(0, 1, 0, 0),
        )  # fmt: skip
        for i, heading in enumerate(sheet.headings):
            number = i >= sheet.words
            table.add_column(heading, justify='right' if number else 'left', no_wrap=number)
        for row in sheet.rows:
            table.add_row(*(escape(cell) for cell in row))
        console.print(table)


def diagnosis_markdown(result: CheckedDiagnosis, plots: Mapping[str, str]) -> Iterator[str]:
    """
    Write a diagnosis as a Markdown document.

    Parameters
    ----------
    result : CheckedDiagnosis
    plots : mapping of str to str
        What is seen in each plot, by the name of its file beside the document.

    Yields
    ------
    str

    """
    yield f'# Diagnosis of {result.machine.name}\n\n{summary(result)}\n'
    for sheet in sheets(result):
        yield f'\n## {sheet.title}\n\n'
        yield _line(sheet.headings)
        yield _line(['---' if i < sheet.words else '---:' for i in range(len(sheet.headings))])
        for row in sheet.rows:
            yield _line([cell.replace('|', '\\|').replace('\n', '<br>') for cell in row])
    for name, words in plots.items():
        yield f'\n## {words}\n\n![{words}]({name})\n'


def sheets(result: CheckedDiagnosis) -> Iterator[Sheet]:
    """
    Build the tables of one diagnosis.

    Parameters
    ----------
    result : CheckedDiagnosis

    Yields
    ------
    Sheet

    """
    diagnosis = result.diagnosis
    if diagnosis.named:
        yield Sheet(
            'What is missing', ('effect', 'place', 'parameters', 'p-value', 'not told from'),
            tuple(_found(one) for one in diagnosis.named), 5,
        )  # fmt: skip
    before, after = result.before, result.after
    rows = [
        (
            'relative to the signal [%]',
            *(_percent(x) for x in (before.response, after.response, after.noise_floor)),
        ),
        (
            'force unexplained, relative to the exciters [%]',
            *(
                _percent(x)
                for x in (before.force.relative, after.force.relative, after.force.noise_floor)
            ),
        ),
    ]
    for kind in dict.fromkeys(after.kinds.values()):
        unit = _UNITS.get(kind, PaperUnit(kind.unit.replace('^2', '²'), 1.0))
        sizes = _size(before, kind, 0), _size(after, kind, 0), _size(after, kind, 1)
        rows.append(
            (f'{kind.value} [{unit.name}]', *(_significant(size / unit.size) for size in sizes))
        )
    yield Sheet(
        'Error on held-out data, root mean square',
        ('', 'before', 'after', 'sensor noise'), tuple(rows), 1,
    )  # fmt: skip
    if diagnosis.detectable:
        yield Sheet(
            'Smallest sizes that this record would have shown',
            ('effect', 'best place', 'size'),
            tuple(
                (_TITLES.get(name, name), place, _quantity(size, unit))
                for name, (place, size, unit) in diagnosis.detectable.items()
            ),
            2,
        )


def _found(named: NamedEffect) -> tuple[str, ...]:
    one = named.hypothesis
    unit = one.effect.unit(one.place)
    parameters = [f'{_words(one.effect.size_name)} {_quantity(named.size, unit, named.deviation)}']
    parameters += [
        f'{_words(inner.name)} {_quantity(inner.value, inner.unit, inner.deviation)}'
        for inner in named.inner
    ]
    probability = named.finding.probability
    rivals = [
        f'{rival.effect.title} ({rival.place.words}); to split: {splitting_test(one, rival)}'
        for rival in named.finding.rivals
    ]
    return (
        one.effect.title,
        one.place.words,
        '\n'.join(parameters),
        f'{probability:.1g}' if probability > 1e-16 else '< 1e-16',
        '\n'.join(rivals) or '-',
    )


def _quantity(value: float, si_unit: str, deviation: float = math.nan) -> str:
    unit = readable_unit(si_unit, value)
    name = '' if unit.name == '1' else f' {unit.name}'
    spread = f' ± {deviation / unit.size:.2g}' if math.isfinite(deviation) else ''
    return f'{value / unit.size:.4g}{spread}{name}'


def _size(error: HeldOutError, kind: SensorKind, which: int) -> float:
    """Root mean square over the sensors of a kind: 0 of their error, 1 of their noise."""
    sizes = [one[which] for name, one in error.channels.items() if error.kinds[name] is kind]
    return float(np.sqrt(np.mean(np.square(sizes)))) if sizes else math.nan


def _line(cells: Sequence[str]) -> str:
    return f'| {" | ".join(cells)} |\n'


def _words(name: str) -> str:
    return name.replace('_', ' ')


def _percent(share: float) -> str:
    return _significant(100 * share)


def _significant(value: float) -> str:
    return '-' if not math.isfinite(value) else f'{value:.3g}'
