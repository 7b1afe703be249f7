# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Every pair of channels that could be left out, weighed at once."""

from typing import Protocol

from identnl_ros.core.quality.leave_one_out import Flags, LeaveOneOut, NOTHING, Reals
import numpy as np


class Sums(Protocol):
    """Products of readings, shape (n_bands, n_channels, n_channels), summed; their noise."""

    @property
    def products(self) -> Reals:
        """Of the readings."""

    @property
    def counts(self) -> Reals:
        """Of summands, shape (n_bands,)."""

    @property
    def noise(self) -> Reals:
        """Variance of a reading under the noise, shape (n_bands, n_channels)."""


def pair_drops(fit: LeaveOneOut, variance: Reals, sums: Sums, among: Flags) -> Reals:
    """
    Tell by how much the misfit drops, beyond noise, if two channels are left out together.

    With M the projection on what the fit leaves of whitened readings and C the products of what
    is left, leaving out the set T lowers the sum of squares by trace(inv(M_TT) C_TT) (Cook and
    Weisberg 1982, section 3.6).

    Parameters
    ----------
    fit : LeaveOneOut
        With all channels of `among` in use.
    variance : ndarray, shape (n_bands, n_channels)
        That weighed the readings.
    sums : Sums
    among : ndarray of bool, shape (n_channels,)
        Channels to choose from.

    Returns
    -------
    ndarray, shape (n_channels, n_channels)
        Symmetric; zero for a pair without which nothing tells one of the two.

    """
    chosen = np.flatnonzero(among & fit.told)
    root = np.sqrt(variance)
    remaining = variance / fit.variance
    left = fit.errors[:, chosen] * (remaining / root)[:, chosen, np.newaxis]
    # Of whitened readings, and what noise leaves in their products.
    projection = (left * root[:, np.newaxis])[:, :, chosen]
    noise = (left * (sums.counts[:, np.newaxis] * sums.noise)[:, np.newaxis]) @ np.swapaxes(
        left, 1, 2
    )
    beyond = left @ sums.products @ np.swapaxes(left, 1, 2) - noise
    own = np.einsum('bii->bi', projection)
    squares = np.einsum('bii->bi', beyond)
    determinant = own[:, :, np.newaxis] * own[:, np.newaxis] - projection**2
    enough = determinant > np.maximum(NOTHING, 1e-3 * own[:, :, np.newaxis] * own[:, np.newaxis])
    drops = (
        squares[:, :, np.newaxis] * own[:, np.newaxis]
        + squares[:, np.newaxis] * own[:, :, np.newaxis]
        - 2 * beyond * projection
    ) / np.where(enough, determinant, 1.0)
    told = enough.all(axis=0)
    np.fill_diagonal(told, False)
    result = np.zeros((len(among), len(among)))
    result[np.ix_(chosen, chosen)] = np.where(told, drops.sum(axis=0), 0.0)
    return result
