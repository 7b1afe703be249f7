# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Residual delays between channels, from the motion they measured."""

from dataclasses import dataclass

from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.advanced import advanced
from identnl_ros.core.synchronisation.delay_likelihood import (
    delay_covariance,
    ENOUGH,
    maximum,
    Prior,
)
from identnl_ros.core.synchronisation.misfit import misfits
from identnl_ros.core.synchronisation.segment_spectra import segment_spectra
import numpy as np
from numpy.typing import NDArray

# Delays are exact to first order in delay over segment: readings are moved and looked at again.
MOST_ROUNDS = 4


@dataclass(frozen=True)
class ChannelDelays:
    """
    Delays of channels against those that see the same motion.

    Parameters
    ----------
    names : tuple of str
    delays : ndarray, shape (n_names,)
        Against the mean of the group, beyond the delays that the layout states; positive: the
        readings are late [s].
    covariance : ndarray, shape (n_names, n_names)
        Infinite variance: not determined by the data.
    groups : ndarray of int, shape (n_names,)
        Channels that are linked by redundancy have the same number.
    unexplained : ndarray, shape (n_names,)
        Share of what a channel reads, as an amplitude and beyond noise, that rigid motion with
        these delays does not explain [-].
    widened : ndarray, shape (n_names,)
        By how much more than noise makes them the standard deviations are, because noise does
        not explain the rest [-].

    """

    names: tuple[str, ...]
    delays: NDArray[np.float64]
    covariance: NDArray[np.float64]
    groups: NDArray[np.int64]
    unexplained: NDArray[np.float64]
    widened: NDArray[np.float64]

    @property
    def standard_deviations(self) -> NDArray[np.float64]:
        """Of the delays [s], shape (n_names,)."""
        return np.sqrt(np.diag(self.covariance))


def channel_delays(model: Model, record: MeasuredRecord) -> ChannelDelays:
    """
    Delay of every motion sensor against the others that see the same motion.

    A delay counts from the mean of the sensors that are linked by redundancy: those of bodies
    between which no relative probe measures are compared among themselves only. Where rigid
    motion and noise do not explain what these sensors read, the covariance is widened to what
    delays of single frequency bands differ by.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord

    Returns
    -------
    ChannelDelays
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
        nothing = Prior(np.zeros((size, size)), np.zeros(size))
        found = maximum(spectra, basis, np.zeros(size), nothing)
        groups = spectra.groups
        centred = _centring(groups)
        moved = centred @ found.values
        delays[spectra.channels] += moved
        if np.all(moved**2 <= ENOUGH * np.diag(found.inverse)):
            break
    covariance = delay_covariance(spectra, basis, nothing, found)
    covariance = centred @ np.where(np.isinf(covariance), 0.0, covariance) @ centred.T
    unexplained, widened = np.zeros(size), np.ones(size)
    for group in np.unique(groups):
        own = np.flatnonzero(groups == group)
        fit = misfits(spectra, found, own)
        unexplained[own] = fit.unexplained
        if not fit.explained:
            variance = np.diag(covariance)[own]
            told = ~found.lost[own] & (variance > 0)
            spread = fit.variance(centred @ found.inverse)[own]
            factor = max(fit.ratio, float(np.max(spread[told] / variance[told], initial=1.0)))
            covariance[np.ix_(own, own)] *= factor
            widened[own] = np.sqrt(factor)
    covariance[found.lost, found.lost] = np.inf
    return ChannelDelays(
        tuple(record.layout.sensors[i].name for i in spectra.channels),
        delays[spectra.channels],
        covariance,
        groups,
        unexplained,
        widened,
    )


def _centring(groups: NDArray[np.int64]) -> NDArray[np.float64]:
    """Subtract the mean of the sensors that are linked: a common delay of these is not seen."""
    same = (groups[:, np.newaxis] == groups).astype(np.float64)
    return np.asarray(np.eye(len(same)) - same / same.sum(axis=1))
