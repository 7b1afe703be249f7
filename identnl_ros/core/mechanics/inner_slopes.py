# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of the scalar force laws by the numbers inside them."""

from identnl_ros.core.mechanics.element_laws import coulomb_slope, stribeck
from identnl_ros.core.mechanics.laws import Law, LawKind, Reals
import numpy as np

AT_REST = np.zeros(1)


def preload_slope(law: Law, deformation: Reals, locked_in: bool) -> Reals:
    """
    Differentiate the force of a law by its preload.

    Preload and deformation enter as their sum, so this is the stiffness.

    Parameters
    ----------
    law : Law
    deformation : ndarray
        [m].
    locked_in : bool
        True: the force at rest is subtracted, and changes with the preload as well.

    Returns
    -------
    ndarray, same shape
        Per unit of the coefficient. A power below one is infinitely steep at a point, where
        the slope counts as zero.

    """
    slope = law.stiffness(deformation)
    at_rest = law.stiffness(AT_REST) if locked_in else AT_REST
    return np.where(np.isfinite(slope), slope, 0.0) - np.where(np.isfinite(at_rest), at_rest, 0.0)


def exponent_slope(law: Law, deformation: Reals, locked_in: bool) -> Reals:
    """
    Differentiate the force of a power law by its exponent.

    ``|x|^m ln|x|``, which goes to zero with x.

    Parameters
    ----------
    law : Law
        A signed power or a contact.
    deformation : ndarray
        [m] or [rad].
    locked_in : bool
        True: the force at rest is subtracted, and changes with the exponent as well.

    Returns
    -------
    ndarray, same shape
        Per unit of the coefficient.

    """
    slope = _power_times_logarithm(law, deformation)
    return slope - _power_times_logarithm(law, AT_REST) if locked_in else slope


def gap_slope(law: Law, deformation: Reals, locked_in: bool) -> Reals:
    """
    Differentiate the force of backlash or of a bilinear stiffness by its gap.

    Parameters
    ----------
    law : Law
    deformation : ndarray
        [m] or [rad].
    locked_in : bool
        True: the force at rest is subtracted, and changes with the gap as well.

    Returns
    -------
    ndarray, same shape
        Per unit of the coefficient.

    """
    slope = _by_gap(law, deformation)
    return slope - _by_gap(law, AT_REST) if locked_in else slope


def transition_slope(law: Law, rate: Reals) -> Reals:
    """
    Differentiate the force of friction by its transition velocity.

    Parameters
    ----------
    law : Law
    rate : ndarray
        [m/s] or [rad/s].

    Returns
    -------
    ndarray, same shape
        Per unit of the coefficient.

    """
    slope = -rate / law.transition * coulomb_slope(rate, law.transition)
    if law.kind is LawKind.STRIBECK:
        slope = slope * np.exp(-((rate / law.fading) ** 2))
    return slope


def fading_slope(law: Law, rate: Reals) -> Reals:
    """
    Differentiate the force of Stribeck friction by the velocity at which it fades.

    Parameters
    ----------
    law : Law
    rate : ndarray
        [m/s] or [rad/s].

    Returns
    -------
    ndarray, same shape
        Per unit of the coefficient.

    """
    return 2.0 * rate**2 / law.fading**3 * stribeck(rate, law.transition, law.fading)


def _by_gap(law: Law, deformation: Reals) -> Reals:
    if law.kind is LawKind.BILINEAR:
        return np.where(deformation > law.gap, -1.0, 0.0)
    return np.where(np.abs(deformation) > law.gap, -np.sign(deformation), 0.0)


def _power_times_logarithm(law: Law, deformation: Reals) -> Reals:
    total = law.preload + deformation
    size = np.maximum(total, 0.0) if law.kind is LawKind.CONTACT else np.abs(total)
    logarithm = np.log(np.where(size > 0.0, size, 1.0))
    result: Reals = np.sign(total) * size**law.exponent * logarithm
    return result
