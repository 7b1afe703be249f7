# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A stream of samples as sums of products of acceleration spectra, of fixed size."""

from collections.abc import Iterator
from dataclasses import dataclass

from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.noise import NoiseEstimate
from identnl_ros.core.quality.leave_one_out import Flags, Reals
import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

SEGMENT = 0.8  # s, about: a power of two
SHORTEST = 128  # samples
SEGMENTS_PER_CHUNK = 5
HIGHEST = 500.0  # Hz; bodies are rigid below it, and machines move there
BANDS_PER_OCTAVE = 3
BINS_OF_A_CONSTANT = 3
# sin^4 as a sum of exponentials: its transform at the bins -2 to 2.
WINDOW = np.array([1, -4, 6, -4, 1]) / 16
# Variance of sums over neighbouring bins and overlapping segments, over that of as many
# independent values: mean of w^4 over the squared mean of w^2.
CORRELATED = 2.63
MAINS = (50.0, 60.0)
HARMONICS = 5
SIDE = (5, 6)  # bins from a line to where its window ends
# Invalid samples that are bridged: in a row, in a segment [-].
LONGEST_GAP = 5
MOST_BRIDGED = 0.01


@dataclass(frozen=True)
class Chunk:
    """
    Sums over some segments.

    Parameters
    ----------
    first_index, next_index : int
        Samples.
    products : ndarray, shape (n_sums, n_channels, n_channels)
        Real parts of the products of the spectra, summed over bins and segments.
    power : ndarray, shape (n_sums, 4)
        Sum of the power of all channels, each relative to its mean, over bins and segments;
        the same times the variance that white noise of variance 1 has in a spectrum of order
        0, 1, 2.
    means : ndarray, shape (n_segments, n_channels)
        Of the readings under the window.
    valid : ndarray of bool, shape (n_channels,)
    largest : ndarray, shape (n_channels,)
        Absolute value of the readings.

    """

    first_index: int
    next_index: int
    products: Reals
    power: Reals
    means: Reals
    valid: Flags
    largest: Reals


class Spectra:
    """
    Cuts a stream into segments and sums products of their acceleration spectra.

    A reading is differentiated by multiplying its transform by powers of i omega, before a
    window is applied that vanishes at the ends with three derivatives: the same as partial
    integration under the window, so offsets leave nothing beyond the lowest bins.

    Parameters
    ----------
    layout : Layout
        For the delays, which are taken out.
    orders : ndarray of int, shape (n_channels,)
    sample_rate : float
        [Hz].

    """

    def __init__(self, layout: Layout, orders: NDArray[np.int64], sample_rate: float) -> None:
        self.length = max(SHORTEST, 2 ** round(np.log2(SEGMENT * sample_rate)))
        self.hop = self.length // 2
        self.orders = orders
        step = sample_rate / self.length
        last = min(int(HIGHEST / step), int(0.45 * self.length))
        # Two more on either side, for the window.
        self._raw = np.arange(BINS_OF_A_CONSTANT - 2, last + 3)
        self._bins = self._raw[2:-2]
        omega = 2 * np.pi * step * self._raw
        self._factors = (1j * omega) ** orders[:, np.newaxis]
        delays = np.array([sensor.delay for sensor in layout.sensors])
        self._factors = self._factors * np.exp(1j * np.outer(delays, omega))
        powers = np.stack([omega ** (2 * order) for order in range(3)])
        self._noise = self.length * _convolved(powers, WINDOW**2)
        self.frequencies = step * self._bins
        self.bands = _bands(self._bins)
        self.lines = _lines(self.frequencies, step)
        self._sums = [np.asarray(one) for one in self.bands]
        for line in self.lines:
            place = int(np.argmin(np.abs(self.frequencies - line)))
            side = [place + sign * i for i in SIDE for sign in (-1, 1)]
            self._sums += [np.array([place + i]) for i in (0, -1, 1)] + [np.array(side)]
        self.bins_per_sum = np.array([len(one) for one in self._sums], dtype=np.float64)
        # Of the spectra under white noise of variance 1, per order, and their mean in a sum.
        self.noise_power = np.array(
            [[self._noise[order][one].mean() for order in orders] for one in self._sums]
        )
        self.omega = np.array([2 * np.pi * self.frequencies[one].mean() for one in self._sums])
        self._waiting = np.empty((0, len(orders)))
        self._next = 0
        self._stated = np.array(
            [np.hypot(one.noise, one.resolution / np.sqrt(12)) for one in layout.sensors]
        )
        self._unknown = np.flatnonzero(np.isnan(self._stated))
        self._estimate = NoiseEstimate(self._unknown.size)
        self._estimated = 0
        self._begin()

    @property
    def noise(self) -> Reals:
        """Standard deviation of a sample, stated or seen so far; NaN: neither."""
        result = self._stated.copy()
        result[self._unknown] = self._estimate.standard_deviation
        return result

    def add(self, first_index: int, samples: Reals) -> Iterator[Chunk]:
        """
        Take samples.

        Parameters
        ----------
        first_index : int
        samples : ndarray, shape (n_samples, n_channels)
            [SI]; NaN: not valid.

        Yields
        ------
        Chunk

        """
        if first_index != self._next:
            self._waiting = self._waiting[:0]
        self._waiting = np.concatenate((self._waiting, samples))
        self._next = first_index + len(samples)
        begin = 0
        while len(self._waiting) - begin >= self.length:
            place = self._next - len(self._waiting) + begin
            self._segment(place, self._waiting[begin : begin + self.length])
            begin += self.hop
            if len(self._means) == SEGMENTS_PER_CHUNK:
                yield self._chunk(place + self.length)
        self._waiting = self._waiting[begin:]

    def finish(self) -> Iterator[Chunk]:
        """
        Sum up the segments that wait for others, at the end of a stream.

        Yields
        ------
        Chunk
            At most one.

        """
        if self._means:
            place = self._next - len(self._waiting) - self.hop
            yield self._chunk(place + self.length)

    def _begin(self) -> None:
        self._spectra: list[NDArray[np.complex128]] = []
        self._means: list[Reals] = []
        self._valid = np.ones(len(self.orders), dtype=np.bool_)
        self._largest = np.zeros(len(self.orders))
        self._first = 0

    def _segment(self, place: int, samples: Reals) -> None:
        readings, valid = bridged(samples)
        raw = rfft(readings.T, axis=1)
        spectrum = _convolved(raw[:, self._raw] * self._factors, WINDOW)
        # Means under the window, over the mean of the window; -1 and -2 are conjugates of 1, 2.
        mean = WINDOW[2] * raw[:, 0] + 2 * WINDOW[3] * raw[:, 1] + 2 * WINDOW[4] * raw[:, 2]
        if not self._means:
            self._first = place
        self._spectra.append(spectrum)
        self._means.append(np.where(valid, mean.real / (WINDOW[2] * self.length), np.nan))
        self._valid &= valid
        self._largest = np.maximum(self._largest, np.abs(readings).max(axis=0))
        if self._unknown.size:
            if place != self._estimated:
                self._estimate.restart()
            self._estimate.add(samples[: self.hop, self._unknown])
            self._estimated = place + self.hop

    def _chunk(self, next_index: int) -> Chunk:
        whole = np.stack(self._spectra)
        # Segments and real and imaginary parts are rows alike.
        parts = np.concatenate((whole.real, whole.imag)).transpose(2, 0, 1)
        count = len(self.orders)
        products = np.empty((len(self._sums), count, count))
        power = np.empty((len(self._sums), 4))
        own = np.einsum('fkc,fkc->fc', parts, parts)
        total = own.mean(axis=0)
        share = (own / np.where(total > 0, total, 1.0)).sum(axis=1)
        for i, places in enumerate(self._sums):
            rows = parts[places].reshape(-1, count)
            products[i] = rows.T @ rows
            power[i, 0] = share[places].sum()
            power[i, 1:] = self._noise[:, places] @ share[places]
        result = Chunk(
            self._first, next_index, products, power, np.stack(self._means), self._valid,
            self._largest,
        )  # fmt: skip
        self._begin()
        return result


