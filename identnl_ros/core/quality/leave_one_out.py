# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Every reading predicted from the others that see the same rigid bodies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Share of a reading's variance that the others leave; below it they tell nothing.
NOTHING = 1e-7
RANK = 1e-12


@dataclass(frozen=True)
class LeaveOneOut:
    """
    Difference between every reading and what the others say.

    Parameters
    ----------
    errors : ndarray, shape (n_bands, n_channels, n_channels)
        Error = errors @ readings; rows that the others do not tell are zero.
    variance : ndarray, shape (n_bands, n_channels)
        Of the errors, under the variances that weighed the readings.
    told : ndarray of bool, shape (n_channels,)
        Channels that the others tell, in every band.
    fit : ndarray, shape (n_bands, n_coordinates, n_channels)
        Coordinates = fit @ readings.

    """

    errors: Reals
    variance: Reals
    told: Flags
    fit: Reals


def leave_one_out(rows: Reals, variance: Reals, used: Flags) -> LeaveOneOut:
    """
    Predict every reading by weighted least squares from the used ones without itself.

    Leaving a reading out needs no new fit: its error is the residual over one minus its leverage
    (Cook and Weisberg 1982, section 2.2).

    Parameters
    ----------
    rows : ndarray, shape (n_channels, n_coordinates)
        Readings per unit of every coordinate.
    variance : ndarray, shape (n_bands, n_channels)
        Of the readings.
    used : ndarray of bool, shape (n_channels,)
        Channels that predict; the others are predicted only.

    Returns
    -------
    LeaveOneOut

    """
    weighted = rows * (used / variance)[:, :, np.newaxis]
    information = np.swapaxes(weighted, 1, 2) @ rows
    # Metres and radians on one footing; motions that no sensor sees drop out.
    scale = np.sqrt(np.einsum('bii->bi', information))
    scale[scale == 0] = 1.0
    scaled = information / scale[:, :, np.newaxis] / scale[:, np.newaxis, :]
    inverse = np.linalg.pinv(scaled, RANK, hermitian=True)
    unseen = np.eye(rows.shape[1]) - inverse @ scaled
    inverse = inverse / scale[:, :, np.newaxis] / scale[:, np.newaxis, :]
    fit = inverse @ np.swapaxes(weighted, 1, 2)
    fitted = rows @ fit
    spread = ((rows @ inverse) * rows).sum(axis=2)
    leverage = np.where(used, np.einsum('bii->bi', fitted), 0.0)
    sizes = rows * scale[:, np.newaxis, :]
    lost = np.linalg.norm(sizes @ unseen, axis=2) > 1e-5 * np.linalg.norm(sizes, axis=2)
    told = ((1 - leverage > NOTHING) & (used | ~lost)).all(axis=0) & rows.any(axis=1)
    remaining = np.where(told, 1 - leverage, 1.0)
    errors = (np.eye(len(rows)) - fitted) / remaining[:, :, np.newaxis]
    errors[:, ~told] = 0.0
    own = np.where(used, variance / remaining, variance + spread)
    return LeaveOneOut(errors, own, told, fit)
