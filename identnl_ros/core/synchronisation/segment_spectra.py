# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Spectra of all motion sensors as if all measured acceleration, without differentiating."""

from dataclasses import dataclass

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.measured_record import MeasuredRecord, standard_deviations
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.stand import MOTION_KINDS
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

SHORTEST_SEGMENT = 128  # samples
LONGEST_SEGMENT = 2048
SEGMENTS_PER_RECORD = 10
MOST_SEGMENTS = 200
# Segments overlap so much that all samples inside the record count alike.
OVERLAP = 0.75
# Bins that a constant reaches through the window; an accelerometer's offset is there.
BINS_OF_A_CONSTANT = 3
# A bin is used if the readings have so many times the power of the noise.
POWER_OVER_NOISE = 1.5
# Of one channel in what no rigid motion explains of another [-].
NO_WEIGHT = 1e-9
# A channel with fewer valid samples is left out [-].
LEAST_VALID = 0.5


@dataclass(frozen=True)
class SegmentSpectra:
    """
    Acceleration spectra of every motion sensor in overlapping segments.

    A displacement d becomes the spectrum of an acceleration by partial integration, ``sum of
    (w exp(-i omega t))'' d = sum of w exp(-i omega t) d''``: exact at any frequency, whatever
    the record's length, since the window w and its derivative vanish at its ends. Constant
    offsets and linear drifts of displacements drop out.

    Parameters
    ----------
    channels : ndarray of int, shape (n_used,)
        Of the layout.
    rows : ndarray, shape (n_used, n_coordinates)
        Readings per unit of acceleration of every coordinate.
    frequencies : ndarray, shape (n_bins,)
        Angular [rad/s].
    begins : ndarray of int, shape (n_segments,)
        First samples of the segments.
    times : ndarray, shape (n_segments,)
        Middles of the segments from the middle of the record [s].
    length : int
        Samples of a segment.
    windows : ndarray, shape (3, length)
        The window and its derivatives [1, 1/s, 1/s^2].
    bins : ndarray of int, shape (n_bins,)
    orders : ndarray of int, shape (n_used,)
        How often the window is differentiated: 2 displacement, 1 velocity, 0 acceleration.
    noise : ndarray, shape (n_used,)
        Standard deviation of one sample [SI].
    spectra : ndarray of complex, shape (n_segments, n_bins, n_used)
        Known delays taken out.
    variance : ndarray, shape (n_bins, n_used)
        Of the spectra under the noise.

    """

    channels: NDArray[np.int64]
    rows: NDArray[np.float64]
    frequencies: NDArray[np.float64]
    begins: NDArray[np.int64]
    times: NDArray[np.float64]
    length: int
    windows: NDArray[np.float64]
    bins: NDArray[np.int64]
    orders: NDArray[np.int64]
    noise: NDArray[np.float64]
    spectra: NDArray[np.complex128]
    variance: NDArray[np.float64]

    @property
    def projections(self) -> NDArray[np.float64]:
        """Weights of what no rigid motion explains, shape (n_bins, n_used, n_used)."""
        weighted = self.rows / self.variance[:, :, np.newaxis]
        information = np.swapaxes(weighted, 1, 2) @ self.rows
        # Metres and radians on one footing; motions that no sensor sees drop out.
        scale = np.sqrt(np.einsum('fii->fi', information))
        scale[scale == 0] = 1.0
        scaled = weighted / scale[:, np.newaxis, :]
        inverse = np.linalg.pinv(
            information / scale[:, :, np.newaxis] / scale[:, np.newaxis, :], 1e-12, True
        )
        result: NDArray[np.float64] = -scaled @ inverse @ np.swapaxes(scaled, 1, 2)
        own = np.arange(len(self.channels))
        result[:, own, own] += 1 / self.variance
        return result

    @property
    def groups(self) -> NDArray[np.int64]:
        """Channels that are linked by redundancy have the same number, shape (n_used,)."""
        weights = self.projections * np.sqrt(
            self.variance[:, :, np.newaxis] * self.variance[:, np.newaxis, :]
        )
        most = np.abs(weights).max(axis=0, initial=0.0)
        _, groups = connected_components(most > NO_WEIGHT, directed=False)
        return np.asarray(groups, dtype=np.int64)

    def taken_back(self, used: int, coefficients: NDArray[np.complex128]) -> NDArray[np.float64]:
        """
        Find what the samples of one channel add to weighted sums of its spectra.

        Parameters
        ----------
        used : int
            The channel, as an index into `channels`.
        coefficients : ndarray of complex, shape (n_sums, n_segments, n_bins)
            The sums are the real parts of coefficients times spectra.

        Returns
        -------
        ndarray, shape (n_sums, n_samples)
            Weights of the samples, from the first of the first segment on.

        """
        factors = _factors(int(self.orders[used]), self.frequencies)
        total = np.zeros((len(coefficients), int(self.begins[-1]) + self.length))
        padded = np.zeros((len(coefficients), self.length), dtype=np.complex128)
        for segment, begin in enumerate(self.begins):
            for window, factor in zip(self.windows, factors, strict=False):
                # Re of sum c exp(-i omega t): the conjugate's inverse transform, unscaled.
                padded[:, self.bins] = np.conj(coefficients[:, segment] * factor)
                piece = np.fft.ifft(padded, norm='forward').real
                total[:, begin : begin + self.length] += window * piece
        return total


