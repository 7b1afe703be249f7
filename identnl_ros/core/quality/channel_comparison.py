# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What comparing every channel with the others tells: sums, evidence, factors, exchanges."""

from dataclasses import dataclass

from identnl_ros.core.quality.leave_one_out import Flags, leave_one_out, LeaveOneOut, Reals
from identnl_ros.core.quality.redundancy import Redundancy
import numpy as np

# Error of a direction that is no fault [rad].
DIRECTION_TOLERANCE = float(np.radians(1.0))
# Standard deviations of the mismatch that the data show.
MISMATCHES = 4.0
# Share of the contradiction that may remain if two channels are exchanged.
EXCHANGED = 0.1
TINY = np.finfo(float).tiny


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
        Between which the factor is, if differences that the stated noise does not explain, or
        that it lacks, are noise of either side.
    coherence : ndarray, shape (n_channels,)
        Squared, of reading and prediction.
    elsewhere : ndarray, shape (n_channels,)
        What `uncertainty` may be in other data of the same length, with a probability of 99 %.
    lean : ndarray, shape (n_channels,)
        Largest change of the factor per error of the sensor's direction [1/rad]: motion across
        that goes with the motion along it.
    response : ndarray, shape (n_channels, n_channels)
        Change of the factor of the first per relative change of the second's readings.

    """

    value: Reals
    standard_deviation: Reals
    uncertainty: Reals
    low: Reals
    high: Reals
    coherence: Reals
    elsewhere: Reals
    lean: Reals
    response: Reals

    def limit(self, significant: float) -> Reals:
        """
        Give the errors of the factors that noise and mismatch explain.

        Parameters
        ----------
        significant : float
            Standard deviations of noise.

        Returns
        -------
        ndarray, shape (n_channels,)

        """
        noise, mismatch = significant * self.standard_deviation, MISMATCHES * self.uncertainty
        return np.asarray(np.hypot(noise, mismatch))

    def wrong(self, significant: float, tolerance: float) -> Flags:
        """
        Tell which factors are off by more than is no fault, whatever noise and mismatch did.

        Parameters
        ----------
        significant, tolerance : float

        Returns
        -------
        ndarray of bool, shape (n_channels,)

        """
        limit, harmless = self.limit(significant), self.harmless(tolerance)
        return np.asarray((self.low - limit > 1 + harmless) | (self.high + limit < 1 - harmless))

    def harmless(self, tolerance: float) -> Reals:
        """
        Give the errors of the factors that are no fault: of gain, and of direction.

        Parameters
        ----------
        tolerance : float
            Of gain.

        Returns
        -------
        ndarray, shape (n_channels,)

        """
        return np.asarray(np.hypot(tolerance, DIRECTION_TOLERANCE * self.lean))

    def weight(self) -> Reals:
        """Twice the log likelihood that a factor other than one gains, shape (n_channels,)."""
        variance = self.standard_deviation**2 + self.uncertainty**2
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.asarray(np.nan_to_num((self.value - 1) ** 2 / variance, posinf=0.0))


@dataclass(frozen=True)
class Exchange:
    """
    Evidence against two channels that remains under explanations.

    Parameters
    ----------
    before, exchanged, inverted, scaled : float
        Under none; each has the readings of the other; both have the wrong sign; each has the
        factor that fits best.
    margin : float
        Differences below it are of noise or an inexact layout.

    """

    before: float
    exchanged: float
    inverted: float
    scaled: float
    margin: float

    @property
    def share(self) -> float:
        """What remains if they are exchanged, of what there is; 1 where there is nothing."""
        return self.exchanged / self.before if self.before > 0 else 1.0

    @property
    def likely(self) -> bool:
        """Factors do not explain more."""
        shown = self.before > self.margin and self.share < EXCHANGED
        return shown and self.exchanged < self.scaled + self.margin

    @property
    def may_be_inverted(self) -> bool:
        """Two wrong signs explain as much."""
        return self.inverted < self.exchanged + self.margin


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
    rows = redundancy.nearby.reshape(-1, redundancy.nearby.shape[2])
    power = ((rows @ coordinates) * rows).sum(axis=2)
    power = power.reshape(len(power), len(redundancy.nearby), -1).sum(axis=1)
    return np.asarray(np.clip(power / sums.counts[:, np.newaxis], 0.0, None))
