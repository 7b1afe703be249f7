# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Channels that contradict the others: which to leave out, and by what factor they are wrong."""

from dataclasses import dataclass

from identnl_ros.core.quality.consistency_spectra import CORRELATED
from identnl_ros.core.quality.leave_one_out import Flags, leave_one_out, LeaveOneOut, Reals
from identnl_ros.core.quality.redundancy import EQUAL_SHARE, Redundancy
import numpy as np
from numpy.typing import NDArray

# Errors of gain or direction that every stand has, relative to the motion at the sensor; they
# limit what accurate channels may say about others.
USUAL_MISMATCH = 0.01
# Largest number of channels left out, and share of the redundancy of a group.
MOST_LEFT_OUT = 8
LARGEST_SHARE = 1 / 3
# Excess over noise from which a channel is a candidate, standard deviations.
NOTICED = 8.0
# Standard deviations of the mismatch that the data show.
MISMATCHES = 4.0
# Bands in which a prediction has this many times the power of its noise show motion.
POWER_OVER_NOISE = 10.0
# Difference of evidence between two channels, as a log likelihood, below which both are named.
EQUAL_EVIDENCE = 30.0


@dataclass(frozen=True)
class BandSums:
    """
    What a stretch of data says, by frequency bands.

    Parameters
    ----------
    products : ndarray, shape (n_bands, n_channels, n_channels)
        Real parts of the products of the spectra, summed.
    counts : ndarray, shape (n_bands,)
        Of summands.
    noise : ndarray, shape (n_bands, n_channels)
        Variance of a spectrum under the noise.
    noise_at_motion : ndarray, shape (n_bands, n_channels)
        The same, weighted by where in the band the motion is.
    valid : ndarray of bool, shape (n_channels,)

    """

    products: Reals
    counts: Reals
    noise: Reals
    noise_at_motion: Reals
    valid: Flags


@dataclass(frozen=True)
class Comparison:
    """
    Every channel against what the used ones say of it.

    Parameters
    ----------
    fit : LeaveOneOut
    read, error, predicted, agreement : ndarray, shape (n_bands, n_channels)
        Sums: power of readings, of errors, of predictions; real part of prediction times reading.
    noise : ndarray, shape (n_bands, n_channels)
        Variance of an error under the noise.
    mismatch : ndarray, shape (n_bands, n_channels)
        Variance of an error per unit of squared relative mismatch of all channels.
    cross : ndarray, shape (n_bands, n_channels, n_channels)
        Prediction of the first times reading of the second.

    """

    fit: LeaveOneOut
    read: Reals
    error: Reals
    predicted: Reals
    agreement: Reals
    noise: Reals
    mismatch: Reals
    cross: Reals


@dataclass(frozen=True)
class Gains:
    """
    Factors between readings and what the other channels say.

    Parameters
    ----------
    value : ndarray, shape (n_channels,)
        NaN: nothing to tell it from.
    standard_deviation : ndarray, shape (n_channels,)
        From noise.
    uncertainty : ndarray, shape (n_channels,)
        From the mismatch of the other channels.
    low, high : ndarray, shape (n_channels,)
        Between which the factor is, whatever share of the differences is noise of either side.
    coherence : ndarray, shape (n_channels,)
        Squared, of reading and prediction.

    """

    value: Reals
    standard_deviation: Reals
    uncertainty: Reals
    low: Reals
    high: Reals
    coherence: Reals


