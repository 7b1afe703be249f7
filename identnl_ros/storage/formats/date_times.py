# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Dates and times of day in tables, to the nanosecond."""

from collections.abc import Iterable
from datetime import datetime, timedelta, UTC
from functools import lru_cache
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

NANOSECONDS = 10**9
FRACTION_DIGITS = 9
NOT_A_TIME = int(np.iinfo(np.int64).min)  # as numpy has it
LONGEST = 9 * 10**18  # that 64 bits hold, to the year 2255 [ns]

_DATE_TIME = re.compile(
    r'(\d{4}-\d\d?-\d\d?|\d{4}/\d\d?/\d\d?|\d\d?\.\d\d?\.\d{4})?'
    r'(?:(?:^|[T\s]\s*)(\d\d?:\d\d(?::\d\d(?:[.,](\d+))?)?))?'
    r'\s*(Z|UTC|[+-]\d\d:?\d\d)?',
    re.ASCII,
)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
# Decimals of the seconds of a date alone and of hours and minutes alone: 10^5 s and 10^2 s.
_DATE_DECIMALS, _MINUTE_DECIMALS = -5, -2


def nanoseconds(text: str) -> int | None:
    """
    Understand a date, a date with time, or a time of day.

    Dates are ISO 8601 (``2026-11-22``, also with ``/``) or ``22.11.2026``; those whose order of
    day and month is not certain are not understood. Without a zone they are UTC.

    Parameters
    ----------
    text : str

    Returns
    -------
    int or None
        Since 1970, or midnight where there is no date [ns]; None: not understood.

    """
    found = _DATE_TIME.fullmatch(text.strip().strip('"'))
    if found is None:
        return None
    date, clock, fraction, zone = found.groups()
    whole = _whole(date, clock.partition('.')[0].partition(',')[0] if clock else None, zone)
    if whole is None or not fraction:
        return whole
    return whole + int(f'{fraction[:FRACTION_DIGITS]:0<{FRACTION_DIGITS}}')


def decimals(text: str) -> int:
    """
    Tell how exactly a time is written.

    Parameters
    ----------
    text : str
        That `nanoseconds` understands.

    Returns
    -------
    int
        Decimals of its seconds; negative: it has none, and is exact to so many tens of them.

    """
    found = _DATE_TIME.fullmatch(text.strip().strip('"'))
    if found is None or found[2] is None:
        return _DATE_DECIMALS
    if found[3]:
        return min(len(found[3]), FRACTION_DIGITS)
    return 0 if found[2].count(':') > 1 else _MINUTE_DECIMALS


def instants(values: NDArray[Any]) -> NDArray[np.int64] | None:
    """
    Understand an array of texts or of numpy's own times.

    Parameters
    ----------
    values : ndarray, shape (n,)

    Returns
    -------
    ndarray or None
        [ns since 1970 or midnight]; `NOT_A_TIME` where there is none. None: some value
        is not understood.

    """
    if values.dtype.kind == 'M':
        return values.astype('M8[ns]').astype(np.int64)
    if values.dtype.kind not in 'SUOT':
        return None
    found = []
    for value in _texts(values):
        instant = nanoseconds(value) if value.strip() else NOT_A_TIME
        if instant is None:
            return None
        found.append(instant)
    return np.array(found, np.int64)


def seconds_since(values: NDArray[Any], origin_ns: int) -> NDArray[np.float64]:
    """
    Turn texts or numpy's own times into seconds.

    Parameters
    ----------
    values : ndarray, shape (n,)
    origin_ns : int
        Of the seconds [ns since 1970 or midnight].

    Returns
    -------
    ndarray, shape (n,)
        [s]; NaN where there is no time.

    Raises
    ------
    ValueError
        If a value is not understood.

    """
    found = instants(values)
    if found is None:
        raise ValueError('a column of times holds something else')
    seconds = (found - origin_ns) / NANOSECONDS
    return np.where(found == NOT_A_TIME, np.nan, seconds)


def first_instant(values: NDArray[Any]) -> int | None:
    """
    Find the first time of an array.

    Parameters
    ----------
    values : ndarray, shape (n,)

    Returns
    -------
    int or None
        [ns since 1970 or midnight]; None: the array does not begin with times.

    """
    found = instants(values)
    known = [] if found is None else found[found != NOT_A_TIME]
    return int(known[0]) if len(known) else None


def first_text(values: NDArray[Any]) -> str:
    """
    Show the first value of an array of texts.

    Parameters
    ----------
    values : ndarray, shape (n,)

    Returns
    -------
    str
        Empty: there is none.

    """
    return next((value for value in _texts(values) if value.strip()), '')


def _texts(values: Iterable[Any]) -> Iterable[str]:
    for value in values:
        yield value.decode('utf-8', 'replace') if isinstance(value, bytes) else str(value or '')


@lru_cache(maxsize=64)  # neighbouring rows share the second
def _whole(date: str | None, clock: str | None, zone: str | None) -> int | None:
    """Understand all but the fraction [ns]."""
    if date is None and clock is None:
        return None
    year, month, day = 1970, 1, 1
    if date:
        parts = [int(one) for one in re.split(r'\D', date)]
        year, month, day = reversed(parts) if '.' in date else parts
    time = [int(one) for one in clock.split(':')] if clock else []
    hour, minute, second = (*time, 0, 0, 0)[:3]
    shift = timedelta()
    if zone and zone[0] in '+-':
        digits = zone[1:].replace(':', '')
        shift = timedelta(hours=int(digits[:2]), minutes=int(digits[2:]))
        shift = -shift if zone[0] == '-' else shift
    try:
        moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC) - shift
    except (ValueError, OverflowError):
        return None
    since = moment - _EPOCH
    found = (since.days * 86_400 + since.seconds) * NANOSECONDS
    return found if abs(found) < LONGEST else None
