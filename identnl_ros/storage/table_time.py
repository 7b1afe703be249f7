# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Columns of a table that hold the time, whatever they are called."""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
import re

from identnl_ros.core.errors import DataError
from identnl_ros.storage.formats.table import Column, NO_UNITS, Table
from identnl_ros.storage.quantities import convert, is_unit, UnitError
from identnl_ros.storage.table_clock import Clock, ROWS_FOR_RATE, TIME_TOLERANCE
import numpy as np
from numpy.typing import NDArray

# Of a column that states no unit, the one with which it agrees with the sample rate [s].
UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9, 'min': 60.0, 'd': 86_400.0}
FEWEST_ROWS = 4  # in which numbers can be seen to rise evenly
MOST_GAPS = 0.01  # of the steps of a column that rises evenly [-]
# Rounding of a column that rises evenly: more, and any slow signal would [of its step].
COARSEST = 0.1

_NAMES = {
    'time', 't', 'times', 'timestamp', 'timestamps', 'stamp', 'date', 'datetime', 'zeit', 'zeiten',
    'zeitstempel', 'uhrzeit', 'datum', 'messzeit', 'zeitpunkt', 'temps', 'tiempo', 'tempo',
}  # fmt: skip
_BESIDE = {
    'in', 'of', 'day', 'elapsed', 'relative', 'rel', 'absolute', 'abs', 'utc', 'local', 'host',
    'sample', 'run', 'axis', 'vector', 'channel', 'und', 'and',
}  # fmt: skip
_ABSCISSAS = {'x value', 'x values', 'xvalue', 'x wert', 'abscissa', 'abszisse'}
_UNIT_WORDS = {
    's': 's', 'sec': 's', 'secs': 's', 'second': 's', 'seconds': 's', 'sek': 's', 'sekunde': 's',
    'sekunden': 's', 'ms': 'ms', 'msec': 'ms', 'millisecond': 'ms', 'milliseconds': 'ms',
    'millisekunden': 'ms', 'us': 'us', 'µs': 'us', 'μs': 'us', 'usec': 'us', 'microseconds': 'us',
    'mikrosekunden': 'us', 'ns': 'ns', 'nsec': 'ns', 'nanoseconds': 'ns', 'min': 'min',
}  # fmt: skip


class Likeness(Enum):
    """How much a column is like a time."""

    SURE = 'it is called a time, or holds dates'
    LIKELY = 'its name or unit is of a time, and its numbers rise'
    NUMBERS = 'its numbers rise evenly'


@dataclass(frozen=True)
class _Candidate:
    """A column that may hold the time, with its first numbers and its unit, if it has one."""

    column: int
    likeness: Likeness
    row: int
    values: NDArray[np.float64]
    unit: str


def find_clocks(
    table: Table,
    used: Sequence[int],
    ignored: Collection[int],
    stated: float | None,
    source: str,
) -> list[Clock]:
    """
    Find the columns of a table that hold the time, and check them.

    Parameters
    ----------
    table : Table
    used : sequence of int
        Columns that sensors read.
    ignored : collection of int
        Columns that are said to be no times.
    stated : float or None
        Sample rate by another source [Hz].
    source : str
        Who states it, for errors.

    Returns
    -------
    list of Clock
        The finest one first; empty: there is no time.

    Raises
    ------
    DataError
        If something that looks like a time is not understood or contradicts the sample rate.

    """
    if table.tells_instants:
        return []
    candidates = list(_candidates(table, used, ignored))
    clocks = [
        _clock(table, one, stated, source)
        for one in candidates
        if one.likeness is not Likeness.NUMBERS
    ]
    if stated:
        unsure = [one for one in candidates if one.likeness is Likeness.NUMBERS]
        fitting = [clock for one in unsure if (clock := _fitting(table, one, stated)) is not None]
        if not clocks and not fitting and unsure:
            step = float(np.median(np.diff(unsure[0].values)))
            raise DataError(
                f'{table.path}: {shown(table, unsure[0].column)} rises evenly by {step:.9g} from '
                f'{table.row_name} to {table.row_name}, like a time, but {source} a sample_rate '
                f'of {stated:.9g} Hz, a step of {1 / stated:.9g} s; correct sample_rate in the '
                f'layout, or {_remedy(table, unsure[0].column)} if it is no time'
            )
        clocks += fitting
    return sorted(clocks, key=lambda one: one.coarseness)


def shown(table: Table, column: int) -> str:
    """
    Name a column for people.

    Parameters
    ----------
    table : Table
    column : int

    Returns
    -------
    str

    """
    name = table.columns[column].name
    return f'column {name!r}' if name else f'column {column + 1}'


def _remedy(table: Table, column: int) -> str:
    return f"give --ignore-column '{table.columns[column].name or column + 1}'"


def _candidates(
    table: Table, used: Sequence[int], ignored: Collection[int]
) -> Iterator[_Candidate]:
    likenesses: dict[int, Likeness] = {}
    for i, column in enumerate(table.columns):
        likeness = None if i in used or i in ignored else _likeness(column)
        if likeness is not None:
            likenesses[i] = likeness
    sure = [i for i, one in likenesses.items() if one is Likeness.SURE]
    for i in sure:
        text = table.columns[i].text
        if text:
            raise DataError(
                f'{table.path}: {shown(table, i)} begins with {text[:40]!r}, which is no time '
                'that is understood; expected seconds, or dates like 2026-11-22T18:40:00.000 or '
                f'22.11.2026 18:40:00.000; {_remedy(table, i)} to do without it'
            )
    numeric = [i for i in likenesses if not table.columns[i].text]
    beside = [i for i in numeric if table.is_beside(i, used[0])]
    if sure and not set(beside) & set(sure):
        raise DataError(
            f'{table.path}: {shown(table, sure[0])} has another number of values than '
            f'{table.columns[used[0]].name!r}, which a sensor reads; expected the time of every '
            f'sample; {_remedy(table, sure[0])} if it belongs to other channels'
        )
    for i, row, values in _heads(table, beside, sure):
        likeness = likenesses[i]
        if _fits_likeness(table, i, values, likeness):
            yield _Candidate(i, likeness, row, values, _unit(table.columns[i]))


