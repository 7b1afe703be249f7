# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Force laws of elements beside springs, dampers and contacts, per unit of their coefficient.

Friction, quadratic damping, backlash, a spring with a gap, hysteresis: plain functions of numpy
universal functions only, as in `laws`.
"""

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


def coulomb(rate: Reals, transition: float) -> Reals:
    """
    Evaluate Coulomb friction, its step at standstill drawn out over some velocity.

    Parameters
    ----------
    rate : float or ndarray
        [m/s] or [rad/s].
    transition : float
        Rate at which 76 % of the friction acts [m/s] or [rad/s].

    Returns
    -------
    float or ndarray
        ``tanh(rate / transition)``.

    """
    return np.tanh(rate / transition)


def coulomb_slope(rate: Reals, transition: float) -> Reals:
    """
    Differentiate `coulomb` by the rate.

    Parameters
    ----------
    rate, transition
        As in `coulomb`.

    Returns
    -------
    float or ndarray

    """
    return (1.0 - np.tanh(rate / transition) ** 2) / transition


def stribeck(rate: Reals, transition: float, fading: float) -> Reals:
    """
    Evaluate by how much friction exceeds Coulomb's near standstill.

    Parameters
    ----------
    rate : float or ndarray
        [m/s] or [rad/s].
    transition : float
        As in `coulomb`.
    fading : float
        Rate at which the excess has fallen to 1/e [m/s] or [rad/s].

    Returns
    -------
    float or ndarray
        ``tanh(rate / transition) exp(-(rate / fading)^2)``.

    """
    return np.tanh(rate / transition) * np.exp(-((rate / fading) ** 2))


def stribeck_slope(rate: Reals, transition: float, fading: float) -> Reals:
    """
    Differentiate `stribeck` by the rate.

    Parameters
    ----------
    rate, transition, fading
        As in `stribeck`.

    Returns
    -------
    float or ndarray

    """
    friction = np.tanh(rate / transition)
    slope = (1.0 - friction**2) / transition - 2.0 * rate / fading**2 * friction
    return slope * np.exp(-((rate / fading) ** 2))


def quadratic_damping(rate: Reals) -> Reals:
    """
    Evaluate damping that grows with the square of the rate, against the motion.

    Parameters
    ----------
    rate : float or ndarray
        [m/s] or [rad/s].

    Returns
    -------
    float or ndarray
        ``rate |rate|``.

    """
    return rate * np.abs(rate)


def backlash(deformation: Reals, gap: float) -> Reals:
    """
    Evaluate what backlash takes away from the force of a linear spring.

    Parameters
    ----------
    deformation : float or ndarray
        [m] or [rad].
    gap : float
        Free play to each side [m] or [rad].

    Returns
    -------
    float or ndarray
        ``-deformation`` within the gap, ``-gap`` and ``gap`` beyond.

    """
    return -np.minimum(np.maximum(deformation, -gap), gap)


def bilinear(deformation: Reals, gap: float) -> Reals:
    """
    Evaluate a linear spring that begins to act behind a gap.

    Parameters
    ----------
    deformation : float or ndarray
        [m] or [rad].
    gap : float
        Deformation at which it begins [m] or [rad]; negative: it bears at rest.

    Returns
    -------
    float or ndarray
        ``deformation - gap``, 0 before the gap is closed.

    """
    return np.maximum(deformation - gap, 0.0)


def hysteresis_slope(direction: Reals, state: Reals, limit: float, exponent: float) -> Reals:
    """
    Differentiate the force of a hysteretic spring by its deformation, along the motion.

    The law of Bouc and Wen with equal shape factors: unloading is elastic, loading fades as the
    force approaches its limit. A large exponent makes Jenkins' element, a spring in series with
    dry friction.

    Parameters
    ----------
    direction : float or ndarray
        Its sign is that of the rate.
    state : float or ndarray
        Elastic deformation z, per unit of stiffness the force [m] or [rad].
    limit : float
        Largest elastic deformation [m] or [rad].
    exponent : float
        1 or more [-].

    Returns
    -------
    float or ndarray
        dz / d deformation: ``1 - |z / limit|^exponent`` in loading, 1 in unloading.

    """
    loading = 0.5 * (1.0 + np.sign(direction) * np.sign(state))
    return 1.0 - loading * np.abs(state / limit) ** exponent


def hysteresis_decay(rate: Reals, state: Reals, limit: float, exponent: float) -> Reals:
    """
    Differentiate the rate of a hysteretic state by the state itself.

    Parameters
    ----------
    rate : float or ndarray
        Of the deformation [m/s] or [rad/s].
    state, limit, exponent
        As in `hysteresis_slope`.

    Returns
    -------
    float or ndarray
        Zero in unloading, negative in loading [1/s]: what disturbed it is forgotten.

    """
    loading = 0.5 * (1.0 + np.sign(rate) * np.sign(state))
    return -np.abs(rate) * loading * exponent / limit * np.abs(state / limit) ** (exponent - 1.0)
