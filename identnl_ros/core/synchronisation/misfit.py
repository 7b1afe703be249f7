# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whether rigid motion, delays and noise explain what sensors read."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.synchronisation.delay_likelihood import Maximum
from identnl_ros.core.synchronisation.segment_spectra import SegmentSpectra
import numpy as np
from numpy.typing import NDArray

# Frequency bands whose delays are compared, and fewest bins of one: windows blur about as many.
BANDS = 16
LEAST_BINS = 4
# With fewer bands that count, they do not tell how far delays of bands differ; errors in phase
# with the motion then stand for those that are not, of which there may be so many times more.
FEWEST_BANDS = 4.0
OUT_OF_PHASE = 3.0
# Excess of the residual over noise that is one: so many standard deviations.
SIGNIFICANT = 4.0
# Of the variance of a sum of squares: neighbouring bins of overlapping windows are not
# independent.
CORRELATED = 1.5
# Sources of which so much of the motion does not fit saw another one: a tenth of its power [-].
MOST_UNEXPLAINED = 0.3


@dataclass(frozen=True)
class Misfit:
    """
    What a fit of delays leaves unexplained of a group of linked channels.

    Parameters
    ----------
    ratio : float
        Power of the residual over that of the noise.
    explained : bool
        Noise explains it.
    unexplained : ndarray, shape (n_members,)
        Share of what each channel reads that the others do not explain, as an amplitude and
        beyond noise [-].
    scores : ndarray of complex, shape (n_bands, n_used)
        Slope of the log likelihood along every channel's delay, band by band, as the imaginary
        part; the real part is what errors in phase with the motion would make of it, such as
        those of gains. Other channels 0.
    bands : float
        Bands that count, of equal information.

    """

    ratio: float
    explained: bool
    unexplained: NDArray[np.float64]
    scores: NDArray[np.complex128]
    bands: float

    def variance(self, gain: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Tell how far delays of single bands differ from that of all.

        What is no noise (gains, directions, hum, bending) is alike at all times, but not at all
        frequencies, as a delay is: bands are the clusters of a robust covariance (White 1980).
        Where the motion is in too few bands, the errors in phase with it tell how large those
        in quadrature may be.

        Parameters
        ----------
        gain : ndarray, shape (n_parameters, n_used)
            Parameters per score: the inverse information.

        Returns
        -------
        ndarray, shape (n_parameters,)
            Squared.

        """
        moved = self.scores @ gain.T
        if self.bands < FEWEST_BANDS:
            in_phase = np.maximum(moved.real.sum(axis=0) ** 2, (moved.real**2).sum(axis=0))
            return np.asarray(OUT_OF_PHASE**2 * in_phase)
        return np.asarray((moved.imag**2).sum(axis=0) * self.bands / (self.bands - 1))


def misfits(spectra: SegmentSpectra, found: Maximum, members: NDArray[np.int64]) -> Misfit:
    """
    Compare the residual of a fit with the noise.

    Parameters
    ----------
    spectra : SegmentSpectra
    found : Maximum
        One parameter for every channel, or any other: delays are taken out of its spectra.
    members : ndarray of int, shape (n_members,)
        Of channels that are linked, among those used.

    Returns
    -------
    Misfit

    """
    weights = spectra.projections
    segments = len(spectra.begins)
    own = np.einsum('fcc->fc', weights)[:, members]
    noise = spectra.variance[:, members]
    residual, aligned = found.residual[..., members], found.aligned[..., members]
    power = float((np.conj(aligned) * residual).real.sum())
    expected = segments * float((own * noise).sum())
    span = int(spectra.begins[-1]) + spectra.length - int(spectra.begins[0])
    # A white sequence of as many redundant readings, seen in these bins alone.
    freedom = 2 * span / spectra.length * float((own * noise).sum())
    ratio = power / expected if expected > 0 else 1.0
    limit = 1 + SIGNIFICANT * np.sqrt(2 * CORRELATED / max(freedom, 1.0))
    # The same of one redundant reading.
    largest = 1 + SIGNIFICANT * np.sqrt(CORRELATED * spectra.length / (span * max(len(own), 1)))
    with np.errstate(divide='ignore', invalid='ignore'):
        error = (np.abs(residual) ** 2 / own).sum(axis=(0, 1)) - segments * len(own) * largest
        read = ((np.abs(aligned) ** 2 - noise) * own).sum(axis=(0, 1))
        share = np.sqrt(np.clip(error, 0.0, None) / read)
    told = own.max(axis=0, initial=0.0) * noise.max(axis=0, initial=0.0) > 0
    scores, bands = _band_scores(spectra, found, members)
    return Misfit(
        ratio,
        bool(ratio <= limit),
        np.where(told & np.isfinite(share), share, 0.0),
        scores,
        bands,
    )


def unexplained_between(
    spectra: SegmentSpectra, found: Maximum, sources: Sequence[Sequence[int]]
) -> float:
    """
    Tell how much of what sources saw is not the same motion.

    The median of a source's channels, of which single ones may be inverted or exchanged; that of
    the source that fits least, for one alone fits those of its own.

    Parameters
    ----------
    spectra : SegmentSpectra
    found : Maximum
    sources : sequence of sequence of int
        Channels of every source.

    Returns
    -------
    float
        Share, as an amplitude [-]; 0: no channels of different sources see the same.

    """
    owner = np.array([next(i for i, own in enumerate(sources) if channel in own)
                      for channel in spectra.channels])  # fmt: skip
    groups = spectra.groups
    shares = np.full(len(groups), np.nan)
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        if len(set(owner[members].tolist())) > 1:
            shares[members] = misfits(spectra, found, members).unexplained
    told = [shares[(owner == one) & np.isfinite(shares)] for one in range(len(sources))]
    return max((float(np.median(own)) for own in told if own.size), default=0.0)


def _band_scores(
    spectra: SegmentSpectra, found: Maximum, members: NDArray[np.int64]
) -> tuple[NDArray[np.complex128], float]:
    """Scores of bands of about equal information, and how many of them count."""
    omega = spectra.frequencies[:, np.newaxis]
    used = np.zeros(len(spectra.channels))
    used[members] = 1.0
    scores = -(omega * np.conj(found.fitted) * found.residual).sum(axis=0) * used
    weights = np.einsum('fcc->fc', spectra.projections)
    informed = (omega**2 * (np.abs(found.fitted) ** 2).sum(axis=0) * weights * used).sum(axis=1)
    edges = [0]
    total = informed.sum()
    for bin_ in range(1, len(informed) + 1):
        enough = informed[edges[-1] : bin_].sum() >= total / BANDS
        if bin_ - edges[-1] >= LEAST_BINS and enough:
            edges.append(bin_)
    if len(edges) == 1:
        return scores.sum(axis=0, keepdims=True), 1.0
    own = np.add.reduceat(informed, edges[:-1])
    rows = np.add.reduceat(scores, edges[:-1], axis=0)
    return rows, float(own.sum() ** 2 / max((own**2).sum(), np.finfo(float).tiny))