class Contradictions:
    """
    Leaves out channels until the rest agrees.

    Forward selection by the largest drop of the log likelihood (the largest normalised residual,
    Baarda 1968); a channel that the rest then finds to be right is taken back.

    Parameters
    ----------
    redundancy : Redundancy
    sums : BandSums
    tolerance : float
        Relative errors that are no fault.

    """

    def __init__(self, redundancy: Redundancy, sums: BandSums, tolerance: float) -> None:
        self._rows = redundancy.rows
        self.sums = sums
        self._tolerance = tolerance
        self.motion = motion_at_sensors(redundancy, sums)
        self._variance = np.maximum(sums.noise + USUAL_MISMATCH**2 * self.motion, TINY)
        self._groups = redundancy.groups(redundancy.rows)
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
            self.used[weakest] = True
            self.comparison = self.compare(self.used)
        self.left_out = tuple(left_out)

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

    def excess(self, found: Comparison) -> Reals:
        """Weigh the power of errors beyond noise, shape (n_channels,)."""
        beyond = found.error - self.sums.counts[:, np.newaxis] * found.noise
        return np.asarray(np.where(found.fit.told, beyond / found.fit.variance, 0.0).sum(axis=0))

    def own_mismatch(self, found: Comparison) -> Reals:
        """Estimate each channel's error relative to the motion, shape (n_channels,)."""
        counts = self.sums.counts[:, np.newaxis]
        # Where there is no motion, noise tells nothing of it.
        weights = np.where(found.fit.told, found.mismatch / found.fit.variance**2, 0.0)
        excess = (weights * (found.error - counts * found.noise)).sum(axis=0)
        excess -= np.sqrt(CORRELATED * (counts * (weights * found.noise) ** 2).sum(axis=0))
        expected = (weights * counts * found.mismatch).sum(axis=0)
        return np.asarray(np.sqrt(np.clip(excess, 0.0, None) / np.maximum(expected, TINY)))

    def mismatch(self, found: Comparison) -> Reals:
        """
        Estimate the usual relative error of each channel's group: the median.

        Channels that are left out count, so that leaving out the worst does not make the rest
        look better than it is.
        """
        result = np.full(len(self._groups), USUAL_MISMATCH)
        every = self.own_mismatch(found)
        for group in np.unique(self._groups):
            members = self._groups == group
            judged = members & self.sums.valid & found.fit.told
            if (judged & self.used).any():
                result[members] = np.median(every[judged])
        return result

    def limit(self, found: Comparison) -> Reals:
        """Excess that usual errors explain, shape (n_channels,)."""
        expected = self.sums.counts[:, np.newaxis] * found.mismatch / found.fit.variance
        largest = (MISMATCHES * self.mismatch(found)) ** 2 * expected.sum(axis=0)
        own = np.maximum(found.read, found.predicted) / found.fit.variance
        # Candidates have half the tolerance.
        return np.asarray(
            np.maximum(np.maximum(largest, (self._tolerance / 2) ** 2 * own.sum(axis=0)), TINY)
        )

    def rivals(self, channel: int) -> tuple[int, ...]:
        """
        Name the channels that could as well be the wrong one.

        Parameters
        ----------
        channel : int
            One that is left out.

        Returns
        -------
        tuple of int

        """
        used = self.used.copy()
        used[channel] = True
        found = self.compare(used)
        evidence = self.excess(found)
        expected = self.sums.counts[:, np.newaxis] * found.mismatch / found.fit.variance
        margin = max(
            EQUAL_EVIDENCE * CORRELATED,
            EQUAL_SHARE * evidence[channel],
            9 * float((self.mismatch(self.comparison) ** 2 * expected.sum(axis=0))[channel]),
        )
        near = used & (self._groups == self._groups[channel])
        near &= found.fit.told & (evidence > evidence[channel] - margin)
        near[channel] = False
        return tuple(int(one) for one in np.flatnonzero(near))

    def gains(self) -> Gains:
        """
        Estimate factors against the channels that agree.

        Returns
        -------
        Gains

        """
        found, counts = self.comparison, self.sums.counts[:, np.newaxis]
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
            ends = np.stack((agreement / predicted, read / agreement))
            ratio = found.noise / np.maximum(own + theirs, TINY)
            at_motion = self.sums.noise_at_motion / np.maximum(own, TINY)
            variance = (own * at_motion + value**2 * theirs * at_motion) * ratio
            spread = (weights**2 * found.predicted * variance).sum(axis=0)
            deviation = np.sqrt(CORRELATED / 2 * spread) / motion
            uncertain = self.mismatch(found) * np.sqrt(total(counts * found.mismatch) / predicted)
            coherence = agreement**2 / (predicted * read)
        return Gains(
            np.where(moves.any(axis=0), value, np.nan),
            deviation, uncertain, ends.min(axis=0), ends.max(axis=0), coherence,
        )  # fmt: skip

    def exchange(self, one: int, other: int) -> float:
        """
        Tell what of the contradiction remains if two channels are exchanged.

        Parameters
        ----------
        one, other : int

        Returns
        -------
        float
            Share; 1 where nothing can be said.

        """
        found, counts = self.comparison, self.sums.counts
        remaining = before = 0.0
        for first, second in ((one, other), (other, one)):
            weight = 1 / found.fit.variance[:, first]
            noise = self.sums.noise[:, first] + np.clip(
                found.noise[:, second] - self.sums.noise[:, second], 0.0, None
            )
            error = (
                found.read[:, first]
                - 2 * found.cross[:, second, first]
                + found.predicted[:, second]
            )
            remaining += float((weight * (error - counts * noise)).sum())
            before += float(
                (weight * (found.error[:, first] - counts * found.noise[:, first])).sum()
            )
        return remaining / before if before > 0 else 1.0

    def _evidence(self, found: Comparison) -> Reals:
        """Excess of the channels that are candidates for leaving out; others 0."""
        counts = self.sums.counts[:, np.newaxis]
        noise = np.maximum(found.noise, TINY)
        surplus = ((found.error - counts * noise) / noise).sum(axis=0)
        noticed = surplus > NOTICED * np.sqrt(CORRELATED * self.sums.counts.sum())
        excess = self.excess(found)
        own = np.maximum(found.read, found.predicted) / found.fit.variance
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


