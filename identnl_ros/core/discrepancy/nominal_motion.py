# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
The motion that a model is linearised about: simulated, corrected where measurement says so.

The equations of motion are linearised about a motion that need not solve them; what is left over
then, the defect, drives the linearised equations as one more force. So a missing effect may be
strong: features of it are evaluated where the machine was, not where an incomplete model has it.
Lines of the spectrum in which the deviation does not stand out of the noise are left as simulated,
so that noise of the sensors does not get into the features.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Reals = NDArray[np.float64]

# Power of a line of the spectrum over that of the noise, above which it is no noise: one line in
# 5e5 of pure noise.
STANDING_OUT = 13.0
# Part of the record at each end over which the correction fades in and out.
FADE = 0.02


@dataclass(frozen=True)
class NominalMotion:
    """
    A smooth motion with its exact derivatives.

    Parameters
    ----------
    displacement, velocity, acceleration : ndarray, shape (n_samples, n_coordinates)

    """

    displacement: Reals
    velocity: Reals
    acceleration: Reals


def corrected(
    simulated: NominalMotion,
    deviation: Reals,
    covariance: Reals,
    sample_rate: float,
    highest: float,
) -> NominalMotion:
    """
    Add to a simulated motion what is significant of the measured deviation from it.

    Parameters
    ----------
    simulated : NominalMotion
    deviation : ndarray, shape (n_samples, n_coordinates)
        Measured less simulated displacement.
    covariance : ndarray, shape (n_coordinates, n_coordinates)
        Of its noise; singular in directions without noise or not seen.
    sample_rate : float
        [Hz].
    highest : float
        Frequency beyond which there is nothing but noise [Hz].

    Returns
    -------
    NominalMotion

    """
    squares, directions = np.linalg.eigh(covariance)
    used = squares > 1e-12 * squares.max(initial=0.0)
    to_white = directions[:, used] / np.sqrt(squares[used])
    from_white = directions[:, used] * np.sqrt(squares[used])
    white = deviation @ to_white
    count = len(white)
    window = _fading(count)[:, np.newaxis]
    lines = fft.rfft(white * window, axis=0)
    power = np.abs(lines) ** 2 / float((window**2).sum())
    frequencies = fft.rfftfreq(count, 1 / sample_rate)
    lines[power < STANDING_OUT] = 0.0
    lines[frequencies > highest] = 0.0
    if not lines.any():
        return simulated
    rate = 2j * np.pi * frequencies[:, np.newaxis]
    parts = [fft.irfft(lines * rate**order, count, axis=0) @ from_white.T for order in range(3)]
    return NominalMotion(
        simulated.displacement + parts[0],
        simulated.velocity + parts[1],
        simulated.acceleration + parts[2],
    )


def _fading(count: int) -> Reals:
    edge = max(int(FADE * count), 1)
    window = np.ones(count)
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
    window[:edge] = rise
    window[-edge:] = rise[::-1]
    return window
