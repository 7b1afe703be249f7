# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Running statistics of channels at rest: means of batches, spectra, steps of the converter."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma

Reals = NDArray[np.float64]

# Samples of a segment of the spectrum.
SEGMENT = 1024
# Bins that a constant, or a slow drift, reaches through the window.
BINS_OF_A_CONSTANT = 3
# Values of a channel that are looked at for steps.
MOST_VALUES = 2**16
# Steps are told if the values repeat: so many samples per different value.
REPEATED = 4.0
# Differences of values are whole numbers of steps to this.
WHOLE = 0.02


class QuietStatistics:
    """
    Sums over a record of one channel that is too long to be held.

    Parameters
    ----------
    sample_rate : float
        [Hz].

    """

    def __init__(self, sample_rate: float) -> None:
        self.sample_rate = sample_rate
        self.count = 0
        self.segments = 0
        self._sum = 0.0
        self._power = np.zeros(SEGMENT // 2 + 1)
        self._means: list[float] = []
        self._values: list[Reals] = []
        self._window = np.hanning(SEGMENT + 1)[:-1]

    def add(self, samples: Reals) -> None:
        """
        Take an uninterrupted run of samples.

        Parameters
        ----------
        samples : ndarray, shape (n_samples,)
            [SI]; NaN: no valid sample.

        """
        valid = samples[np.isfinite(samples)]
        self.count += len(valid)
        self._sum += float(valid.sum())
        if sum(len(one) for one in self._values) < MOST_VALUES:
            self._values.append(valid[:MOST_VALUES])
        for begin in range(0, len(samples) - SEGMENT + 1, SEGMENT // 2):
            part = samples[begin : begin + SEGMENT]
            if not np.isfinite(part).all():
                continue
            mean = float(part.mean())
            if begin % SEGMENT == 0:
                self._means.append(mean)
            self._power += np.abs(np.fft.rfft(self._window * (part - mean))) ** 2
            self.segments += 1

    @property
    def mean(self) -> float:
        """Of all samples [SI]; NaN: there is none."""
        return self._sum / self.count if self.count else float('nan')

    @property
    def means(self) -> Reals:
        """Of segments that do not overlap [SI]."""
        return np.array(self._means)

    @property
    def frequencies(self) -> Reals:
        """Of the bins of the spectrum [Hz]."""
        return np.asarray(np.fft.rfftfreq(SEGMENT, 1 / self.sample_rate), dtype=np.float64)

    @property
    def density(self) -> Reals:
        """One-sided power spectral density [SI^2/Hz]."""
        scale = self.sample_rate * float((self._window**2).sum()) * max(self.segments, 1) / 2
        return self._power / scale

    @property
    def step(self) -> float:
        """Step of the converter that the values show [SI]; 0: none is seen."""
        if not self._values:
            return 0.0
        values = np.concatenate(self._values)
        different = np.unique(values)
        # Values of one level differ by rounding, where gain and offset were taken out.
        levels = _merged(different, 1e-9 * max(float(np.ptp(different)), 1e-300))
        if len(levels) < 2 or len(values) < REPEATED * len(levels):
            return 0.0
        differences = np.diff(levels)
        step = float(differences.min())
        steps = np.round(differences / step)
        step = float(differences.sum() / steps.sum())
        return step if np.abs(differences / step - steps).max() < WHOLE else 0.0


@dataclass(frozen=True)
class WhiteNoise:
    """
    The white part of a spectrum, and what is above it.

    Parameters
    ----------
    density : float
        One-sided power spectral density [SI^2/Hz].
    relative_error : float
        Standard error of the standard deviation over it.
    above : ndarray of int
        Bins that are above it.

    """

    density: float
    relative_error: float
    above: NDArray[np.int64]


def white_noise(statistics: QuietStatistics, false_alarm: float) -> WhiteNoise:
    """
    Tell white noise from lines and from what grows to low frequencies.

    Bins above what white noise reaches are left out, again and again, beginning at the median.

    Parameters
    ----------
    statistics : QuietStatistics
    false_alarm : float
        Chance that white noise is said to have such a bin.

    Returns
    -------
    WhiteNoise

    """
    # Under Hann's window, segments that overlap by half are worth 18/19 of separate ones.
    shape = max(1.0, statistics.segments * 18 / 19)
    density = statistics.density
    used = np.arange(BINS_OF_A_CONSTANT, len(density) - 1)
    level = float(np.median(density[used])) / float(gamma.ppf(0.5, shape, scale=1 / shape))
    highest = float(gamma.isf(false_alarm / max(len(used), 1), shape, scale=1 / shape))
    low = used
    for _ in range(20):
        kept = used[density[used] <= highest * level]
        level = float(density[kept].mean()) if len(kept) else level
        if np.array_equal(kept, low):
            break
        low = kept
    # Samples count alike but for the ripple of the summed squares of the windows.
    worth = statistics.segments * SEGMENT / 2 * 18 / 19 * len(low) / (len(density) - 1)
    error = float(1 / np.sqrt(2 * max(worth, 1.0)))
    return WhiteNoise(level, error, np.setdiff1d(used, low))


def _merged(values: Reals, tolerance: float) -> Reals:
    """Levels of sorted values, each the first of those that differ by rounding."""
    starts = np.concatenate(([True], np.diff(values) > tolerance))
    return np.asarray(values[starts])