TINY = np.finfo(float).tiny


def compared(fit: LeaveOneOut, products: Reals, noise: Reals, motion: Reals) -> Comparison:
    """
    Sum up errors and predictions.

    Parameters
    ----------
    fit : LeaveOneOut
    products : ndarray, shape (n_bands, n_channels, n_channels)
    noise, motion : ndarray, shape (n_bands, n_channels)
        Variances of the readings: noise; motion at the sensor.

    Returns
    -------
    Comparison

    """
    crossed = fit.errors @ products
    own = np.einsum('bii->bi', crossed)
    read = np.einsum('bii->bi', products)
    error = np.einsum('bij,bij->bi', crossed, fit.errors)
    squares = fit.errors**2
    return Comparison(
        fit,
        read,
        error,
        np.clip(read - 2 * own + error, 0.0, None),
        read - own,
        np.einsum('bij,bj->bi', squares, noise),
        np.einsum('bij,bj->bi', squares, motion),
        products - crossed,
    )


def motion_at_sensors(redundancy: Redundancy, sums: BandSums) -> Reals:
    """
    Estimate the mean power of the motion at every sensor, whatever its direction.

    Parameters
    ----------
    redundancy : Redundancy
    sums : BandSums

    Returns
    -------
    ndarray, shape (n_bands, n_channels)

    """
    fit = leave_one_out(redundancy.rows, np.maximum(sums.noise, TINY), sums.valid).fit
    coordinates = fit @ sums.products @ np.swapaxes(fit, 1, 2)
    power = np.einsum(
        'kip,bpq,kiq->bi', redundancy.nearby, coordinates, redundancy.nearby, optimize=True
    )
    return np.asarray(np.clip(power / sums.counts[:, np.newaxis], 0.0, None))


def _largest(evidence: Reals, among: NDArray[np.bool_]) -> list[int]:
    """Give the channel with the most evidence, if any has some."""
    own = np.where(among, evidence, 0.0)
    return [int(np.argmax(own))] if own.max(initial=0.0) > 0 else []
