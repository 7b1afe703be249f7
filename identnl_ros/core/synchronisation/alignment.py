# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sources with clocks of their own on the sample grid of the stand."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MARGIN, MeasuredRecord
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.mechanics.modes import Mode
from identnl_ros.core.synchronisation.clock_fit import Clock, CRYSTAL_TOLERANCE, fit_clock
from identnl_ros.core.synchronisation.damping_cost import delay_warning
from identnl_ros.core.synchronisation.delay_estimate import DelayEstimate, source_delays
from identnl_ros.core.synchronisation.misfit import MOST_UNEXPLAINED
from identnl_ros.core.synchronisation.resampling import Grid, resample
import numpy as np
from numpy.typing import NDArray

# Unknown constant difference of the latencies of two sources' stamps, standard deviation [s].
LATENCY = 1e-3
# The search goes so many standard deviations of what the stamps tell.
SEARCH = 4.0
MOST_ROUNDS = 8
# Moves of the grid below this share of a standard deviation end the rounds.
ENOUGH = 0.02


@dataclass(frozen=True)
class SourceRecord:
    """
    What one device sampled with its own clock.

    Parameters
    ----------
    name : str
    channels : tuple of str
        Names of the sensors of the layout that the columns are.
    sample_rate : float
        Nominal [Hz].
    samples : ndarray, shape (n_samples, n_channels)
        SI; NaN where there is no valid sample.
    stamped : ndarray of int, shape (n_stamps,)
        Rows whose host time is known, rising.
    stamps_ns : ndarray of int, shape (n_stamps,)
        Their host times, or arrival times [ns].

    Raises
    ------
    DataError
        If the shapes do not fit.

    """

    name: str
    channels: tuple[str, ...]
    sample_rate: float
    samples: NDArray[np.float64]
    stamped: NDArray[np.int64] = field(repr=False)
    stamps_ns: NDArray[np.int64] = field(repr=False)

    def __post_init__(self) -> None:
        """Check what the alignment relies on."""
        if self.samples.ndim != 2 or self.samples.shape[1] != len(self.channels):
            raise DataError(
                f'source {self.name}: samples have the shape {self.samples.shape}, expected one '
                f'column for each of the {len(self.channels)} channels'
            )
        if self.stamped.shape != self.stamps_ns.shape or self.stamped.ndim != 1:
            raise DataError(
                f'source {self.name}: {self.stamped.size} stamped samples but '
                f'{self.stamps_ns.size} stamps'
            )


@dataclass(frozen=True)
class Alignment:
    """
    One record of all sources, and how well they are aligned.

    Parameters
    ----------
    record : MeasuredRecord
        On the grid of the first source; NaN where another one does not reach.
    clocks : tuple of Clock
        From the stamps alone.
    grids : tuple of Grid
        Where the record's samples lie among those of each source.
    remaining : DelayEstimate
        What delays and skews may remain: their standard deviations, after all that was found
        has been taken out.

    """

    record: MeasuredRecord
    clocks: tuple[Clock, ...]
    grids: tuple[Grid, ...]
    remaining: DelayEstimate

    def warnings(self, modes: Sequence[Mode]) -> tuple[str, ...]:
        """
        Say of each source by how much damping may suffer from what remains, at 95 %.

        Parameters
        ----------
        modes : sequence of Mode
            Of the machine.

        Returns
        -------
        tuple of str
            Empty: nothing worth a warning.

        """
        held = [mode for mode in modes if mode.damping_ratio > 0]
        frequencies = np.array([mode.frequency for mode in held])
        ratios = np.array([mode.damping_ratio for mode in held])
        bounds = 1.96 * self.remaining.deviation_over_record
        found = (
            delay_warning(name, float(bound), frequencies, ratios)
            for name, bound in zip(self.remaining.names, bounds, strict=True)
        )
        return tuple(one for one in found if one is not None)