def _heads(
    table: Table, columns: list[int], sure: list[int]
) -> Iterator[tuple[int, int, NDArray[np.float64]]]:
    """Read the first numbers of some columns, together if that goes."""
    if not columns:
        return
    try:
        row, rows = next(table.rows(columns, ROWS_FOR_RATE))
    except DataError:
        for i in columns:
            try:
                row, rows = next(table.rows([i], ROWS_FOR_RATE))
            except DataError:
                if i in sure:
                    raise
                continue
            yield i, row, rows[:, 0]
        return
    for i, values in zip(columns, rows.T, strict=True):
        yield i, row, values


def _likeness(column: Column) -> Likeness | None:
    """Tell by name and unit how much a column is like a time; None: not at all."""
    if column.origin_ns is not None:
        return Likeness.SURE
    has_unit = column.unit not in ('', *NO_UNITS)
    is_time = has_unit and _seconds(column.unit) is not None
    if has_unit and not is_time and is_unit(column.unit):
        return None
    for name in (column.name, *column.aliases):
        words = _words(name)
        named = set(words) & _NAMES
        if named and set(words) <= _NAMES | _BESIDE | set(_UNIT_WORDS) and named != {'stamp'}:
            return Likeness.SURE if named != {'t'} or len(words) <= 2 else Likeness.LIKELY
        if named - {'t'} or ' '.join(words) in _ABSCISSAS:
            return Likeness.LIKELY
    if is_time:
        return Likeness.LIKELY
    return Likeness.NUMBERS


def _words(name: str) -> list[str]:
    """Take the last part of a name apart: ``run/TimeStamp_ms`` is time, stamp, ms."""
    last = re.split(r'[/\\]|\.(?=\w)', name)[-1]
    apart = re.sub(r'(?<=[a-zäöüß])(?=[A-Z])', ' ', last)
    return [one.lower() for one in re.findall(r'[^\W\d_]+', apart)]


def _unit(column: Column) -> str:
    """Find the unit of a time, by the file or by the name; empty: it is not stated."""
    if column.origin_ns is not None:
        return 's'
    if _seconds(column.unit) is not None:
        return column.unit
    words = _words(column.name)
    return _UNIT_WORDS.get(words[-1], '') if len(words) > 1 else ''


def _seconds(unit: str) -> float | None:
    """How many seconds a unit of time has; None: it is none."""
    unit = _UNIT_WORDS.get(unit.lower(), unit)
    if unit in UNITS:
        return UNITS[unit]
    try:
        return convert(1.0, unit, 's') if unit else None
    except UnitError:
        return None


def _fits_likeness(
    table: Table, column: int, values: NDArray[np.float64], likeness: Likeness
) -> bool:
    """Look whether numbers rise as a time does; what is surely one need not."""
    if likeness is Likeness.SURE:
        return True
    with np.errstate(invalid='ignore'):
        steps = np.diff(values)
    if not len(steps) or not np.isfinite(steps).all():
        return False
    if likeness is Likeness.LIKELY:
        return bool((steps >= 0).all() and values[-1] > values[0])
    if len(values) < FEWEST_ROWS or not (steps > 0).all():
        return False
    usual = float(np.median(steps))
    clock = _made(table, column, 1.0, 1.0)
    allowed = TIME_TOLERANCE * usual + np.minimum(clock.printed(values[1:]), COARSEST * usual)
    return float((np.abs(steps - usual) > allowed).mean()) <= MOST_GAPS


def _clock(table: Table, one: _Candidate, stated: float | None, source: str) -> Clock:
    """Make a clock of a column that is a time; in seconds if nothing better fits."""
    units = [one.unit] if one.unit or not stated else ['s', 'ms', 'us', 'ns']
    disagreement: DataError | None = None
    for unit in units:
        clock = _made(table, one.column, _seconds(unit or 's') or 1.0, stated)
        times = one.values * clock.unit
        if unit != units[0] and not clock.tells(times):
            continue
        try:
            return clock.checked(table, one.row, times, source, _remedy(table, one.column))
        except DataError as error:
            disagreement = disagreement or error
    assert disagreement is not None
    raise disagreement


def _fitting(table: Table, one: _Candidate, stated: float) -> Clock | None:
    """Find the unit in which numbers that rise evenly agree with the sample rate."""
    for unit in (*UNITS.values(), 1 / stated):  # the last one counts samples
        clock = _made(table, one.column, unit, stated)
        times = one.values * unit
        if not clock.tells(times):
            continue
        with suppress(DataError):
            return replace(clock.checked(table, one.row, times, '', ''), is_named=False)
    return None


def _made(table: Table, column: int, unit: float, stated: float | None) -> Clock:
    # Without a rate to compare with, the times have to tell it to their last digit.
    digits = table.digits(column, ROWS_FOR_RATE) if stated else None
    decimals, significant = digits or (None, None)
    name = shown(table, column)
    return Clock(
        column, name, stated, unit, decimals, significant, table.columns[column].origin_ns
    )
