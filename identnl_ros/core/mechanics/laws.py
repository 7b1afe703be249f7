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

from identnl_ros.core.mechanics.element_laws import (
    backlash,
    bilinear,
    coulomb,
    coulomb_slope,
    hysteresis_slope,
    quadratic_damping,
    stribeck,
    stribeck_slope,
)
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
    BACKLASH = 5
    BILINEAR = 6
    COULOMB = 7
    STRIBECK = 8
    QUADRATIC_DAMPING = 9
    HYSTERESIS = 10
    DRIFTING = 11


# Forces that follow the rate, not in proportion to it.
RATE_KINDS = (LawKind.COULOMB, LawKind.STRIBECK, LawKind.QUADRATIC_DAMPING)
# Forces that bend within a small part of a motion.
SHARP_KINDS = (LawKind.BACKLASH, LawKind.BILINEAR, LawKind.COULOMB, LawKind.STRIBECK)


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
        Power of the deformation, or of the hysteretic state, where the kind has one [-].
    preload : float
        Deformation at rest, where the kind has one [m] or [rad].
    rest_force : float
        Force per unit of coefficient that is balanced at rest and therefore subtracted.
    gap : float
        Of backlash or of a bilinear stiffness [m] or [rad].
    transition : float
        Of friction: rate over which its step at standstill is drawn out [m/s] or [rad/s].
    fading : float
        Of Stribeck friction: rate at which it has fallen to 1/e [m/s] or [rad/s].
    limit : float
        Of hysteresis: largest elastic deformation [m] or [rad].

    """

    kind: LawKind
    exponent: float = 1.0
    preload: float = 0.0
    rest_force: float = 0.0
    gap: float = 0.0
    transition: float = 1.0
    fading: float = 1.0
    limit: float = 1.0

    def force(
        self,
        deformation: Reals,
        rate: Reals,
        hidden: Reals | None = None,
        time: Reals | float = 0.0,
    ) -> Reals:
        """
        Evaluate the force per unit of the coefficient.

        Parameters
        ----------
        deformation : ndarray
            [m] or [rad].
        rate : ndarray, same shape
            [m/s] or [rad/s].
        hidden : ndarray, same shape, or None
            Hysteretic state [m] or [rad]; None: that of rest, 0.
        time : ndarray, same shape, or float
            Since the begin of the stream [s].

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
            case LawKind.BACKLASH:
                return backlash(deformation, self.gap) - self.rest_force
            case LawKind.BILINEAR:
                return bilinear(deformation, self.gap) - self.rest_force
            case LawKind.COULOMB:
                return coulomb(rate, self.transition)
            case LawKind.STRIBECK:
                return stribeck(rate, self.transition, self.fading)
            case LawKind.QUADRATIC_DAMPING:
                return quadratic_damping(rate)
            case LawKind.HYSTERESIS:
                return np.zeros_like(deformation) if hidden is None else hidden
            case LawKind.DRIFTING:
                return deformation * time

    def stiffness(
        self,
        deformation: Reals,
        rate: Reals | None = None,
        hidden: Reals | None = None,
        time: Reals | float = 0.0,
    ) -> Reals:
        """
        Differentiate the force per unit of the coefficient by the deformation.

        Of hysteresis: along the motion; what an earlier change of the motion has left in its
        state is not in it.

        Parameters
        ----------
        deformation : ndarray
            [m] or [rad].
        rate, hidden : ndarray, same shape, or None
            Matter to hysteresis only; None: those of rest, 0.
        time : ndarray, same shape, or float
            Since the begin of the stream [s].

        Returns
        -------
        ndarray, same shape

        """
        match self.kind:
            case LawKind.LINEAR:
                return np.ones_like(deformation)
            case LawKind.SIGNED_POWER:
                return signed_power_slope(deformation, self.exponent, self.preload)
            case LawKind.CONTACT:
                return contact_slope(deformation, self.exponent, self.preload)
            case LawKind.POLYNOMIAL:
                return polynomial_slope(deformation, self.exponent)
            case LawKind.BACKLASH:
                return np.where(np.abs(deformation) < self.gap, -1.0, 0.0)
            case LawKind.BILINEAR:
                return np.where(deformation > self.gap, 1.0, 0.0)
            case LawKind.HYSTERESIS:
                if rate is None or hidden is None:
                    return np.ones_like(deformation)
                return hysteresis_slope(rate, hidden, self.limit, self.exponent)
            case LawKind.DRIFTING:
                return np.zeros_like(deformation) + time
            case _:
                return np.zeros_like(deformation)

    def rate_slope(self, rate: Reals) -> Reals:
        """
        Differentiate the force per unit of the coefficient by the rate.

        Parameters
        ----------
        rate : ndarray
            [m/s] or [rad/s].

        Returns
        -------
        ndarray, same shape

        """
        match self.kind:
            case LawKind.COULOMB:
                return coulomb_slope(rate, self.transition)
            case LawKind.STRIBECK:
                return stribeck_slope(rate, self.transition, self.fading)
            case LawKind.QUADRATIC_DAMPING:
                return 2.0 * np.abs(rate)
            case _:
                return np.full_like(rate, self.damping)

    @property
    def damping(self) -> float:
        """Derivative of the force by the rate where that is a constant, else 0."""
        return 1.0 if self.kind is LawKind.VISCOUS else 0.0
