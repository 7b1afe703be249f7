# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Channels that contradict the others: which to leave out, and by what factor they are wrong."""

from dataclasses import replace

from identnl_ros.core.quality.channel_comparison import (
    BandSums,
    compared,
    Comparison,
    Exchange,
    Gains,
    MISMATCHES,
    motion_at_sensors,
    TINY,
)
from identnl_ros.core.quality.consistency_spectra import CORRELATED
from identnl_ros.core.quality.equal_pairs import pair_drops
from identnl_ros.core.quality.leave_one_out import Flags, leave_one_out, Reals
from identnl_ros.core.quality.redundancy import EQUAL_SHARE, Redundancy
import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

# Errors of gain or direction that every stand has, relative to the motion at the sensor; they
# limit what accurate channels may say about others.
USUAL_MISMATCH = 0.01
# Largest number of channels left out, and share of the redundancy of a group.
MOST_LEFT_OUT = 8
LARGEST_SHARE = 1 / 3
# Excess over noise from which a channel is a candidate, standard deviations.
NOTICED = 8.0
# Standard deviations between two estimates from noise alone: 99 %.
REPEATED = float(np.sqrt(2) * norm.ppf(0.99))
# Bands in which a prediction has this many times the power of its noise show motion.
POWER_OVER_NOISE = 10.0
# Pairs that are looked at instead of a channel.
MOST_PAIRS = 5
# Below it a factor does not describe what differs; it may be noise, or change within the stretch.
LEAST_COHERENCE = 0.7
# Difference of evidence between two channels, as a log likelihood, below which both are named.
EQUAL_EVIDENCE = 30.0


