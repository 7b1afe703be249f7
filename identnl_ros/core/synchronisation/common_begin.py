# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The instant from which on all sources of a stream have samples, by their stamps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.core.synchronisation.resampling import reach_of
from identnl_ros.core.synchronisation.source_stream import LONGEST_BUFFER, SourceStream

# So much more is waited for, to see steps of the stamps before the samples are given [s].
LOOKAHEAD = 0.1
# At the begin, a source that has not sent anything is waited for [s].
PATIENCE = 5.0


@dataclass(frozen=True)
class CommonBegin:
    """
    Where several sources begin together.

    Parameters
    ----------
    sources : tuple of SourceStream
        Those that sample.
    begin_ns : int
        Host time from which on all of them have samples [ns].
    end_ns : int
        Up to which they were observed [ns].

    """

    sources: tuple[SourceStream, ...]
    begin_ns: int
    end_ns: int


def common_begin(
    streams: Sequence[SourceStream],
    settling: float,
    final: bool,
    remark: Callable[[str], None],
) -> CommonBegin | None:
    """
    Find the common begin of all sources that sample.

    Parameters
    ----------
    streams : sequence of SourceStream
    settling : float
        They are observed for so long [s].
    final : bool
        Nothing follows what they have.
    remark : callable
        Called with sentences for the user.

    Returns
    -------
    CommonBegin or None
        None: there is not enough of them yet.

    Raises
    ------
    DataError
        If the sources do not overlap, or stamps are too few.

    """
    present = [one for one in streams if one.began]
    longest = max(((one.end - one.begin) / one.rate for one in present), default=0.0)
    if len(present) < len(streams) and not final and longest < PATIENCE:
        return None
    for one in present:
        if not final and one.end < one.begin + settling * one.rate:
            return None
        one.clock.feed(None if final else one.begin + settling * one.rate)
        if not one.clock.placeable and len(streams) > 1:
            one.clock.feed()
            if not one.clock.placeable:
                _refuse_few_stamps(one, final)
                return None
    if not present:
        return None
    begin_ns = max(one.clock.host_time(one.begin) for one in present)
    wanted = begin_ns + round((settling + LOOKAHEAD) * NANOSECONDS)
    places = [one.clock.place_at(wanted) for one in present]
    if not final and any(
        one.end < place + reach_of(one.stretch) + 1
        for one, place in zip(present, places, strict=True)
    ):
        if longest > 0.8 * LONGEST_BUFFER:
            _refuse_apart(present)
        return None
    for one, place in zip(present, places, strict=True):
        one.clock.feed(None if final else place)
    for one in present:
        if one.clock.step():
            remark(f'{one.source.name}: its stamps jump; waiting anew')
            one.restart(one.end)
            return None
    end_ns = min(one.clock.host_time(one.end) for one in present)
    if len(present) > 1 and end_ns - begin_ns < 0.1 * NANOSECONDS:
        _refuse_apart(present)
    end_ns = min(end_ns, begin_ns + round(settling * NANOSECONDS))
    return CommonBegin(tuple(present), begin_ns, end_ns)


def _refuse_apart(present: Sequence[SourceStream]) -> None:
    first = present[0]
    for one in present[1:]:
        apart = (one.clock.host_time(one.begin) - first.clock.host_time(first.begin)) / NANOSECONDS
        if abs(apart) > 0.5 * min(one.end - one.begin, LONGEST_BUFFER) / one.rate:
            raise DataError(
                f'source {one.source.name}: by the stamps it begins {apart:.6g} s after '
                f'{first.source.name}, and they do not overlap; check that the stamps of '
                'all sources are of the same clock and the same run'
            )
    raise DataError('sources: by the stamps they have less than 0.1 s in common; record longer')


def _refuse_few_stamps(one: SourceStream, final: bool) -> None:
    if final or (one.end - one.begin) / one.rate > 2 * PATIENCE:
        raise DataError(
            f'source {one.source.name}: fewer than 3 blocks with stamps are too few to follow '
            'its clock; record longer, or read shorter blocks'
        )
