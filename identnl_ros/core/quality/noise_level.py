# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Noise that is not what the layout states, and content close to half the sample rate."""

from itertools import pairwise

from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.residual_scale import median_of_valid
import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import blackmanharris

# Fourth differences take the low frequencies down by 80 dB and more before the transform.
DIFFERENCES = 4
LENGTH = 256
SEGMENT = LENGTH + DIFFERENCES  # samples
SPACING = 0.05  # [s] between segments, about
KEPT, LEAST = 40, 24  # segments
# Edges of the bands, shares of the sample rate. Noise is judged in all but the last, where
# filters of the converter may take it away.
EDGES = np.array([0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.495])
QUIET = slice(0, 4)
NOISE_BANDS = slice(0, 5)
TOP = slice(4, 6)
# Median of the mean square of about six independent bins, over its expectation.
MEDIAN_FACTOR = (1 - 2 / (9 * 12.0)) ** 3
NOISE_RATIO = 2.0
ALIASING_RATIO = 10.0  # of power
# Quantisation is white, and noise can be judged, up to this many standard deviations a step.
COARSE = 2.0
ROUNDING = 1e-11


class NoiseLevel:
    """
    Level of the noise in bands near half the sample rate.

    Statistic: power density, as the standard deviation of white noise that has it, in bands of
    a twentieth of the sample rate; the median of 40 segments (2 s), so that blows do not count.
    Its own uncertainty is 4 %.

    NOISE: all bands from 0.2 to 0.45 of the sample rate are above twice, or most below half of
    what is stated (noise and converter step together). Motion falls off with frequency and
    spares the quietest band; the thresholds are 15 standard deviations away from what white
    noise gives, false alarms come from motion in all bands only. Found in 99 % of the cases:
    three times or a third of what is stated, after 2 s. Not judged where noise is not stated,
    or 0, or the converter step larger than two standard deviations.

    ALIASING: the density above 0.4 of the sample rate is ten times that of the quietest band
    between 0.2 and 0.4, and of what is stated: content that rises towards half the sample rate.
    Found in 99 %: a line of twice the amplitude of the noise's standard deviation, between 0.4
    and 0.49 of the sample rate.

    Parameters
    ----------
    layout : Layout
    sample_rate : float
        [Hz].

    """

    def __init__(self, layout: Layout, sample_rate: float) -> None:
        self._spacing = round(SPACING * sample_rate)
        stated = np.array([sensor.noise for sensor in layout.sensors])
        self._stated = stated
        frequency = np.fft.rfftfreq(LENGTH)
        self._bins = [
            np.flatnonzero((frequency >= low) & (frequency < high))
            for low, high in pairwise(EDGES)
        ]
        window = blackmanharris(LENGTH, sym=False)
        self._window = window[:, np.newaxis]
        gain = 2 * np.sin(np.pi * np.maximum(frequency, 0.1))
        self._weight = 1 / ((window**2).sum() * gain ** (2 * DIFFERENCES))
        self._densities = np.full((KEPT, len(self._bins), len(layout.sensors)), np.nan)
        self._next = 0
        self._since = 0
        channels = len(layout.sensors)
        self.noise = np.full(channels, np.nan)
        self.top = np.full(channels, np.nan)
        self.conditions = np.zeros(channels, dtype=np.uint16)

    def add(self, samples: NDArray[np.float64], count: int, step: NDArray[np.float64]) -> None:
        """
        Go on by some samples.

        Parameters
        ----------
        samples : ndarray, shape (n_samples, n_channels)
            The newest ones, at least `SEGMENT` where there are; NaN: no valid sample.
        count : int
            How many of them are new.
        step : ndarray, shape (n_channels,)
            Of the converters, as known so far [SI unit].

        """
        self._since += count
        if self._since < self._spacing or len(samples) < SEGMENT:
            return
        self._since = 0
        segment = samples[-SEGMENT:]
        with np.errstate(invalid='ignore'):
            difference = np.diff(segment, n=DIFFERENCES, axis=0)
            spectrum = np.fft.rfft(difference * self._window, axis=0)
            power = (spectrum.real**2 + spectrum.imag**2) * self._weight[:, np.newaxis]
            rounding = (ROUNDING * np.abs(segment).max(axis=0)) ** 2
        row = self._densities[self._next % KEPT]
        for band, bins in enumerate(self._bins):
            row[band] = power[bins].mean(axis=0) + rounding
        self._next += 1
        self._judge(step)

    def _judge(self, step: NDArray[np.float64]) -> None:
        judged = (self._stated > 0) & (step <= COARSE * self._stated)
        expected = np.where(judged, self._stated**2 + step**2 / 12, np.nan)
        floor = np.nan_to_num(self._stated) ** 2 + step**2 / 12
        flat = self._densities.reshape(KEPT, -1)
        density = median_of_valid(flat).reshape(self._densities.shape[1:]) / MEDIAN_FACTOR
        enough = np.isfinite(self._densities[:, 0]).sum(axis=0) >= LEAST
        noise = density[NOISE_BANDS]
        self.noise = np.sqrt(noise.min(axis=0))
        self.top = np.sqrt(density[TOP].max(axis=0))
        with np.errstate(invalid='ignore'):
            larger = noise.min(axis=0) > NOISE_RATIO**2 * expected
            smaller = np.median(noise, axis=0) < expected / NOISE_RATIO**2
            quiet = np.maximum(density[QUIET].min(axis=0), floor)
            aliasing = density[TOP].max(axis=0) > ALIASING_RATIO * quiet
        self.conditions = np.where(enough & (larger | smaller), Condition.NOISE, 0).astype(
            np.uint16
        ) | np.where(enough & aliasing, Condition.ALIASING, 0).astype(np.uint16)