def segment_spectra(model: Model, record: MeasuredRecord) -> SegmentSpectra:
    """
    Transform the motion sensors of a record.

    Parameters
    ----------
    model : Model
    record : MeasuredRecord

    Returns
    -------
    SegmentSpectra

    Raises
    ------
    DataError
        If no sensor has noise or too little of the record is valid.

    """
    sensors = record.layout.sensors
    motion = np.array([i for i, one in enumerate(sensors) if one.kind in MOTION_KINDS])
    known = np.asarray(np.isfinite(record.samples).any(axis=1))
    first, end = (int(np.argmax(known)), len(known) - int(np.argmax(known[::-1])))
    samples = record.samples[first:end]
    share = np.isfinite(samples[:, motion]).mean(axis=0) if len(samples) else np.zeros(len(motion))
    channels = motion[share >= LEAST_VALID]
    noise = standard_deviations(record)[channels]
    # Perfect sensors: only the ratios count, as those of rounding would.
    noise = np.where(noise > 0, noise, 1e-12 * np.nanstd(samples[:, channels], axis=0))
    noise = np.maximum(noise, np.finfo(float).tiny ** 0.25)
    length = int(np.clip(len(samples) // SEGMENTS_PER_RECORD, SHORTEST_SEGMENT, LONGEST_SEGMENT))
    hop = max(int(length * (1 - OVERLAP)), -(-len(samples) // MOST_SEGMENTS))
    begins = np.arange(0, len(samples) - length + 1, hop)
    whole = np.asarray(np.isfinite(samples[:, channels]).all(axis=1))
    begins = np.array([one for one in begins if whole[one : one + length].all()], dtype=np.int64)
    if len(begins) < 2 or len(channels) < 2:
        raise DataError(
            f'record: {len(begins)} segments of {length} samples in which {len(channels)} motion '
            'sensors are valid are too few to find delays, expected at least 2 of each'
        )
    rate = record.sample_rate
    windows = _windows(length, length / rate)
    bins = np.arange(BINS_OF_A_CONSTANT, (length + 1) // 2)
    frequencies = (2 * np.pi * rate / length * bins).astype(np.float64)
    orders = np.array([2 - MOTION_KINDS.index(sensors[i].kind) for i in channels])
    spectra = np.empty((len(begins), len(bins), len(channels)), dtype=np.complex128)
    for segment, begin in enumerate(begins):
        part = samples[begin : begin + length, channels]
        for order in np.unique(orders):
            own = orders == order
            total = np.zeros((len(bins), int(own.sum())), dtype=np.complex128)
            for power, factor in enumerate(_factors(int(order), frequencies)):
                moment = np.fft.rfft(windows[power][:, np.newaxis] * part[:, own], axis=0)
                total += factor[:, np.newaxis] * moment[bins]
            spectra[segment][:, own] = total
    delays = np.array([sensors[i].delay for i in channels])
    spectra *= np.exp(1j * np.outer(frequencies, delays))
    variance = np.empty((len(bins), len(channels)))
    for column, (order, deviation) in enumerate(zip(orders, noise, strict=True)):
        variance[:, column] = deviation**2 * _power(int(order), frequencies, windows)
    moving = np.mean(np.abs(spectra) ** 2 / variance, axis=(0, 2)) > POWER_OVER_NOISE
    rows = np.zeros((len(channels), len(model.coordinates)))
    rows[:] = sensor_matrix(model, tuple(sensors[i] for i in channels))
    middle = begins + (length - 1) / 2 + first
    return SegmentSpectra(
        channels,
        rows,
        frequencies[moving],
        begins,
        np.asarray((middle - (len(record.samples) - 1) / 2) / rate, dtype=np.float64),
        length,
        windows,
        bins[moving],
        orders,
        noise,
        spectra[:, moving],
        variance[moving],
    )


def _windows(length: int, duration: float) -> NDArray[np.float64]:
    """Give sin^4 over the segment and its first two derivatives; periodic."""
    angle = np.pi * np.arange(length) / length
    rate = np.pi / duration
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.stack(
        (
            sine**4,
            4 * rate * sine**3 * cosine,
            4 * rate**2 * sine**2 * (3 * cosine**2 - sine**2),
        )
    )


def _factors(order: int, frequencies: NDArray[np.float64]) -> list[NDArray[np.complex128]]:
    """
    Factors of the window's derivatives in what makes a reading an acceleration.

    Of w in (w e)'' they are -omega^2, of w' -2 i omega, of w'' 1; a velocity has -(w e)'.
    """
    one = np.ones(len(frequencies), dtype=np.complex128)
    if order == 0:
        return [one]
    if order == 1:
        return [1j * frequencies * one, -one]
    return [-(frequencies**2) * one, -2j * frequencies * one, one]


def _power(
    order: int, frequencies: NDArray[np.float64], windows: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Sum of squared magnitudes of what multiplies the samples of a reading."""
    total = np.zeros((len(frequencies), windows.shape[1]), dtype=np.complex128)
    for power, factor in enumerate(_factors(order, frequencies)):
        total += factor[:, np.newaxis] * windows[power]
    return np.asarray((np.abs(total) ** 2).sum(axis=1))
