# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""An uninterrupted run of samples, judged stretch by stretch."""

from dataclasses import dataclass

from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.quality.condition import Condition, EXCLUDING
from identnl_ros.core.quality.held_values import HeldValues
from identnl_ros.core.quality.lost_channels import LostChannels
from identnl_ros.core.quality.mark import Mark
from identnl_ros.core.quality.noise_level import NoiseLevel, SEGMENT
from identnl_ros.core.quality.repeated_rows import RepeatedRows
from identnl_ros.core.quality.residual_scale import DIFFERENCE_ORDER, REACH, ResidualScale
from identnl_ros.core.quality.spike import find_spikes, HALF_WIDTH, HISTORY
import numpy as np
from numpy.typing import NDArray

# Samples judged together; samples after one that spikes are judged with; samples that faults
# found later may reach back.
STRETCH = 128
AHEAD = HALF_WIDTH
LAG = 32
# What arithmetic leaves of the largest samples of the last second.
ROUNDING = 1e-13
KEPT = max(HISTORY, SEGMENT) + STRETCH + AHEAD + LAG
Amounts = dict[tuple[int, Condition], float]


@dataclass(frozen=True)
class Stretch:
    """
    Judged samples.

    Parameters
    ----------
    first_index : int
    samples : ndarray, shape (n_samples, n_channels)
        As delivered.
    flags : ndarray of uint16, shape (n_samples, n_channels)
        Bits of `Condition` of single samples.
    standing : ndarray of uint16, shape (n_channels,)
        Bits of the conditions of the whole stretch.
    amounts : dict
        Sizes of faults by channel and condition.

    """

    first_index: int
    samples: NDArray[np.float64]
    flags: NDArray[np.uint16]
    standing: NDArray[np.uint16]
    amounts: Amounts