def align(
    model: Model,
    layout: Layout,
    sources: Sequence[SourceRecord],
    tolerance: float = CRYSTAL_TOLERANCE,
    latency: float = LATENCY,
) -> Alignment:
    """
    Bring sources on the grid of the first one.

    Stamps give offsets and skews as far as jitter and unknown latencies allow; the motion that
    redundant sensors of different sources saw gives the rest. Both are weighed by their
    variances, so that a source which saw no motion is aligned by its stamps alone and says so
    by its standard deviation.

    Parameters
    ----------
    model : Model
    layout : Layout
        All sensors; known delays stay in it and are taken out where the record is used.
    sources : sequence of SourceRecord
        Each sensor of the layout in exactly one of them.
    tolerance : float
        Standard deviation of a clock's skew before any stamp [-].
    latency : float
        Standard deviation of the unknown difference between the mean latencies of the stamps of
        two sources [s].

    Returns
    -------
    Alignment

    Raises
    ------
    DataError
        If channels are missing or twice there, stamps have a step, or the sources do not
        overlap or saw different motion.

    """
    places = channel_places(layout, sources)
    clocks = tuple(
        fit_clock(one.sample_rate, one.stamped, one.stamps_ns, tolerance) for one in sources
    )
    count = len(sources[0].samples)
    rate = sources[0].sample_rate
    grids = tuple(_grid(clocks[0], clock) for clock in clocks)
    record = _record(layout, sources, places, grids)
    common = _overlap(record, places, sources)
    middle = (common.start + common.stop - 1) / 2
    mean, covariance = np.zeros(2 * len(clocks) - 2), _stamp_covariance(clocks, middle, latency)
    search = SEARCH * float(np.sqrt(np.diag(covariance)[::2].max(initial=0.0)))
    names = tuple(one.name for one in sources)
    found = _nothing_found(names, count / rate)
    for _ in range(MOST_ROUNDS if len(sources) > 1 else 0):
        part = record.part(common.start, common.stop)
        found = source_delays(model, part, places, names, search, mean, covariance)
        delays, skews = found.delays[1:], found.skews[1:]
        moved = zip(grids[1:], sources[1:], delays, skews, strict=True)
        grids = (grids[0], *(_moved(grid, one.sample_rate, rate, delay, skew, middle)
                             for grid, one, delay, skew in moved))  # fmt: skip
        record = _record(layout, sources, places, grids)
        # The stamps still say what they said; the grid has moved away from it.
        mean = mean - np.stack((delays, skews), axis=1).ravel()
        search = 0.0
        shift = np.sqrt(delays**2 + (skews * found.duration) ** 2 / 12)
        if np.all(shift <= ENOUGH * found.deviation_over_record[1:]):
            break
    if found.unexplained > MOST_UNEXPLAINED:
        raise DataError(
            f'sources {", ".join(names)}: {found.unexplained:.0%} of the motion does not fit; '
            'check that the stamps of all sources are of the same clock and the same run'
        )
    zero = np.zeros(len(sources))
    return Alignment(record, clocks, grids, replace(found, delays=zero, skews=zero))


class WithChannels(Protocol):
    """A source that says which channels it has."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of sensors of the layout."""
        ...


def channel_places(layout: Layout, sources: Sequence[WithChannels]) -> list[list[int]]:
    """
    Find the channels of the layout that each source has.

    Parameters
    ----------
    layout : Layout
    sources : sequence of objects with channels

    Returns
    -------
    list of list of int

    Raises
    ------
    DataError
        If channels are missing or twice there.

    """
    names = [sensor.name for sensor in layout.sensors]
    found = [name for source in sources for name in source.channels]
    for name in (*names, *found):
        if found.count(name) != 1 or name not in names:
            raise DataError(
                f'sources: channel {name} is in {found.count(name)} sources and '
                f'{"" if name in names else "not "}in the layout; expected every sensor of the '
                'layout in one source'
            )
    return [[names.index(name) for name in source.channels] for source in sources]


def _grid(reference: Clock, clock: Clock) -> Grid:
    """Places of the reference's samples among those of another source, by their stamps."""
    rate = clock.sample_rate / (1 + clock.skew)
    apart = (reference.origin_ns - clock.origin_ns) / NANOSECONDS
    start = (reference.offset - clock.offset + apart) * rate
    return Grid(start, rate / reference.sample_rate * (1 + reference.skew))


def _moved(
    grid: Grid, own_rate: float, rate: float, delay: float, skew: float, middle: float
) -> Grid:
    """Read a source later by a delay that grows along the record."""
    start = grid.start + own_rate * (delay - skew * middle / rate)
    return Grid(start, grid.step + own_rate * skew / rate)


def _stamp_covariance(
    clocks: Sequence[Clock], middle: float, latency: float
) -> NDArray[np.float64]:
    """Covariance of delay and skew of every source but the first, as the stamps tell them."""
    own = []
    for clock in clocks:
        # Sources run alike but for some 1e-4: the same time since their sample 0, all but.
        shift = np.array([[1.0, middle / clocks[0].sample_rate], [0.0, 1.0]])
        own.append(shift @ clock.covariance @ shift.T + np.diag([latency**2 / 2, 0.0]))
    others = len(clocks) - 1
    result = np.kron(np.ones((others, others)), own[0])
    for i, one in enumerate(own[1:]):
        result[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += one
    return result


def _record(
    layout: Layout,
    sources: Sequence[SourceRecord],
    places: list[list[int]],
    grids: Sequence[Grid],
) -> MeasuredRecord:
    samples = np.full((len(sources[0].samples), len(layout.sensors)), np.nan)
    samples[:, places[0]] = sources[0].samples
    for source, own, grid in zip(sources[1:], places[1:], grids[1:], strict=True):
        samples[:, own] = resample(source.samples, grid, len(samples))
    return MeasuredRecord(layout, sources[0].sample_rate, samples)


def _overlap(
    record: MeasuredRecord, places: list[list[int]], sources: Sequence[SourceRecord]
) -> slice:
    """Find from where to where every source has samples."""
    begin, end = 0, len(record.samples)
    for source, own in zip(sources, places, strict=True):
        known = np.flatnonzero(np.isfinite(record.samples[:, own]).any(axis=1))
        begin = max(begin, int(known[0]) if known.size else end)
        end = min(end, int(known[-1]) + 1 if known.size else begin)
        if end - begin < 4 * MARGIN:
            raise DataError(
                f'source {source.name}: has {max(0, end - begin)} samples in common with the '
                f'other sources, by the stamps; expected at least {4 * MARGIN}. Check that the '
                'stamps of all sources are of the same host'
            )
    return slice(begin, end)


def _nothing_found(names: tuple[str, ...], duration: float) -> DelayEstimate:
    size = len(names)
    zero = np.zeros(size)
    return DelayEstimate(names, zero, zero, np.zeros((2 * size, 2 * size)), duration)
