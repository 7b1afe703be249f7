# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""An estimate as tables for people: stiffnesses, dampings, the rest, in daN and micrometres."""

from collections.abc import Iterator, Mapping
import math

from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus, ParameterEstimate
from identnl_ros.reports.paper_units import readable_unit
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

_STIFFNESS_SYMBOLS = ('a_', 'k')
_DAMPING_SYMBOLS = ('h_', 'c')
_RESIDUALS = {
    'pointwise': 'relative residual',
    'weak': 'residual over noise',
    'likelihood': 'residual over noise',
}


def show_estimate(estimate: Estimate, truth: Mapping[str, float], console: Console) -> None:
    """
    Print the tables of one identification and what bears on their trust.

    Parameters
    ----------
    estimate : Estimate
    truth : mapping of str to float
        True values by parameter name where they are known, SI.
    console : rich.console.Console

    """
    for table in estimate_tables(estimate, truth):
        console.print(table)
    console.print(
        f'{estimate.estimator} estimator: {estimate.samples} samples used, '
        f'{estimate.rejected_samples} rejected, {_RESIDUALS[estimate.estimator]} '
        f'{estimate.residual:.3g}, '
        f'condition number {estimate.condition_number:.3g}'
    )
    for parameter in estimate.parameters:
        if parameter.note:
            console.print(f'{parameter.name}: {parameter.note}', markup=False)
    for combination in estimate.combinations:
        console.print(
            f'The data determine only {combination.in_words} = {combination.value:.6g} '
            f'(std error {combination.standard_deviation:.2g}).',
            markup=False,
        )
    for number, note in enumerate(estimate.notes, start=1):
        console.print(f'[{number}] {note}', markup=False)


def estimate_tables(estimate: Estimate, truth: Mapping[str, float]) -> Iterator[Table]:
    """
    Build the tables of one identification.

    Parameters
    ----------
    estimate : Estimate
    truth : mapping of str to float
        True values by parameter name where they are known, SI.

    Yields
    ------
    rich.table.Table
        As tables 1 and 2 of Berczynski et al. (2010), then the remaining parameters.

    """
    groups: dict[str, list[ParameterEstimate]] = {}
    for parameter in estimate.parameters:
        groups.setdefault(_group(parameter), []).append(parameter)
    order = ('stiffness', 'damping', 'other parameters')
    titles = [title for title in order if title in groups]
    for i, title in enumerate(titles, start=1):
        yield _table(f'Table {i}. Results of the identification: {title}', groups[title], truth)


def _group(parameter: ParameterEstimate) -> str:
    if parameter.symbol.startswith(_STIFFNESS_SYMBOLS):
        return 'stiffness'
    return 'damping' if parameter.symbol.startswith(_DAMPING_SYMBOLS) else 'other parameters'


def _table(title: str, parameters: list[ParameterEstimate], truth: Mapping[str, float]) -> Table:
    table = Table(
        title=title, title_justify='left', box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0)
    )
    table.add_column('parameter', no_wrap=True)
    table.add_column('unit', no_wrap=True)
    for heading in (*(('actual',) if truth else ()), 'identified', '95 % interval', 'SI value'):
        table.add_column(heading, justify='right', no_wrap=True)
    table.add_column('status', no_wrap=True)
    # As in the paper: one kind of parameter after the other, joint by joint.
    symbols = list(dict.fromkeys(parameter.symbol for parameter in parameters))
    for parameter in sorted(parameters, key=lambda one: symbols.index(one.symbol)):
        unit = readable_unit(parameter.unit, parameter.value)
        part, _, _ = parameter.name.rpartition('.')
        cells = [f'{escape(part)} {_symbol(parameter)}', unit.name]
        if truth:
            cells.append(_significant(truth.get(parameter.name, math.nan) / unit.size, 6))
        cells.append(_significant(parameter.value / unit.size, 6))
        cells.append(_interval(parameter, unit.size))
        cells.append(_significant(parameter.value, 5))
        ok = parameter.status is EstimateStatus.OK
        status = parameter.status.value.replace('_', ' ')
        cells.append(status if ok else f'[bold red]{status}[/]')
        table.add_row(*cells)
    return table


def _interval(parameter: ParameterEstimate, size: float) -> str:
    """Half-width of a symmetric interval, both ends of another."""
    low, high = parameter.lower / size, parameter.upper / size
    if math.isnan(low) or math.isnan(high):
        return '-'
    half = (high - low) / 2
    if abs((low + high) / 2 - parameter.value / size) <= 1e-6 * half:
        return f'± {half:.2g}'
    return f'{low:.3g} … {high:.3g}'


def _symbol(parameter: ParameterEstimate) -> str:
    """Symbol with the axis that tells it from others of the same part, e.g. k, axis 3."""
    *_, last = parameter.name.split('_')
    return f'{parameter.symbol} ({last})' if last.isdigit() else parameter.symbol


def _significant(value: float, digits: int) -> str:
    return '-' if math.isnan(value) else f'{value:.{digits}g}'