class JudgedRun:
    """
    Samples of a run that are waiting for judgement, and those shortly before.

    Parameters
    ----------
    layout : Layout
    sample_rate : float
        [Hz].

    """

    def __init__(self, layout: Layout, sample_rate: float) -> None:
        channels = len(layout.sensors)
        self._layout = layout
        self._rate = sample_rate
        self._held = HeldValues(layout, sample_rate)
        self._repeated = RepeatedRows(channels, sample_rate)
        self._scale = ResidualScale(channels)
        self._noise = NoiseLevel(layout, sample_rate)
        self._lost = LostChannels(channels, sample_rate)
        self._full_scale = np.array([sensor.full_scale for sensor in layout.sensors])
        self._least_noise = np.array(
            [max(np.nan_to_num(one.noise), one.resolution / np.sqrt(12)) for one in layout.sensors]
        )
        self.restart(0)

    def restart(self, index: int) -> None:
        """
        Expect samples that do not follow those before.

        Parameters
        ----------
        index : int
            Of the first one.

        """
        channels = len(self._layout.sensors)
        self._base = self._examined = self._judged = self._released = index
        self._raw = np.empty((0, channels))
        self._work = np.empty((0, channels))  # without what is at fault
        self._flags = np.empty((0, channels), dtype=np.uint16)
        self._amounts: Amounts = {}
        self._held.restart(index)
        self._lost.restart(index)

    def append(self, samples: NDArray[np.float64], saturated: NDArray[np.bool_]) -> None:
        """
        Take the next samples.

        Parameters
        ----------
        samples : ndarray, shape (n_samples, n_channels)
            SI; NaN: no valid sample.
        saturated : ndarray of bool, shape (n_channels,)
            The source says that some of them are.

        """
        first = self._base + len(self._raw)
        invalid = ~np.isfinite(samples)
        flags = np.zeros(samples.shape, dtype=np.uint16)
        flags[invalid] = Condition.MISSING
        beyond = self._beyond_full_scale(first, samples)
        # Which ones the source means is not known unless the range is.
        beyond |= saturated & ~beyond.any(axis=0) & ~invalid
        flags[beyond] |= np.uint16(Condition.SATURATED)
        self._raw = np.concatenate((self._raw, samples))
        self._work = np.concatenate((self._work, np.where(flags, np.nan, samples)))
        self._flags = np.concatenate((self._flags, flags))

    def judge(self, everything: bool) -> list[Stretch]:
        """
        Judge what can be judged.

        Parameters
        ----------
        everything : bool
            Nothing follows in this run.

        Returns
        -------
        list of Stretch
            What is done with, in order.

        """
        stretches = []
        end = self._base + len(self._raw)
        while end - self._examined >= STRETCH:
            stretches.append(self._stretch(self._examined + STRETCH, False))
        if everything and end > self._released:
            stretches.append(self._stretch(end, True))
        return [one for one in stretches if len(one.flags)]

    def _beyond_full_scale(self, first: int, samples: NDArray[np.float64]) -> NDArray[np.bool_]:
        beyond = np.zeros(samples.shape, dtype=bool)
        time = np.arange(first, first + len(samples)) / self._rate
        for channel in np.flatnonzero(np.isfinite(self._full_scale)):
            sensor = self._layout.sensors[channel]
            # A rounding error below the full scale is the full scale.
            recorded = np.abs(sensor.to_recorded(samples[:, channel], time))
            beyond[:, channel] = recorded >= sensor.full_scale * (1 - 1e-12)
        return beyond

    def _stretch(self, end: int, final: bool) -> Stretch:
        begin = self._examined
        self._examine(begin, end)
        self._examined = end
        judged_to = end if final else max(end - AHEAD, self._judged)
        self._find_spikes(self._judged, judged_to)
        new = judged_to - self._judged
        self._judged = judged_to
        rows = judged_to - self._base
        newest = self._work[max(rows - SEGMENT, 0) : rows]
        self._noise.add(newest, new, self._held.resolution.step)
        released_to = end if final else max(judged_to - LAG, self._released)
        return self._release(released_to)

    def _examine(self, begin: int, end: int) -> None:
        """Look for faults that need no samples after them."""
        first, last = begin - self._base, end - self._base
        marks = self._repeated.judge(begin, self._raw[first:last], self._held.log_chance)
        self._mark(marks)
        self._mark(self._held.judge(begin, self._work[first:last], self._scale.lasting))

    def _find_spikes(self, begin: int, end: int) -> None:
        first, last = begin - self._base, end - self._base
        margin = REACH + 4
        low, high = max(first - margin, 0), min(last + margin, len(self._work))
        differences = np.full((len(self._work), self._work.shape[1]), np.nan)
        if high - low > DIFFERENCE_ORDER:
            with np.errstate(invalid='ignore'):
                differences[low + REACH : high - REACH] = np.diff(
                    self._work[low:high], n=DIFFERENCE_ORDER, axis=0
                )
        self._scale.add(differences[first:last])
        floor = np.fmax(self._least_noise, self._held.resolution.step / np.sqrt(12))
        floor = np.fmax(floor, ROUNDING * self._held.size)
        self._mark(
            find_spikes(
                self._work, differences, first, last, self._scale.recent, floor, self._base
            )
        )

    def _mark(self, marks: list[Mark]) -> None:
        for mark in marks:
            first = max(mark.first_index, self._released) - self._base
            rows = slice(first, mark.next_index - self._base)
            columns = slice(None) if mark.channel < 0 else mark.channel
            self._flags[rows, columns] |= np.uint16(mark.condition)
            self._work[rows, columns] = np.nan
            if np.isfinite(mark.amount):
                key = mark.channel, mark.condition
                before = self._amounts.get(key, 0.0)
                self._amounts[key] = max(before, mark.amount, key=abs)

    def _release(self, released_to: int) -> Stretch:
        first, last = self._released - self._base, released_to - self._base
        flags = self._flags[first:last]
        lost = self._lost.judge(self._released, (flags & EXCLUDING) == 0)
        if lost is not None:
            flags[lost] |= np.uint16(Condition.LOST)
        standing = self._noise.conditions
        amounts, self._amounts = self._amounts, {}
        for condition, size in (
            (Condition.NOISE, self._noise.noise),
            (Condition.ALIASING, self._noise.top),
        ):
            for channel in np.flatnonzero(standing & condition).tolist():
                amounts[channel, condition] = float(size[channel])
        stretch = Stretch(
            self._released, self._raw[first:last].copy(), flags.copy(), standing, amounts
        )
        self._released = released_to
        spare = max(self._judged - KEPT - self._base, 0)
        spare = min(spare, last)
        if spare:
            self._raw, self._work = self._raw[spare:], self._work[spare:]
            self._flags = self._flags[spare:]
            self._base += spare
        return stretch
