# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Values that are held: a channel that is stuck, or peaks that are cut off."""

from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.mark import chance_per_sample, Mark
from identnl_ros.core.quality.recent_range import RecentRange, WIDE
from identnl_ros.core.quality.resolution import FoundResolution, most_likely_value
import numpy as np
from numpy.typing import NDArray

# Equal values in a row that are always believed; a cut peak has at least three.
BELIEVED, LEAST_CLIPPED = 8, 3
# Thresholds below this: the converter is so fine that no value comes back by chance.
FINE = 9
# Longer holds than this are believed of a quiet channel, unless others move [s].
LONGEST_BELIEVED = 1.0
# Where noise cannot tell: while others move, a hold of this many times the longest before, and
# at least this long; from the start on, of a channel whose noise nobody knows [s].
TIMES_LONGEST, LEAST_HOLD, HOLD_FROM_START = 5, 0.1, 1.0
# A cut peak held longer than this is stuck as well [s].
LONGEST_CLIPPED = 0.1


class HeldValues:
    """
    Find runs of equal values that are too long.

    Statistic: number of equal values in a row. Noise of standard deviation s in front of a
    converter with steps q gives its most likely value with probability P = erf(q / (s sqrt 8))
    at most; the threshold is the run that white noise shows at the false-alarm rate, 8 at least.
    For s = q that is 27 samples, for s = q / 2 64. The noise is the smaller one of stated and
    found, the step the larger one.

    Where the threshold exceeds `LONGEST_BELIEVED` or there is no noise, rest and failure look
    alike. Then a channel is stuck only if it has moved by many steps before, and holds its
    value while at least half of the others move at least half as much as usual, for
    `LEAST_HOLD` and `TIMES_LONGEST` times its longest hold so far. A channel that never moved
    is not judged if its noise is stated to be 0 (perpendicular to the motion, say); if it is
    not known, after `HOLD_FROM_START` of motion of the others. Forces without noise are not
    judged: between blows they rest at 0.

    Peaks are cut off (clipped) where more samples stand at the end of the range of the last
    second than noise explains: three to eight in all at fine resolution, else a run as above,
    but not longer than `LONGEST_CLIPPED`. The step of a blow's velocity looks like a cut peak
    to a converter coarser than the noise: there only a full scale in the layout tells.

    Parameters
    ----------
    layout : Layout
    sample_rate : float
        [Hz].

    """

    def __init__(self, layout: Layout, sample_rate: float) -> None:
        sensors = layout.sensors
        self._rate = sample_rate
        self._log_chance = float(np.log(chance_per_sample(sample_rate)))
        self._stated = np.array([sensor.noise for sensor in sensors])
        self._force = np.array([sensor.kind is SensorKind.FORCE for sensor in sensors])
        # A drifting offset that was taken out turns equal recorded values into a slope.
        self._slope = np.array([sensor.drift / sensor.gain for sensor in sensors]) / sample_rate
        self.resolution = FoundResolution(layout)
        self._range = RecentRange(len(sensors), sample_rate)
        self._moved = np.zeros(len(sensors), dtype=bool)
        self._longest = np.zeros(len(sensors), dtype=np.intp)
        self._held_in_motion = np.zeros(len(sensors), dtype=np.intp)
        self._lively = np.zeros(len(sensors), dtype=bool)
        self._limit = np.full(len(sensors), np.inf)
        self._shortest = np.full(len(sensors), np.inf)
        self.log_chance = np.zeros(len(sensors))
        # Largest absolute value of the last second.
        self.size = np.zeros(len(sensors))
        self.restart(0)

    def restart(self, index: int) -> None:
        """
        Expect samples that do not follow those before.

        Parameters
        ----------
        index : int
            Of the first one.

        """
        self._last = np.full(len(self._stated), np.nan)
        self._start = np.full(len(self._stated), index)

    def judge(
        self,
        first_index: int,
        samples: NDArray[np.float64],
        noise: NDArray[np.float64],
    ) -> list[Mark]:
        """
        Take the next samples.

        Parameters
        ----------
        first_index : int
        samples : ndarray, shape (n_samples, n_channels)
            NaN: no valid sample.
        noise : ndarray, shape (n_channels,)
            Found in the samples so far; NaN: not known.

        Returns
        -------
        list of Mark
            Conditions STUCK and SATURATED.

        """
        if not len(samples):
            return []
        index = np.arange(first_index, first_index + len(samples))[:, np.newaxis]
        values = samples + self._slope * index if self._slope.any() else samples
        change = np.abs(np.diff(values, axis=0, prepend=self._last[np.newaxis]))
        same = self.resolution.add(change, np.abs(values[-1]))
        start = np.maximum.accumulate(np.where(same, -1, index), axis=0)
        start = np.maximum(start, self._start)
        length = index + 1 - start
        self._moved |= (change > 0).any(axis=0) & ~same.all(axis=0)
        self._update_limits(length[0], noise)
        top, bottom, wide = self._range.add(values, self._spread(noise))
        self.size = np.fmax(np.abs(top), np.abs(bottom))
        marks = self._clipped(values, length, start, top, bottom, wide)
        cut = np.zeros(len(self._last), dtype=bool)
        cut[[mark.channel for mark in marks]] = True
        patience = np.where(cut, max(LONGEST_CLIPPED * self._rate, BELIEVED), 0.0)
        resting = self._rests_in_motion(length, same, noise)
        limit = np.where(resting, 1.0, self._limit)
        stuck = length >= np.maximum(limit, patience)
        if stuck.any():
            for channel in np.flatnonzero(stuck.any(axis=0)):
                for one in np.unique(start[stuck[:, channel], channel]):
                    rows = np.flatnonzero(stuck[:, channel] & (start[:, channel] == one))
                    marks.append(
                        Mark(
                            int(channel), Condition.STUCK, int(one),
                            int(first_index + rows[-1] + 1), float(samples[rows[-1], channel]),
                        )
                    )  # fmt: skip
        self._last, self._start = values[-1].copy(), start[-1]
        return marks

    def _spread(self, noise: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.fmax(self.resolution.step, np.nan_to_num(noise)))

    def _update_limits(self, length: NDArray[np.intp], noise: NDArray[np.float64]) -> None:
        """Set thresholds anew, but not those of runs that may be about to pass theirs."""
        stated = np.where(self._stated > 0, self._stated, np.nan)
        # At the edge of a step the least noise makes samples jump by a whole one.
        found = np.sqrt(np.maximum(noise**2 - self.resolution.step**2 / 4, 0.0))
        believed = np.where(self._moved, np.fmin(stated, found), stated)
        believed = np.where(self._stated == 0, 0.0, believed)
        most_likely = most_likely_value(self.resolution.step, believed)
        with np.errstate(divide='ignore'):
            log_chance = np.where(np.isnan(believed), 0.0, np.log(most_likely))
            needed = 1 + np.where(log_chance < 0, self._log_chance / log_chance, np.inf)
        needed = np.where(needed > LONGEST_BELIEVED * self._rate, np.inf, needed)
        free = length < 2 * BELIEVED
        self._limit = np.where(free, np.fmax(needed, BELIEVED), self._limit)
        self._shortest = np.where(free, np.fmax(needed, LEAST_CLIPPED), self._shortest)
        self.log_chance = log_chance

    def _rests_in_motion(
        self, length: NDArray[np.intp], same: NDArray[np.bool_], noise: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Tell which channels rest although others move and noise cannot tell."""
        unlimited: NDArray[np.bool_] = np.isinf(self._limit)
        if not unlimited.any():
            return unlimited
        held: NDArray[np.bool_] = np.all(same, axis=0)
        ended = np.where(same[1:], 0, length[:-1]).max(axis=0, initial=0)
        self._longest = np.maximum(self._longest, np.where(self._moved, ended, 0))
        moving = self._range.moving & ~held
        others = len(self._limit) - 1
        enough = moving.sum() - moving >= max(1, (others + 1) // 2)
        self._held_in_motion = np.where(
            held, self._held_in_motion + np.where(enough, len(same), 0), 0
        )
        self._lively = np.where(held, self._lively, self._range.usual > WIDE * self._spread(noise))
        from_start = np.where(
            np.isnan(self._stated) & ~self._force, HOLD_FROM_START * self._rate, np.inf
        )
        needed = np.where(
            self._moved & self._lively,
            np.maximum(LEAST_HOLD * self._rate, TIMES_LONGEST * self._longest),
            np.where(self._moved, np.inf, from_start),
        )
        # A force rests between blows.
        resting = self._force & ~(self._stated > 0)
        too_long: NDArray[np.bool_] = unlimited & ~resting & (self._held_in_motion >= needed)
        return too_long

    def _clipped(
        self,
        samples: NDArray[np.float64],
        length: NDArray[np.intp],
        start: NDArray[np.intp],
        top: NDArray[np.float64],
        bottom: NDArray[np.float64],
        wide: NDArray[np.bool_],
    ) -> list[Mark]:
        fine = self._shortest < FINE
        long = length >= self._shortest
        high = np.where(fine, self._range.at_top >= self._shortest, long)
        low = np.where(fine, self._range.at_bottom >= self._shortest, long)
        at_end = wide & ((high & (samples >= top)) | (low & (samples <= bottom)))
        if not at_end.any():
            return []
        rows, channels = np.nonzero(at_end)
        starts = start[rows, channels]
        first_index = start[0, 0] + length[0, 0] - 1
        ends: dict[tuple[int, int], int] = {}
        for channel, one, row in zip(
            channels.tolist(), starts.tolist(), rows.tolist(), strict=True
        ):
            ends[channel, one] = max(ends.get((channel, one), 0), row)
        return [
            Mark(
                channel, Condition.SATURATED, one, int(first_index + row + 1),
                float(samples[row, channel]),
            )
            for (channel, one), row in ends.items()
        ]  # fmt: skip
