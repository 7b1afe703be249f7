# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Likelihood of delays, the motion of the rigid bodies eliminated."""

from dataclasses import dataclass

from identnl_ros.core.errors import DataError
from identnl_ros.core.synchronisation.segment_spectra import SegmentSpectra
import numpy as np
from numpy.typing import NDArray

MOST_STEPS = 12
# A step below this share of a standard deviation ends the search.
ENOUGH = 1e-3
# Information below this share of the largest, on one footing, is none.
NOTHING = 1e-9
# Of the scaled information; combinations that have less are left as they are.
WEAKEST = 1e-6


@dataclass(frozen=True)
class Prior:
    """
    What is known of the parameters before the data.

    Parameters
    ----------
    information : ndarray, shape (n_parameters, n_parameters)
    mean : ndarray, shape (n_parameters,)

    """

    information: NDArray[np.float64]
    mean: NDArray[np.float64]


@dataclass(frozen=True)
class Maximum:
    """
    Maximum of the likelihood.

    Parameters
    ----------
    values : ndarray, shape (n_parameters,)
    inverse : ndarray, shape (n_parameters, n_parameters)
        Of the information.
    lost : ndarray of bool, shape (n_parameters,)
        Of these the data tell nothing.
    aligned, fitted, residual : ndarray of complex, shape (n_segments, n_bins, n_used)
        Spectra without the delays; what rigid motion makes of them; the projections of what
        it does not explain.

    """

    values: NDArray[np.float64]
    inverse: NDArray[np.float64]
    lost: NDArray[np.bool_]
    aligned: NDArray[np.complex128]
    fitted: NDArray[np.complex128]
    residual: NDArray[np.complex128]


def aligned_spectra(
    spectra: SegmentSpectra, basis: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """
    Take delays out of spectra.

    Parameters
    ----------
    spectra : SegmentSpectra
    basis : ndarray, shape (n_parameters, n_segments, n_used)
    values : ndarray, shape (n_parameters,)

    Returns
    -------
    ndarray of complex, shape (n_segments, n_bins, n_used)

    """
    delays = np.einsum('p,pkc->kc', values, basis)
    phase = spectra.frequencies[:, np.newaxis] * delays[:, np.newaxis, :]
    return np.asarray(spectra.spectra * np.exp(1j * phase))


def maximum(
    spectra: SegmentSpectra,
    basis: NDArray[np.float64],
    values: NDArray[np.float64],
    prior: Prior,
) -> Maximum:
    """
    Maximise the likelihood by Gauss-Newton.

    Parameters
    ----------
    spectra : SegmentSpectra
    basis : ndarray, shape (n_parameters, n_segments, n_used)
        Delay of each channel in each segment per unit of a parameter.
    values : ndarray, shape (n_parameters,)
        To begin with.
    prior : Prior

    Returns
    -------
    Maximum

    Raises
    ------
    DataError
        If there is neither motion nor prior knowledge.

    """
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
        aligned = aligned_spectra(spectra, basis, values)
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
    return Maximum(values, inverse, lost, aligned, fitted, residual)


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


def delay_covariance(
    spectra: SegmentSpectra, basis: NDArray[np.float64], prior: Prior, found: Maximum
) -> NDArray[np.float64]:
    """
    Take the sensors' noise from the samples through the score to the estimate.

    Parameters
    ----------
    spectra : SegmentSpectra
    basis : ndarray, shape (n_parameters, n_segments, n_used)
    prior : Prior
    found : Maximum

    Returns
    -------
    ndarray, shape (n_parameters, n_parameters)
        Infinite variance: not determined by the data.

    """
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
