# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Frequencies that stand out of what a model leaves unexplained: of forces nobody measures."""

from identnl_ros.core.discrepancy.evidence import Evidence
import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.stats import chi2

MOST = 2
# Probability that a line of pure noise stands out, of all lines together.
FALSE_ALARM_RATE = 1e-3
# Parts of the distance of lines in which a frequency is looked for.
PARTS = np.linspace(-1, 1, 41)


def standing_out(evidence: Evidence) -> tuple[float, ...]:
    """
    Find the frequencies of the strongest lines that noise cannot have made.

    Parameters
    ----------
    evidence : Evidence

    Returns
    -------
    tuple of float
        [Hz]; strongest first, none where nothing stands out.

    """
    count = evidence.channels.count
    residual = evidence.remaining.residual[:count]
    power = np.sum(np.abs(residual) ** 2, axis=0)
    limit = chi2.isf(FALSE_ALARM_RATE / len(power), 2 * count)
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner > limit) & (inner >= power[:-2]) & (inner >= power[2:]))
    strongest = peaks[np.argsort(-power[peaks])][:MOST]
    return tuple(_refined(evidence, residual, int(line)) for line in strongest)


def _refined(evidence: Evidence, residual: NDArray[np.complexfloating], line: int) -> float:
    """Find the frequency between lines at which a harmonic explains most."""
    lines = residual.copy()
    lines[:, 1:] /= np.sqrt(2.0)
    comparison = evidence.comparison
    samples = comparison.count // comparison.average
    series = fft.irfft(lines, samples, axis=1)
    spacing = float(evidence.frequencies[1])
    places = np.arange(samples) * (comparison.average / comparison.rate)
    found = spacing * (line + PARTS)
    waves = np.exp(-2j * np.pi * np.outer(places, found))
    power = np.sum(np.abs(series @ waves) ** 2, axis=0)
    return float(found[np.argmax(power)])
