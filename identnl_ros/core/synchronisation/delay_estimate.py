# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Residual delays between sources and between channels, from the motion they measured."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.resampling import Grid, resample
from identnl_ros.core.synchronisation.segment_spectra import segment_spectra, SegmentSpectra
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

MOST_STEPS = 12
# A step below this share of a standard deviation ends the search.
ENOUGH = 1e-3
# Information below this share of the largest, on one footing, is none.
NOTHING = 1e-9
# Of the scaled information; combinations that have less are left as they are.
WEAKEST = 1e-6
# Trial delays per period of the highest frequency.
TRIALS_PER_PERIOD = 8
# Delays are exact to first order in delay over segment: readings are moved and looked at again.
MOST_ROUNDS = 4


@dataclass(frozen=True)
class DelayEstimate:
    """
    Delays and what is known of them.

    Parameters
    ----------
    names : tuple of str
        Of the sources or channels.
    delays : ndarray, shape (n_names,)
        At the middle of the record, beyond the delays that the layout states; positive: the
        readings are late [s].
    skews : ndarray, shape (n_names,)
        Growth of the delay; 0 where it was not estimated [s/s].
    covariance : ndarray, shape (2 * n_names, 2 * n_names)
        Of the delays, then the skews; infinite variance: not determined by the data.
    duration : float
        Of the record [s].

    """

    names: tuple[str, ...]
    delays: NDArray[np.float64]
    skews: NDArray[np.float64]
    covariance: NDArray[np.float64]
    duration: float

    @property
    def standard_deviations(self) -> NDArray[np.float64]:
        """Of the delays at the middle of the record [s], shape (n_names,)."""
        return np.sqrt(np.diag(self.covariance)[: len(self.names)])

    @property
    def skew_deviations(self) -> NDArray[np.float64]:
        """Standard deviations of the skews [-], shape (n_names,)."""
        return np.sqrt(np.diag(self.covariance)[len(self.names) :])

    @property
    def deviation_over_record(self) -> NDArray[np.float64]:
        """Root mean square standard deviation of the delay along the record [s]."""
        return np.sqrt(
            self.standard_deviations**2 + self.skew_deviations**2 * self.duration**2 / 12
        )


@dataclass(frozen=True)
class _Prior:
    """What is known of the parameters before the data: information, and where they are."""

    information: NDArray[np.float64]
    mean: NDArray[np.float64]


@dataclass(frozen=True)
class _Maximum:
    """Parameters at the maximum, inverse information, which have none, fitted spectra."""

    values: NDArray[np.float64]
    inverse: NDArray[np.float64]
    lost: NDArray[np.bool_]
    fitted: NDArray[np.complex128]


def source_delays(
    model: Model,
    record: MeasuredRecord,
    sources: Sequence[Sequence[int]],
    names: Sequence[str],
    search: float = 0.0,
    prior_mean: NDArray[np.float64] | None = None,
    prior_covariance: NDArray[np.float64] | None = None,
) -> DelayEstimate:
    """
    Delay and skew of every source against the first, from redundant motion sensors.

    The maximum-likelihood estimate under white sensor noise: at every frequency the motion of
    the bodies is eliminated, what is left are weighted cross-spectra between the sources
    (Knapp and Carter 1976, with the rigid body in the place of the common signal). Standard
    deviations are those of the noise taken through the estimator, correlation of overlapping
    segments included.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord
        All sources on one grid, aligned to within `search`.
    sources : sequence of sequence of int
        Channels of every source; those of the first are the reference.
    names : sequence of str
        Of the sources.
    search : float
        Delays tried before the search by gradients, either way [s].
    prior_mean : ndarray, shape (2 * (n_sources - 1),) or None
        Delay and skew of each source but the first [s, -].
    prior_covariance : ndarray or None
        Of these; None: nothing is known beforehand.

    Returns
    -------
    DelayEstimate

    Raises
    ------
    DataError
        If there is nothing to compare.

    """
    spectra = segment_spectra(model, record)
    size = 2 * (len(sources) - 1)
    basis = np.zeros((size, len(spectra.times), len(spectra.channels)))
    for i, members in enumerate(sources[1:]):
        own = np.isin(spectra.channels, list(members))
        basis[2 * i][:, own] = 1.0
        basis[2 * i + 1][:, own] = spectra.times[:, np.newaxis]
    prior = _Prior(np.zeros((size, size)), np.zeros(size))
    if prior_covariance is not None:
        mean = np.zeros(size) if prior_mean is None else prior_mean
        prior = _Prior(np.asarray(np.linalg.inv(prior_covariance), dtype=np.float64), mean)
    start = np.zeros(size)
    if search > 0:
        for i in range(len(sources) - 1):
            start = _scanned(spectra, basis, start, 2 * i, search)
    found = _maximum(spectra, basis, start, prior)
    values, covariance = found.values, _covariance(spectra, basis, prior, found)
    order = [*range(0, size, 2), *range(1, size, 2)]
    count = len(sources)
    place = [*range(1, count), *range(count + 1, 2 * count)]
    whole = np.zeros((2 * count, 2 * count))
    whole[np.ix_(place, place)] = covariance[np.ix_(order, order)]
    zero = np.zeros(1)
    return DelayEstimate(
        tuple(names),
        np.concatenate((zero, values[::2])),
        np.concatenate((zero, values[1::2])),
        whole,
        len(record.samples) / record.sample_rate,
    )


