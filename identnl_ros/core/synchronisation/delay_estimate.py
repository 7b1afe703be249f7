# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Residual delays between sources, from the motion they measured."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.delay_likelihood import (
    aligned_spectra,
    delay_covariance,
    maximum,
    Prior,
)
from identnl_ros.core.synchronisation.misfit import unexplained_between
from identnl_ros.core.synchronisation.segment_spectra import segment_spectra, SegmentSpectra
import numpy as np
from numpy.typing import NDArray

# Trial delays per period of the highest frequency.
TRIALS_PER_PERIOD = 8


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
    unexplained : float
        Share of what the sources read, as an amplitude and beyond noise, that is not one rigid
        motion with these delays; the median of the channels of the source that fits least [-].

    """

    names: tuple[str, ...]
    delays: NDArray[np.float64]
    skews: NDArray[np.float64]
    covariance: NDArray[np.float64]
    duration: float
    unexplained: float = 0.0

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
    prior = Prior(np.zeros((size, size)), np.zeros(size))
    if prior_covariance is not None:
        mean = np.zeros(size) if prior_mean is None else prior_mean
        prior = Prior(np.asarray(np.linalg.inv(prior_covariance), dtype=np.float64), mean)
    start = np.zeros(size)
    if search > 0:
        for i in range(len(sources) - 1):
            start = _scanned(spectra, basis, start, 2 * i, search)
    found = maximum(spectra, basis, start, prior)
    values, covariance = found.values, delay_covariance(spectra, basis, prior, found)
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
        unexplained_between(spectra, found, sources),
    )


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
    aligned = aligned_spectra(spectra, basis, start)
    others = np.einsum(
        'fcd,kfd->kfc', spectra.projections[:, own][:, :, ~own], aligned[:, :, ~own]
    )
    cross = np.einsum('kfc,kfc->f', np.conj(aligned[:, :, own]), others)
    cost = (np.exp(-1j * np.outer(trials, spectra.frequencies)) @ cross).real
    result = start.copy()
    result[parameter] += trials[int(np.argmin(cost))]
    return result
