# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Scalar force laws of spring-damping elements, per unit of their coefficient.

Every law is a plain function of deformation and deformation rate built from numpy universal
functions only, so the same source evaluates arrays in the regression and, compiled, single
states in the simulation.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


class LawKind(IntEnum):
    """Form of a scalar force law."""

    LINEAR = 0
    VISCOUS = 1
    SIGNED_POWER = 2
    CONTACT = 3
    POLYNOMIAL = 4


def signed_power(deformation: Reals, exponent: float, preload: float) -> Reals:
    """
    Evaluate the power law of a joint that cannot open, (5) of Berczynski et al. (2010).

    Parameters
    ----------
    deformation : float or ndarray
        [m] or [rad].
    exponent : float
        m [-].
    preload : float
        Deformation at rest [m] or [rad].

    Returns
    -------
    float or ndarray
        ``|preload + deformation|^m sgn(preload + deformation)``.

    """
    total = preload + deformation
    return np.sign(total) * np.abs(total) ** exponent


def signed_power_slope(deformation: Reals, exponent: float, preload: float) -> Reals:
    """
    Differentiate `signed_power` by the deformation.

    Parameters
    ----------
    deformation, exponent, preload
        As in `signed_power`.

    Returns
    -------
    float or ndarray

    """
    total = np.abs(preload + deformation)
    touching = (total == 0.0) & (exponent < 1.0)
    slope = exponent * np.where(touching, 1.0, total) ** (exponent - 1.0)
    return np.where(touching, np.inf, slope)


def contact(deformation: Reals, exponent: float, preload: float) -> Reals:
    """
    Evaluate the power law of a surface element that carries pressure only.

    Parameters
    ----------
    deformation : float or ndarray
        Approach of the surfaces [m].
    exponent : float
        m [-].
    preload : float
        Approach at rest [m].

    Returns
    -------
    float or ndarray
        ``(preload + deformation)^m`` in contact, 0 when open.

    """
    return np.maximum(preload + deformation, 0.0) ** exponent


def contact_slope(deformation: Reals, exponent: float, preload: float) -> Reals:
    """
    Differentiate `contact` by the deformation.

    Parameters
    ----------
    deformation, exponent, preload
        As in `contact`.

    Returns
    -------
    float or ndarray

    """
    total = preload + deformation
    closed = total > 0.0
    return exponent * np.where(closed, total, 1.0) ** (exponent - 1.0) * closed


def polynomial(deformation: Reals, exponent: float) -> Reals:
    """
    Evaluate a whole power of the deformation, even powers without sign change.

    Parameters
    ----------
    deformation : float or ndarray
        [m] or [rad].
    exponent : float
        Whole number, 2 or more [-].

    Returns
    -------
    float or ndarray

    """
    return deformation**exponent


def polynomial_slope(deformation: Reals, exponent: float) -> Reals:
    """
    Differentiate `polynomial` by the deformation.

    Parameters
    ----------
    deformation, exponent
        As in `polynomial`.

    Returns
    -------
    float or ndarray

    """
    return exponent * deformation ** (exponent - 1.0)


@dataclass(frozen=True)
class Law:
    """
    One scalar force law.

    Parameters
    ----------
    kind : LawKind
    exponent : float
        Power of the deformation, where the kind has one [-].
    preload : float
        Deformation at rest, where the kind has one [m] or [rad].
    rest_force : float
        Force per unit of coefficient that is balanced at rest and therefore subtracted.

    """

    kind: LawKind
    exponent: float = 1.0
    preload: float = 0.0
    rest_force: float = 0.0

    def force(self, deformation: Reals, rate: Reals) -> Reals:
        """
        Evaluate the force per unit of the coefficient.

        Parameters
        ----------
        deformation : ndarray
            [m] or [rad].
        rate : ndarray, same shape
            [m/s] or [rad/s].

        Returns
        -------
        ndarray, same shape

        """
        match self.kind:
            case LawKind.LINEAR:
                return deformation - self.rest_force
            case LawKind.VISCOUS:
                return rate
            case LawKind.SIGNED_POWER:
                return signed_power(deformation, self.exponent, self.preload) - self.rest_force
            case LawKind.CONTACT:
                return contact(deformation, self.exponent, self.preload) - self.rest_force
            case LawKind.POLYNOMIAL:
                return polynomial(deformation, self.exponent) - self.rest_force

    def stiffness(self, deformation: Reals) -> Reals:
        """
        Differentiate the force per unit of the coefficient by the deformation.

        Parameters
        ----------
        deformation : ndarray
            [m] or [rad].

        Returns
        -------
        ndarray, same shape

        """
        match self.kind:
            case LawKind.LINEAR:
                return np.ones_like(deformation)
            case LawKind.VISCOUS:
                return np.zeros_like(deformation)
            case LawKind.SIGNED_POWER:
                return signed_power_slope(deformation, self.exponent, self.preload)
            case LawKind.CONTACT:
                return contact_slope(deformation, self.exponent, self.preload)
            case LawKind.POLYNOMIAL:
                return polynomial_slope(deformation, self.exponent)

    @property
    def damping(self) -> float:
        """Derivative of the force per unit of the coefficient by the rate."""
        return 1.0 if self.kind is LawKind.VISCOUS else 0.0