def channel_delays(model: Model, record: MeasuredRecord) -> DelayEstimate:
    """
    Delay of every motion sensor against the others that see the same motion.

    A delay counts from the mean of the sensors that are linked by redundancy: those of bodies
    between which no relative probe measures are compared among themselves only.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord

    Returns
    -------
    DelayEstimate
        Of the sensors that were used. Infinite standard deviation: no other sensor tells.

    Raises
    ------
    DataError
        If there is nothing to compare.

    """
    delays = np.zeros(len(record.layout.sensors))
    for _ in range(MOST_ROUNDS):
        spectra = segment_spectra(model, advanced(record, delays))
        size = len(spectra.channels)
        basis = np.repeat(np.eye(size)[:, np.newaxis, :], len(spectra.times), axis=1)
        nothing = _Prior(np.zeros((size, size)), np.zeros(size))
        found = _maximum(spectra, basis, np.zeros(size), nothing)
        centred = _centring(spectra)
        moved = centred @ found.values
        delays[spectra.channels] += moved
        if np.all(moved**2 <= ENOUGH * np.diag(found.inverse)):
            break
    covariance = _covariance(spectra, basis, nothing, found)
    covariance = centred @ np.where(np.isinf(covariance), 0.0, covariance) @ centred.T
    covariance[found.lost, found.lost] = np.inf
    whole = np.zeros((2 * size, 2 * size))
    whole[:size, :size] = covariance
    return DelayEstimate(
        tuple(record.layout.sensors[i].name for i in spectra.channels),
        delays[spectra.channels],
        np.zeros(size),
        whole,
        len(record.samples) / record.sample_rate,
    )


def advanced(record: MeasuredRecord, delays: NDArray[np.float64]) -> MeasuredRecord:
    """
    Move late readings to where they belong.

    Parameters
    ----------
    record : MeasuredRecord
    delays : ndarray, shape (n_channels,)
        [s].

    Returns
    -------
    MeasuredRecord
        NaN where an edge or an invalid sample is within reach of the interpolation.

    """
    samples = record.samples.copy()
    for channel in np.flatnonzero(delays):
        grid = Grid(float(delays[channel]) * record.sample_rate, 1.0)
        samples[:, [channel]] = resample(samples[:, [channel]], grid, len(samples))
    return replace(record, samples=samples)


def _centring(spectra: SegmentSpectra) -> NDArray[np.float64]:
    """Subtract the mean of the sensors that are linked: a common delay of these is not seen."""
    weights = spectra.projections * np.sqrt(
        spectra.variance[:, :, np.newaxis] * spectra.variance[:, np.newaxis, :]
    )
    _, groups = connected_components(np.abs(weights).max(axis=0) > NOTHING, directed=False)
    same = (groups[:, np.newaxis] == groups).astype(np.float64)
    return np.asarray(np.eye(len(same)) - same / same.sum(axis=1))