def bridged(samples: Reals) -> tuple[Reals, Flags]:
    """
    Interpolate short gaps.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n_channels)
        NaN: not valid.

    Returns
    -------
    samples : ndarray, shape (n_samples, n_channels)
        Zero where too much is missing.
    valid : ndarray of bool, shape (n_channels,)

    """
    missing = ~np.isfinite(samples)
    if not missing.any():
        return samples, np.ones(samples.shape[1], dtype=np.bool_)
    result = samples.copy()
    valid = np.asarray(~missing.any(axis=0))
    places = np.arange(len(samples))
    for channel in np.flatnonzero(~valid):
        lost = missing[:, channel]
        known = np.flatnonzero(np.concatenate(([True], ~lost, [True])))
        valid[channel] = np.diff(known).max() <= LONGEST_GAP + 1 and lost.mean() <= MOST_BRIDGED
        if valid[channel]:
            result[lost, channel] = np.interp(places[lost], places[~lost], samples[~lost, channel])
        else:
            result[:, channel] = 0.0
    return result, valid


def _convolved(values: NDArray[np.generic], kernel: Reals) -> NDArray[np.complex128]:
    """Convolve along the last axis where the kernel is inside."""
    count = values.shape[1] - len(kernel) + 1
    total = kernel[0] * values[:, :count]
    for i in range(1, len(kernel)):
        total = total + kernel[i] * values[:, i : i + count]
    return total  # type: ignore[no-any-return]


def _bands(bins: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Group bins, as indices, into fractions of octaves."""
    octave = np.floor(BANDS_PER_OCTAVE * np.log2(bins / bins[0]))
    return [np.flatnonzero(octave == one) for one in np.unique(octave)]


def _lines(frequencies: Reals, step: float) -> list[float]:
    """List the mains' frequencies and their multiples that can be told from what is beside."""
    reach = (SIDE[-1] + 1) * step
    every = {mains * n for mains in MAINS for n in range(1, HARMONICS + 1)}
    return [
        one for one in sorted(every) if frequencies[0] + reach <= one <= frequencies[-1] - reach
    ]
