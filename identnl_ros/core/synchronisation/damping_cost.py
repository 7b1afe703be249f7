# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a delay between acceleration and the other readings costs of the damping."""

import numpy as np
from numpy.typing import NDArray

# A relative error of damping that is worth a word [-].
TOLERABLE_COST = 0.01


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
    cost = np.abs(damping_cost(delay, frequencies, damping_ratios))
    if cost.size == 0 or cost.max() <= tolerable:
        return None
    worst = int(np.argmax(cost))
    return (
        f'{name}: a delay of {abs(delay) * 1e6:.3g} us may remain; it changes the damping of the '
        f'mode at {frequencies[worst]:.4g} Hz by up to {cost[worst]:.0%}. Measure longer, or '
        'with more motion or less noise'
    )
