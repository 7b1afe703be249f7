# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Faults of channels that show in the motion of rigid bodies, while data arrive."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.quality.channel_comparison import BandSums, Gains, MISMATCHES
from identnl_ros.core.quality.condition import Condition, Finding
from identnl_ros.core.quality.consistency_sentences import Sentences
from identnl_ros.core.quality.consistency_spectra import Chunk, Spectra, WINDOW
from identnl_ros.core.quality.contradictions import Contradictions
from identnl_ros.core.quality.drift import drift_in
from identnl_ros.core.quality.gain_limits import gain_limits
from identnl_ros.core.quality.hum import hum_at, LineSums
from identnl_ros.core.quality.leave_one_out import Flags, Reals
from identnl_ros.core.quality.long_windows import (
    LEVELS,
    LongWindows,
    PARTS,
    StretchSums,
    sums_of,
    together,
)
from identnl_ros.core.quality.redundancy import redundancy
from identnl_ros.core.quality.wrong_factors import Fault, RELATED, Said, wrong_factors
import numpy as np
from scipy.stats import norm

# Chunks that are judged together: about 6 s.
CHUNKS = 3
# Relative error of a gain that is no fault.
GAIN_TOLERANCE = 0.03
FALSE_ALARMS_PER_HOUR = 0.01
OWN_MISMATCHES = 3.0
# Smallest amplitude of hum, and drift in half a minute and in half an hour, over the noise of a
# sample.
HUM_SIZE = 0.5
DRIFT_SIZES = (1.0, 5.0)
# Means kept of either length, and those it takes to tell a drift.
MEANS = 75
LEAST_MEANS = 24
# A longer mean is over so many.
MEANS_PER_MEAN = 60
# A finding goes when so many evaluations find the channel right, and none does not.
EVALUATIONS_TO_CLEAR = 3