def _scanned(
    spectra: SegmentSpectra,
    basis: NDArray[np.float64],
    start: NDArray[np.float64],
    parameter: int,
    search: float,
) -> NDArray[np.float64]:
    """Try delays of one source on a grid: the generalised cross-correlation's maximum."""
    if not spectra.frequencies.size:
        return start
    step = 2 * np.pi / spectra.frequencies[-1] / TRIALS_PER_PERIOD
    trials = np.arange(-np.ceil(search / step), np.ceil(search / step) + 1) * step
    own = basis[parameter].any(axis=0)
    aligned = _aligned(spectra, basis, start)
    others = np.einsum(
        'fcd,kfd->kfc', spectra.projections[:, own][:, :, ~own], aligned[:, :, ~own]
    )
    cross = np.einsum('kfc,kfc->f', np.conj(aligned[:, :, own]), others)
    cost = (np.exp(-1j * np.outer(trials, spectra.frequencies)) @ cross).real
    result = start.copy()
    result[parameter] += trials[int(np.argmin(cost))]
    return result


def _aligned(
    spectra: SegmentSpectra, basis: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.complex128]:
    delays = np.einsum('p,pkc->kc', values, basis)
    phase = spectra.frequencies[:, np.newaxis] * delays[:, np.newaxis, :]
    return np.asarray(spectra.spectra * np.exp(1j * phase))


def _maximum(
    spectra: SegmentSpectra,
    basis: NDArray[np.float64],
    values: NDArray[np.float64],
    prior: _Prior,
) -> _Maximum:
    """Gauss-Newton on the likelihood."""
    if not spectra.frequencies.size and not prior.information.any():
        raise DataError(
            'record: no motion stands out of the noise, so that it tells no delays; excite the '
            'machine'
        )
    weights = spectra.projections
    omega = spectra.frequencies[:, np.newaxis]
    # Variance of the fitted spectra, which the noise adds to their squares.
    excess = -spectra.variance[:, :, np.newaxis] * weights * spectra.variance[:, np.newaxis, :]
    own = np.arange(len(spectra.channels))
    excess[:, own, own] += spectra.variance
    surplus = np.einsum('f,fcd,fcd->cd', spectra.frequencies**2, excess, weights)
    for _ in range(MOST_STEPS):
        aligned = _aligned(spectra, basis, values)
        residual = np.einsum('fcd,kfd->kfc', weights, aligned)
        fitted = aligned - spectra.variance * residual
        slope = -(omega * np.imag(np.conj(fitted) * residual)).sum(axis=1)
        score = np.einsum('pkc,kc->p', basis, slope)
        products = np.einsum('kfc,fcd,kfd->kcd', np.conj(omega * fitted), weights, omega * fitted,
                             optimize=True).real - surplus  # fmt: skip
        information = np.einsum('pkc,kcd,qkd->pq', basis, products, basis, optimize=True)
        inverse, lost = _inverse(information + prior.information)
        score = score + prior.information @ (prior.mean - values)
        step = inverse @ score
        values = values + step
        if float(step @ (information + prior.information) @ step) < ENOUGH**2 * len(values):
            break
    return _Maximum(values, inverse, lost, fitted)


def _inverse(information: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Invert what is determined; a common delay of all is not, and alone does no harm."""
    own = np.clip(np.diag(information), 0.0, None)
    lost = own <= NOTHING * own.max(initial=0.0)
    scale = np.where(lost, 1.0, np.sqrt(np.where(lost, 1.0, own)))
    scaled = information / scale[:, np.newaxis] / scale
    scaled[lost, :] = scaled[:, lost] = 0.0
    values, vectors = np.linalg.eigh(scaled)
    told = values > WEAKEST * values.max(initial=0.0)
    inverse = (vectors[:, told] / values[told]) @ vectors[:, told].T
    return inverse / scale[:, np.newaxis] / scale, lost


def _covariance(
    spectra: SegmentSpectra, basis: NDArray[np.float64], prior: _Prior, found: _Maximum
) -> NDArray[np.float64]:
    """Take the sensors' noise from the samples through the score to the estimate."""
    spread = prior.information.copy()
    weights = spectra.projections
    slopes = 1j * spectra.frequencies[:, np.newaxis] * np.conj(found.fitted)
    for used, noise in enumerate(spectra.noise):
        coefficients = np.einsum('pkc,kfc,fc->pkf', basis, slopes, weights[:, :, used],
                                 optimize=True)  # fmt: skip
        table = spectra.taken_back(used, coefficients) * noise
        spread += table @ table.T
    covariance: NDArray[np.float64] = found.inverse @ spread @ found.inverse
    covariance[found.lost, found.lost] = np.inf
    return covariance
