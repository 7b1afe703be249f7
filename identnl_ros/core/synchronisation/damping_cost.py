# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a delay between acceleration and the other readings costs of the damping."""

from identnl_ros.core.errors import IdentnlError
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.mechanics.modes import modes
from identnl_ros.core.readable import readable
import numpy as np
from numpy.typing import NDArray

# A relative error of damping that is worth a word [-].
TOLERABLE_COST = 0.01
MORE_MOTION = 'Measure longer, or with more motion or less noise'


def damping_cost(
    delay: float,
    frequency: NDArray[np.float64] | float,
    damping_ratio: NDArray[np.float64] | float,
) -> NDArray[np.float64]:
    """
    Relative error of damping if acceleration is late against force and displacement.

    A late acceleration has a share in phase with the velocity: ``-omega delay / (2 zeta)`` of
    the damping at a resonance.

    Parameters
    ----------
    delay : float
        [s].
    frequency : ndarray or float
        Natural frequencies [Hz].
    damping_ratio : ndarray or float
        Of the same modes [-].

    Returns
    -------
    ndarray
        [-]; -0.24: 24 % of the damping are lost.

    """
    omega = 2 * np.pi * np.asarray(frequency, dtype=np.float64)
    return np.asarray(-omega * delay / (2 * np.asarray(damping_ratio, dtype=np.float64)))


def delay_warning(
    name: str,
    delay: float,
    frequencies: NDArray[np.float64],
    damping_ratios: NDArray[np.float64],
    tolerable: float = TOLERABLE_COST,
    advice: str = MORE_MOTION,
) -> str | None:
    """
    Say by how much damping suffers from a delay that may remain.

    Parameters
    ----------
    name : str
        Of the late source or channel.
    delay : float
        Delay, or its 95 % bound [s].
    frequencies, damping_ratios : ndarray, shape (n_modes,)
        Of the machine's modes [Hz, -].
    tolerable : float
        Relative error of damping below which nothing is said [-].
    advice : str
        What to do, a sentence without its full stop.

    Returns
    -------
    str or None
        None: nothing worth a warning.

    """
    if np.isnan(delay) or np.isinf(delay):
        return (
            f'{name}: the data do not tell its delay; damping may be wrong by any amount. Add '
            'redundant sensors, or state the delay in the layout'
        )
    change = damping_change(delay, frequencies, damping_ratios, tolerable)
    if change is None:
        return None
    return (
        f'{name}: a delay of {readable(abs(delay), "s")} may remain; it changes {change}. {advice}'
    )


def damping_change(
    delay: float,
    frequencies: NDArray[np.float64],
    damping_ratios: NDArray[np.float64],
    tolerable: float = TOLERABLE_COST,
) -> str | None:
    """
    Say of which mode a delay changes the damping most.

    Parameters
    ----------
    delay : float
        [s].
    frequencies, damping_ratios : ndarray, shape (n_modes,)
        [Hz, -].
    tolerable : float
        Relative error of damping below which nothing is said [-].

    Returns
    -------
    str or None
        What is changed by how much; None: nothing worth a word.

    """
    cost = np.abs(damping_cost(delay, frequencies, damping_ratios))
    if cost.size == 0 or cost.max() <= tolerable:
        return None
    worst = int(np.argmax(cost))
    return f'the damping of the mode at {frequencies[worst]:.4g} Hz by up to {cost[worst]:.0%}'


def damped_modes(model: Model | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Find the modes whose damping delays can change.

    Parameters
    ----------
    model : Model or None

    Returns
    -------
    frequencies : ndarray, shape (n_modes,)
        [Hz]; none where a parameter has no value or the machine no state of rest.
    damping_ratios : ndarray, shape (n_modes,)
        [-].

    """
    if model is None or not np.isfinite(model.values).all():
        return np.empty(0), np.empty(0)
    try:
        found = modes(model, static_equilibrium(model))
    except IdentnlError:
        return np.empty(0), np.empty(0)
    held = [mode for mode in found if mode.damping_ratio > 0]
    frequencies = np.array([mode.frequency for mode in held])
    return frequencies, np.array([mode.damping_ratio for mode in held])