class Consistency:
    """
    Predict every channel from the others and name those that contradict.

    All motion sensors are brought to spectra of acceleration; the motion of the rigid bodies is
    eliminated, whatever it is. Channels are left out until the rest agrees; what is left out is
    compared with what the rest says. About 6 s are judged together; wrong gains that these do not
    show are looked for in windows of up to 24 s, 100 s and 400 s, as long as the faults that the
    short ones show do not change.

    Parameters
    ----------
    model : Model
        Its geometry is used, no joint.
    layout : Layout
    sample_rate : float
        [Hz].
    gain_tolerance : float
        Relative error of a gain that is no fault.
    false_alarms_per_hour : float
        Of all channels together, under sensor noise.

    Raises
    ------
    LayoutError
        If a sensor does not fit the machine.

    """

    def __init__(
        self,
        model: Model,
        layout: Layout,
        sample_rate: float,
        gain_tolerance: float = GAIN_TOLERANCE,
        false_alarms_per_hour: float = FALSE_ALARMS_PER_HOUR,
    ) -> None:
        self._layout = layout
        self._redundancy = redundancy(model, layout)
        self._spectra = Spectra(layout, self._redundancy.orders, sample_rate)
        self._rate = sample_rate
        self._tolerance = gain_tolerance
        links = self._redundancy.links(self._redundancy.rows)
        alike = self._redundancy.links(self._redundancy.by_kind(self._redundancy.rows))
        names = [sensor.name for sensor in layout.sensors]
        self.checkable: dict[str, tuple[str, ...]] = _named(links, names)
        """Channels that each is checked against; none: nothing tells whether it is right."""
        self.drift_checkable: dict[str, tuple[str, ...]] = _named(alike, names)
        """The same for drift, which only sensors of the same kind tell."""
        seconds = 5 * self._spectra.hop / sample_rate
        tests = len(names) * 3600 / seconds * (1 + sum(PARTS**-i for i in range(LEVELS)) / CHUNKS)
        self._significant = float(norm.isf(min(0.1, false_alarms_per_hour / tests / 2)))
        self._sentences = Sentences(layout)
        self._chunks: deque[Chunk] = deque(maxlen=CHUNKS)
        self._means: deque[Reals] = deque(maxlen=MEANS)
        self._long_means: deque[Reals] = deque(maxlen=MEANS)
        self._gathered: list[Reals] = []
        self._hums: deque[dict[int, dict[float, tuple[float, set[int]]]]] = deque(maxlen=CHUNKS)
        self._standing: dict[Fault, Finding] = {}
        self._right: dict[Fault, int] = {}
        self._gains: Gains | None = None
        self._long = LongWindows(CHUNKS)
        self._least_limits = np.full((2, len(names)), np.inf)
        self._related: set[Fault] = set()
        self._seen_from: dict[Fault, int] = {}

    def add(self, first_index: int, samples: Reals) -> None:
        """
        Take consecutive samples.

        Parameters
        ----------
        first_index : int
            Of the first sample; if it does not follow the last one, samples are missing.
        samples : ndarray, shape (n_samples, n_channels)
            [SI]; NaN: left out. Up to 5 in a row are bridged; a channel with longer gaps is not
            judged until these are 6 s old.

        Raises
        ------
        DataError
            If the samples do not have the channels of the layout.

        """
        count = len(self._layout.sensors)
        if samples.ndim != 2 or samples.shape[1] != count:
            raise DataError(
                f'samples have the shape {samples.shape}, expected (number of samples, {count}): '
                f'one column for every channel of layout {self._layout.stand}'
            )
        for chunk in self._spectra.add(first_index, samples):
            self._judge(chunk)

    def finish(self) -> None:
        """Judge the last samples of a stream too, that are less than what is judged together."""
        for chunk in self._spectra.finish():
            self._judge(chunk)
        shown: dict[Fault, Said] = {}
        right: set[Fault] = set()
        for window in self._long.finish():
            self._look_longer(window, shown, right)
        if shown:
            self._update(shown, right)

    def findings(self) -> tuple[Finding, ...]:
        """Faults that stand now, in the order of the channels."""
        return tuple(self._standing[one] for one in sorted(self._standing))

    @property
    def gains(self) -> dict[str, tuple[float, float]]:
        """
        Factor between each channel and what the others say, and its standard deviation.

        NaN: not told, since nothing checks the channel or there is no motion.
        """
        result = {sensor.name: (np.nan, np.nan) for sensor in self._layout.sensors}
        if self._gains is not None:
            spread = np.hypot(self._gains.standard_deviation, self._gains.uncertainty)
            for sensor, value, one in zip(
                self._layout.sensors, self._gains.value, spread, strict=True
            ):
                if np.isfinite(value):
                    result[sensor.name] = (float(value), float(one))
        return result

    @property
    def gain_limits(self) -> dict[str, tuple[float, float]]:
        """
        Relative errors of gain found, and named alone, in 99 % of cases by data as the newest 6 s.

        Infinite: none would be.
        """
        if self._gains is None:
            return self._by_name(np.full((2, len(self._layout.sensors)), np.inf))
        return self._by_name(self._limits(self._gains))

    @property
    def least_gain_limits(self) -> dict[str, tuple[float, float]]:
        """The same for the window of the stream so far, short or long, that tells most."""
        return self._by_name(self._least_limits)

    def _limits(self, gains: Gains) -> Reals:
        limits = gain_limits(gains, self._significant, self._tolerance)
        return np.stack((limits.found, limits.named))

    def _by_name(self, limits: Reals) -> dict[str, tuple[float, float]]:
        return {
            sensor.name: (float(found), float(named))
            for sensor, (found, named) in zip(self._layout.sensors, limits.T, strict=True)
        }

    def _judge(self, chunk: Chunk) -> None:
        self._chunks.append(chunk)
        self._keep(chunk.means)
        shown, right = self._evaluate()
        related = {fault for fault in shown if fault[1] in RELATED}
        if related == self._related:
            newest = sums_of(chunk)
            bands = len(self._spectra.bands)
            newest = replace(newest, products=newest.products[:bands], power=newest.power[:bands])
            for window in self._long.add(newest):
                self._look_longer(window, shown, right)
        else:
            self._related = related
            self._long.restart()
        self._update(shown, right)

    def _look_longer(
        self, window: StretchSums, shown: dict[Fault, Said], right: set[Fault]
    ) -> None:
        """Add the wrong gains that a long window shows."""
        noise, valid = self._noise(window)
        search = self._search(self._sums(window, noise, valid))
        found, absent = self._factors(search)
        wrong = {channel for channel, condition in shown if condition in RELATED}
        for fault, said in found.items():
            if fault[0] not in wrong and fault[1] is Condition.GAIN:
                shown[fault] = said
                self._seen_from[fault] = window.first_index
                right.discard(fault)
        right |= {one for one in absent if one not in shown and one[1] is Condition.GAIN}

    def _keep(self, means: Reals) -> None:
        for mean in means:
            self._means.append(mean)
            self._gathered.append(mean)
            if len(self._gathered) == MEANS_PER_MEAN:
                self._long_means.append(np.mean(self._gathered, axis=0))
                self._gathered = []

    def _evaluate(self) -> tuple[dict[Fault, Said], set[Fault]]:
        short = together([sums_of(chunk) for chunk in self._chunks])
        noise, valid = self._noise(short)
        bands = slice(0, len(self._spectra.bands))
        search = self._search(_part(self._sums(short, noise, valid), bands))
        self._gains = search.gains()
        shown, right = self._factors(search)
        good = search.used.copy()
        named = {channel for channel, _ in shown}
        good |= valid & np.isin(np.arange(len(good)), list(set(search.left_out) - named))
        mismatch = np.maximum(
            MISMATCHES * search.mismatch(search.comparison),
            OWN_MISMATCHES * search.own_mismatch(search.comparison),
        )
        self._hum(search.used, good, mismatch, noise, shown, right)
        self._drift(search.used, good, noise, shown, right)
        return shown, right

    def _noise(self, stretch: StretchSums) -> tuple[Reals, Flags]:
        """Give the noise of a sample, and the channels that have samples and a known noise."""
        noise = self._spectra.noise
        known = np.isfinite(noise)
        # Below it is rounding.
        noise = np.maximum(np.where(known, noise, 1.0), 1e-9 * stretch.largest)
        return noise, stretch.valid & known

    def _search(self, sums: BandSums) -> Contradictions:
        return Contradictions(self._redundancy, sums, self._tolerance, self._significant)

    def _factors(self, search: Contradictions) -> tuple[dict[Fault, Said], set[Fault]]:
        limits = self._limits(search.gains())
        self._least_limits = np.minimum(self._least_limits, limits)
        amounts = {fault: finding.amount for fault, finding in self._standing.items()}
        return wrong_factors(
            search, self._redundancy.kinds, self._sentences, self._significant, self._tolerance,
            amounts,
        )  # fmt: skip

    def _sums(self, stretch: StretchSums, noise: Reals, valid: Flags) -> BandSums:
        orders = self._redundancy.orders
        count = len(stretch.products)
        power = stretch.power
        total = np.where(power[:, :1] > 0, power[:, :1], 1.0)
        at_motion = (power[:, 1:] / total)[:, orders]
        keep = np.outer(valid, valid)
        return BandSums(
            np.where(keep, stretch.products, 0.0),
            self._spectra.bins_per_sum[:count] * stretch.segments,
            noise**2 * self._spectra.noise_power[:count],
            noise**2 * at_motion,
            valid,
        )

    def _hum(
        self, used: Flags, judged: Flags, mismatch: Reals, noise: Reals,
        shown: dict[Fault, Said], right: set[Fault],
    ) -> None:  # fmt: skip
        """Look for hum in the newest chunk; it counts if the chunks before had it too."""
        chunk = self._chunks[-1]
        every = self._sums(sums_of(chunk), noise, chunk.valid)
        lines: dict[int, dict[float, tuple[float, set[int]]]] = {}
        limits = np.zeros(len(used))
        for i, frequency in enumerate(self._spectra.lines):
            begin = len(self._spectra.bands) + 4 * i
            line = LineSums(
                frequency, *(_part(every, slice(begin + k, begin + k + 1)) for k in range(4))
            )
            # Spectrum of a sine of amplitude 1.
            scale = self._spectra.omega[begin] ** self._redundancy.orders
            scale = scale * WINDOW[2] * self._spectra.length / 2
            found, limit = hum_at(
                self._redundancy, line, used, judged, mismatch, (HUM_SIZE * noise * scale) ** 2
            )
            limits = np.maximum(limits, np.sqrt(limit) / scale)
            for channel, one in found.items():
                limits[[channel, *one.rivals]] = np.inf
                for suspect in (channel, *one.rivals):
                    amplitude = float(np.sqrt(one.size) / scale[suspect])
                    others = {channel, *one.rivals} - {suspect}
                    lines.setdefault(suspect, {})[frequency] = (amplitude, others)
        self._hums.append(lines)
        if len(self._hums) == CHUNKS:
            for channel, own in lines.items():
                lasting = {
                    frequency: amplitude
                    for frequency, (amplitude, _) in own.items()
                    if all(frequency in before.get(channel, {}) for before in self._hums)
                }
                if lasting:
                    rivals = set.intersection(*(own[frequency][1] for frequency in lasting))
                    shown[channel, Condition.HUM] = (
                        max(lasting.values()),
                        self._layout.sensors[channel].kind.unit,
                        self._sentences.hum(channel, lasting, sorted(rivals)),
                    )
        right.update(self._absent(Condition.HUM, limits, HUM_SIZE * noise))

    def _drift(
        self, used: Flags, judged: Flags, noise: Reals,
        shown: dict[Fault, Said], right: set[Fault],
    ) -> None:  # fmt: skip
        # Noise of a mean under the window, of segments that overlap by half.
        share = np.sqrt((WINDOW**2).sum() / self._spectra.length) / WINDOW[2]
        limits = np.zeros(len(used))
        for means, size, averaged in (
            (self._means, DRIFT_SIZES[0], 1),
            (self._long_means, DRIFT_SIZES[1], MEANS_PER_MEAN),
        ):
            if len(means) < LEAST_MEANS:
                continue
            found, limit = drift_in(
                self._redundancy, np.array(means), used, judged, size * noise,
                noise * share / np.sqrt(averaged),
            )  # fmt: skip
            limits = np.maximum(limits, limit)
            hop = self._spectra.hop * averaged * len(means)
            for channel, one in found.items():
                for suspect in (channel, *one.rivals):
                    limits[suspect] = np.inf
                    alike = [k for k in (channel, *one.rivals) if k != suspect]
                    sentence = self._sentences.drift(suspect, one.size, hop / self._rate, alike)
                    unit = self._layout.sensors[suspect].kind.unit
                    shown[suspect, Condition.DRIFT] = (one.size, unit, sentence)
        right.update(self._absent(Condition.DRIFT, limits, DRIFT_SIZES[-1] * noise))

    def _absent(self, condition: Condition, limits: Reals, least: Reals) -> set[Fault]:
        """Name standing faults that would be seen at half their size, or at the least."""
        return {
            (channel, one)
            for (channel, one), finding in self._standing.items()
            if one is condition
            and limits[channel] <= max(0.5 * finding.amount, 1.5 * float(least[channel]))
        }

    def _update(self, shown: dict[Fault, Said], right: set[Fault]) -> None:
        """Let findings appear at once, and go when the channel has been right for a while."""
        first, last = self._chunks[0].first_index, self._chunks[-1].next_index
        for fault in [one for one in self._standing if one not in shown]:
            channel, condition = fault
            # Also hum and drift are not told of a channel with another sign or gain.
            replaced = any((channel, other) in shown for other in RELATED)
            self._right[fault] = self._right.get(fault, 0) + (fault in right)
            if replaced or self._right[fault] >= EVALUATIONS_TO_CLEAR:
                del self._standing[fault], self._right[fault]
        for (channel, condition), (amount, unit, sentence) in shown.items():
            before = self._standing.get((channel, condition))
            self._right.pop((channel, condition), None)
            self._standing[channel, condition] = Finding(
                self._layout.sensors[channel].name, condition,
                before.first_index if before else self._seen_from.get((channel, condition), first),
                last, amount, unit, sentence,
            )  # fmt: skip
        self._seen_from.clear()


def _part(sums: BandSums, which: slice) -> BandSums:
    return BandSums(
        sums.products[which], sums.counts[which], sums.noise[which],
        sums.noise_at_motion[which], sums.valid,
    )  # fmt: skip


def _named(links: Flags, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    return {
        name: tuple(names[j] for j in np.flatnonzero(row).tolist())
        for name, row in zip(names, links, strict=True)
    }