class Contradictions:
    """
    Leaves out channels until the rest agrees.

    Forward selection by the largest drop of the log likelihood (the largest normalised residual,
    Baarda 1968); a channel that the rest then finds to be right is taken back. If a pair explains
    everything, it replaces what was left out one after the other. Then channels follow whose
    factor alone is wrong: all the motion speaks of it, the noise of other frequencies does not.

    Parameters
    ----------
    redundancy : Redundancy
    sums : BandSums
    tolerance : float
        Relative errors that are no fault.
    significant : float
        Standard deviations of the noise that a factor must be off by, beyond the tolerance.

    """

    def __init__(
        self, redundancy: Redundancy, sums: BandSums, tolerance: float, significant: float
    ) -> None:
        self._rows, self._nearby = redundancy.rows, redundancy.nearby
        self.sums = sums
        self._tolerance = tolerance
        self._significant = significant
        self.motion = motion_at_sensors(redundancy, sums)
        self._variance = np.maximum(sums.noise + USUAL_MISMATCH**2 * self.motion, TINY)
        self._groups = redundancy.sets
        self.used = sums.valid.copy()
        self.comparison = self.compare(self.used)
        most = self._most_left_out(self.comparison)
        left_out: list[int] = []
        while True:
            evidence = self._evidence(self.comparison)
            new = [
                best
                for group, limit in most.items()
                for best in _largest(evidence, self.used & (self._groups == group))
                if sum(self._groups[one] == group for one in left_out) < limit
            ]
            if not new:
                break
            left_out += new
            self.used[new] = False
            self.comparison = self.compare(self.used)
        while left_out:
            excess = self.excess(self.comparison) / self.limit(self.comparison)
            weakest = min(left_out, key=lambda one: float(excess[one]))
            if excess[weakest] > 1:
                break
            left_out.remove(weakest)
            self._use(weakest, True)
        self._alternatives: dict[int, list[tuple[int, int]]] = {}
        for group in np.unique(self._groups[left_out]):
            left_out = self._paired(left_out, int(group))
        self._factors = self._wrong_factors(most, left_out)
        self.left_out = (*left_out, *self._factors)

    def _use(self, channel: int, used: bool) -> None:
        self.used[channel] = used
        self.comparison = self.compare(self.used)

    def _paired(self, left_out: list[int], group: int) -> list[int]:
        """Let a pair take the place of what is left out of a group, if it explains as much."""
        own = [one for one in left_out if self._groups[one] == group]
        if len(own) < 2:
            return left_out
        whole = self.used.copy()
        whole[own] = True
        found = self.compare(whole)
        among = whole & (self._groups == group)
        drops = pair_drops(found.fit, self._variance, self.sums, among)
        best = tuple(int(one) for one in np.unravel_index(np.argmax(drops), drops.shape))
        if set(best) != set(own):
            used, comparison = self.used, self.comparison
            self.used = whole.copy()
            self.used[list(best)] = False
            self.comparison = self.compare(self.used)
            evidence = self._evidence(self.comparison)
            if not drops[best] > 0 or _largest(evidence, self.used & among):
                self.used, self.comparison = used, comparison
                return left_out
        margin = self._margin(found, np.asarray(best), float(drops[best]))
        self._alternatives[group] = [
            (int(one), int(other))
            for one, other in np.argwhere(np.triu(drops > drops[best] - margin))
            if {int(one), int(other)} != set(best)
        ]
        return [one for one in left_out if one not in own] + list(best)

    def _margin(self, found: Comparison, channels: NDArray[np.int64], largest: float) -> float:
        """Difference of evidence that tells nothing."""
        expected = self.sums.counts[:, np.newaxis] * found.mismatch / found.fit.variance
        usual = self.mismatch(self.comparison) ** 2 * expected.sum(axis=0)
        return max(
            EQUAL_EVIDENCE * CORRELATED, EQUAL_SHARE * largest, 9 * float(usual[channels].sum())
        )

    def _wrong_factors(self, most: dict[int, int], left_out: list[int]) -> list[int]:
        """
        Leave out channels that noise hides unless the motion alone is looked at.

        Noise tells whom to suspect; the mismatch must not explain it once the suspect does not
        add to that of the others.
        """
        factors: list[int] = []
        for group, limit in most.items():
            count = limit - sum(self._groups[one] == group for one in left_out)
            for _ in range(count):
                gains = self.gains()
                exact = replace(gains, uncertainty=np.zeros_like(gains.uncertainty))
                suspect = self.used & (self._groups == group)
                suspect &= exact.wrong(self._significant, self._tolerance)
                suspect &= gains.coherence > LEAST_COHERENCE
                best = _largest(gains.weight(), suspect)
                if not best:
                    break
                self._use(best[0], False)
                if not self.gains().wrong(self._significant, self._tolerance)[best[0]]:
                    self._use(best[0], True)
                    break
                factors += best
        return factors

    def compare(self, used: Flags) -> Comparison:
        """
        Compare every channel with those that are used.

        Parameters
        ----------
        used : ndarray of bool, shape (n_channels,)

        Returns
        -------
        Comparison

        """
        fit = leave_one_out(self._rows, self._variance, used)
        return compared(fit, self.sums.products, self.sums.noise, self.motion)

    def speaks(self, found: Comparison) -> Flags:
        """Tell which bands hold more than noise, shape (n_bands, n_channels)."""
        seen = np.maximum(found.read, found.predicted)
        noise = self.sums.counts[:, np.newaxis] * found.noise
        return np.asarray(found.fit.told & (seen > POWER_OVER_NOISE * noise))

    def excess(self, found: Comparison) -> Reals:
        """Weigh the power of errors beyond noise, shape (n_channels,)."""
        beyond = found.error - self.sums.counts[:, np.newaxis] * found.noise
        speaks = self.speaks(found)
        return np.asarray(np.where(speaks, beyond / found.fit.variance, 0.0).sum(axis=0))

    def own_mismatch(self, found: Comparison, deviations: float = -1.0) -> Reals:
        """
        Estimate each channel's error relative to the motion, shape (n_channels,).

        Standard deviations of the noise are added; by default one is taken off.
        """
        counts = self.sums.counts[:, np.newaxis]
        # Where there is no motion, noise tells nothing of it.
        weights = np.where(found.fit.told, found.mismatch / found.fit.variance**2, 0.0)
        excess = (weights * (found.error - counts * found.noise)).sum(axis=0)
        noise = np.sqrt(CORRELATED * (counts * (weights * found.noise) ** 2).sum(axis=0))
        excess += deviations * noise
        expected = (weights * counts * found.mismatch).sum(axis=0)
        return np.asarray(np.sqrt(np.clip(excess, 0.0, None) / np.maximum(expected, TINY)))

    def mismatch(self, found: Comparison, repeated: float = 0.0) -> Reals:
        """
        Estimate the usual relative error of each channel's group: the median of `own_mismatch`.

        Standard deviations of the median from noise may be added; there are as many independent
        errors as the group has redundant channels.

        Channels that are left out count, so that leaving out the worst does not make the rest
        look better than it is.
        """
        result = np.full(len(self._groups), USUAL_MISMATCH)
        every = self.own_mismatch(found)
        for group in np.unique(self._groups):
            members = self._groups == group
            judged = members & self.sums.valid & found.fit.told
            if (judged & self.used).any():
                if repeated:
                    left = (self._variance / found.fit.variance)[:, judged & self.used].sum(axis=1)
                    scatter = repeated * np.sqrt(np.pi / 2 / max(float(left.min()), 1.0))
                    every = self.own_mismatch(found, scatter - 1)
                result[members] = np.median(every[judged])
        return result

    def limit(self, found: Comparison) -> Reals:
        """Excess that usual errors and noise explain, shape (n_channels,)."""
        weight = self.speaks(found) / found.fit.variance
        expected = weight * self.sums.counts[:, np.newaxis] * found.mismatch
        largest = (MISMATCHES * self.mismatch(found)) ** 2 * expected.sum(axis=0)
        own = weight * np.maximum(found.read, found.predicted)
        noise = CORRELATED * (self.sums.counts[:, np.newaxis] * (weight * found.noise) ** 2)
        # Candidates have half the tolerance.
        usual = np.maximum(largest, (self._tolerance / 2) ** 2 * own.sum(axis=0))
        return np.asarray(np.maximum(usual + NOTICED * np.sqrt(noise.sum(axis=0)), TINY))

    def explanations(self, channel: int) -> tuple[tuple[int, ...], ...]:
        """
        Name what explains the contradictions as well without blaming a channel.

        The evidence is nearly as large, nothing is wrong any more with the channel, and what is
        left out instead is wrong by what the rest then says.

        Parameters
        ----------
        channel : int
            One that is left out.

        Returns
        -------
        tuple of tuple of int
            Each: all that is then left out.

        """
        used = self.used.copy()
        used[channel] = True
        found = self.compare(used)
        if channel in self._factors:
            evidence = self.gains(found).weight()
            margin = max(2 * EQUAL_EVIDENCE, EQUAL_SHARE * float(evidence[channel]))
        else:
            evidence = self.excess(found)
            margin = self._margin(found, np.array([channel]), float(evidence[channel]))
        near = used & (self._groups == self._groups[channel])
        near &= found.fit.told & (evidence > evidence[channel] - margin)
        near[channel] = False
        others = [one for one in self.left_out if one != channel]
        result = [(*others, int(one)) for one in np.flatnonzero(near)]
        group = int(self._groups[channel])
        beside = [one for one in self.left_out if self._groups[one] != group]
        beside += [one for one in self._factors if self._groups[one] == group]
        for pair in self._alternatives.get(group, []):
            if channel not in (*pair, *self._factors):
                result.append((*beside, *pair))
        every = dict.fromkeys(tuple(sorted(one)) for one in result)
        return tuple(one for one in every if self._explain(one, channel))

    def outvoting(self, channel: int) -> tuple[int, ...]:
        """
        Name two channels that, both wrong, explain as much as one that is blamed alone.

        Parameters
        ----------
        channel : int
            One that is left out, the only one of its group.

        Returns
        -------
        tuple of int
            Empty: none.

        """
        group = self._groups == self._groups[channel]
        if group[list(self.left_out)].sum() > 1:
            return ()
        used = self.used.copy()
        used[channel] = True
        found = self.compare(used)
        among = used & group
        among[channel] = False
        evidence = float(self.excess(found)[channel])
        drops = np.triu(pair_drops(found.fit, self._variance, self.sums, among))
        least = evidence - self._margin(found, np.array([channel]), evidence)
        order = np.argsort(drops, axis=None)[::-1][:MOST_PAIRS]
        others = [one for one in self.left_out if one != channel]
        for one, other in zip(*np.unravel_index(order, drops.shape), strict=True):
            pair = int(one), int(other)
            if drops[pair] > max(least, 0.0) and self._explain((*others, *pair), channel):
                return pair
        return ()

    def _explain(self, left_out: tuple[int, ...], channel: int) -> bool:
        """Tell whether all that is left out is wrong, and a channel is not."""
        found = self.without(left_out)
        gains = self.gains(found)
        factor = gains.wrong(self._significant, self._tolerance)
        factor &= gains.coherence > LEAST_COHERENCE
        acquitted = (
            not factor[channel] and self.excess(found)[channel] <= self.limit(found)[channel]
        )
        wrong = factor | (self._evidence(found) > 0)
        return acquitted and bool(wrong[[*set(left_out) - set(self.left_out)]].all())

    def without(self, channels: tuple[int, ...]) -> Comparison:
        """
        Compare every channel with all valid ones but some.

        Parameters
        ----------
        channels : tuple of int

        Returns
        -------
        Comparison

        """
        used = self.sums.valid.copy()
        used[list(channels)] = False
        return self.compare(used)

    def gains(self, found: Comparison | None = None) -> Gains:
        """
        Estimate factors against what other channels say.

        Parameters
        ----------
        found : Comparison or None
            None: with the channels that agree.

        Returns
        -------
        Gains

        """
        found = found or self.comparison
        counts = self.sums.counts[:, np.newaxis]
        own = self.sums.noise
        both = found.noise
        # A channel that predicts does not predict itself: the errors' noise is its own and theirs.
        theirs = np.clip(both - own, 0.0, None)
        told = found.fit.told & self.sums.valid
        moves = told & (found.predicted > POWER_OVER_NOISE * counts * both)
        weights = np.where(moves, 1 / found.fit.variance, 0.0)

        def total(values: Reals) -> Reals:
            return np.asarray((weights * values).sum(axis=0))

        with np.errstate(divide='ignore', invalid='ignore'):
            predicted = total(found.predicted)
            agreement = total(found.agreement)
            read = total(found.read)
            motion = total(found.predicted - counts * theirs)
            value = agreement / motion
            left = read - 2 * value * agreement + value**2 * predicted
            expected = own + value**2 * theirs
            doubt = np.abs(left - total(counts * expected))
            chance = np.sqrt(CORRELATED * (counts * (weights * expected) ** 2).sum(axis=0))
            doubt = np.maximum(doubt, chance) / value**2
            ends = np.stack((agreement / (motion + doubt), agreement / (motion - doubt)))
            extremes = np.stack((agreement / predicted, read / agreement))
            ends = np.clip(ends, extremes.min(axis=0), np.maximum(value, extremes.max(axis=0)))
            ends = np.where(motion > doubt, ends, extremes)
            ratio = found.noise / np.maximum(own + theirs, TINY)
            at_motion = self.sums.noise_at_motion / np.maximum(own, TINY)
            variance = (own * at_motion + value**2 * theirs * at_motion) * ratio
            spread = (weights**2 * found.predicted * variance).sum(axis=0)
            deviation = np.sqrt(CORRELATED / 2 * spread) / motion
            share = np.sqrt(total(counts * found.mismatch) / predicted)
            uncertain = self.mismatch(found) * share
            elsewhere = self.mismatch(found, REPEATED) * share
            coherence = agreement**2 / (predicted * read)
            response = np.einsum('bi,bij,bij->ij', weights, found.fit.errors, found.cross)
            response /= motion[:, np.newaxis]
            seen = found.fit.fit @ self.sums.products @ np.swapaxes(found.fit.fit, 1, 2)
            along, *across = (
                total(((self._nearby[0] @ seen) * rows).sum(axis=2)) for rows in self._nearby
            )
            lean = np.hypot(*across) / along
        return Gains(
            np.where(moves.any(axis=0), value, np.nan),
            deviation, uncertain, ends.min(axis=0), ends.max(axis=0), coherence, elsewhere,
            np.nan_to_num(lean), response,
        )  # fmt: skip

    def exchange(self, one: int, other: int) -> Exchange:
        """
        Tell what of the contradiction of two channels remains under three explanations.

        Parameters
        ----------
        one, other : int

        Returns
        -------
        Exchange

        """
        found, counts, gains = self.comparison, self.sums.counts, self.gains()
        before = exchanged = inverted = scaled = 0.0
        speaks = self.speaks(found)[:, [one, other]].any(axis=1)
        for first, second in ((one, other), (other, one)):
            weight = speaks / found.fit.variance[:, first]
            read, own = found.read[:, first], self.sums.noise[:, first]
            theirs = np.clip(found.noise - self.sums.noise, 0.0, None)

            def left(
                agreement: Reals, predicted: Reals, factor: float, noise: Reals,
                weight: Reals = weight, read: Reals = read, own: Reals = own,
            ) -> float:  # fmt: skip
                error = read - 2 * factor * agreement + factor**2 * predicted
                return float((weight * (error - counts * (own + factor**2 * noise))).sum())

            mine = found.agreement[:, first], found.predicted[:, first]
            factor = float(np.nan_to_num(gains.value[first], nan=1.0))
            before += left(*mine, 1.0, theirs[:, first])
            inverted += left(*mine, -1.0, theirs[:, first])
            scaled += left(*mine, factor, theirs[:, first])
            exchanged += left(
                found.cross[:, second, first], found.predicted[:, second], 1.0, theirs[:, second]
            )
        margin = EQUAL_EVIDENCE * CORRELATED + float(self.limit(found)[[one, other]].sum())
        return Exchange(before, exchanged, inverted, scaled, margin)

    def _evidence(self, found: Comparison) -> Reals:
        """Excess of the channels that are candidates for leaving out; others 0."""
        counts = self.sums.counts[:, np.newaxis]
        speaks = self.speaks(found)
        noise = np.maximum(found.noise, TINY)
        surplus = (speaks * (found.error - counts * noise) / noise).sum(axis=0)
        noticed = surplus > NOTICED * np.sqrt(CORRELATED * (speaks * counts).sum(axis=0))
        excess = self.excess(found)
        own = speaks * np.maximum(found.read, found.predicted) / found.fit.variance
        beyond = excess > (self._tolerance / 2) ** 2 * own.sum(axis=0)
        return np.where(noticed & beyond & found.fit.told, excess, 0.0)

    def _most_left_out(self, found: Comparison) -> dict[int, int]:
        """Limit what may be left out of every group of channels."""
        result = {}
        for group in np.unique(self._groups[found.fit.told]):
            members = np.flatnonzero((self._groups == group) & self.used)
            redundant = len(members) - np.linalg.matrix_rank(self._rows[members])
            result[int(group)] = min(MOST_LEFT_OUT, max(1, int(redundant * LARGEST_SHARE)))
        return result


def _largest(evidence: Reals, among: NDArray[np.bool_]) -> list[int]:
    """Give the channel with the most evidence, if any has some."""
    own = np.where(among, evidence, 0.0)
    return [int(np.argmax(own))] if own.max(initial=0.0) > 0 else []
