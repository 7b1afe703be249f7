# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Which gains, directions and delays a motion tells, and why it does not tell the others."""

from collections.abc import Sequence

from identnl_ros.core.calibration.motion_likelihood import (
    ANGLES,
    DELAY,
    GAIN,
    Likelihood,
    Parameter,
    SensorState,
)
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Information below this share of that of a known motion is rounding.
NOTHING = 1e-9
# Of the raw information; what has less tells of noise rather than of motion.
SIGNAL_SHARE = 0.3
# A parameter takes part in an undetermined combination if it has this share of it.
TAKES_PART = 0.01
# Standard errors beyond which nothing is said: of gain, angle, and phase at the mean frequency.
LARGEST_ERROR = 0.05

_STILL = 'the machine does not move in the direction that would show it'
_ALONE = 'no other sensor measures the same motion'
_UNSEEN = 'the motion across its direction is not seen by the other sensors'
_NOISE = 'the motion that would show it is too small beside the noise'
TOGETHER = (
    'known only in combination with that of others: no trusted sensor is linked with it, or the '
    'machine moved in too few directions'
)


def weak_parameters(
    found: Likelihood, state: SensorState, free: Sequence[Parameter]
) -> dict[int, str]:
    """
    Find parameters that the data tell nothing of, each by itself.

    Parameters
    ----------
    found : Likelihood
    state : SensorState
    free : sequence of tuple of int
        The parameters.

    Returns
    -------
    dict of int to str
        Reasons, by place in `free`.

    """
    rows = state.rows()
    lengths = np.linalg.norm(rows, axis=0)
    lengths[lengths == 0] = 1.0
    _, values, right = np.linalg.svd(rows / lengths)
    seen = right[: int((values > NOTHING * values[0]).sum())]
    reasons = {}
    raw, alone = np.diag(found.raw), found.alone
    for i, (channel, which) in enumerate(free):
        slope = state.slope((channel, which)) / lengths
        # What a unit of acceleration of the point would give is 1.
        if not slope.any() or not alone[i] > 0:
            reasons[i] = _STILL
        elif which in ANGLES and np.linalg.norm(slope - seen.T @ (seen @ slope)) > 1e-6:
            reasons[i] = _UNSEEN
        elif raw[i] <= NOTHING * alone[i]:
            reasons[i] = _ALONE
        elif raw[i] - found.surplus[i, i] <= SIGNAL_SHARE * raw[i]:
            reasons[i] = _NOISE
    return reasons


def told_combinations(found: Likelihood) -> tuple[Reals, list[int]]:
    """
    Find the combinations of parameters that the data tell.

    Parameters
    ----------
    found : Likelihood

    Returns
    -------
    told : ndarray, shape (n_parameters, n_combinations)
        Orthonormal.
    together : list of int
        Parameters that take part in combinations that are not told.

    """
    scale = np.sqrt(found.alone)
    values, vectors = np.linalg.eigh(found.raw / np.outer(scale, scale))
    kept = values > NOTHING
    # In these combinations the raw information is 1.
    whitened = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, np.newaxis]
    signal = whitened.T @ (found.raw - found.surplus) @ whitened
    share, turned = np.linalg.eigh((signal + signal.T) / 2)
    good = whitened @ turned[:, share > SIGNAL_SHARE]
    # Not told is what all the good ones are uncorrelated with, in the raw information ...
    bad = np.concatenate(
        (vectors[:, ~kept] / scale[:, np.newaxis], whitened @ turned[:, share <= SIGNAL_SHARE]),
        axis=1,
    )
    if not bad.shape[1]:
        return np.linalg.qr(good)[0], []
    nothing = np.linalg.qr(bad)[0]
    # ... and among what is told, that which leaves it unmoved.
    whole = np.linalg.qr(np.concatenate((nothing, np.eye(len(scale))), axis=1))[0]
    part = np.linalg.norm(nothing, axis=1)
    return whole[:, nothing.shape[1] :], np.flatnonzero(part > TAKES_PART).tolist()


def too_uncertain(parameter: Parameter, error: float) -> str:
    """
    Say how badly a parameter is known.

    Parameters
    ----------
    parameter : tuple of int
    error : float
        Standard error: of a gain [-], a delay [s], an angle [rad].

    Returns
    -------
    str

    """
    size = {
        GAIN: f'{100 * error:.2g} %',
        DELAY: f'{1e6 * error:.2g} us',
    }.get(parameter[1], f'{np.degrees(error):.2g} degrees')
    return f'known to {size} only'
