# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Noise, resolution and mean of every channel from a record of the machine at rest."""

from collections.abc import Iterable
from dataclasses import dataclass

from identnl_ros.core.calibration.quiet_statistics import QuietStatistics, SEGMENT, white_noise
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.measurement.measured_record import MeasuredRecord
import numpy as np
from numpy.typing import NDArray

# Chance that a white channel is said not to be white.
FALSE_ALARM = 1e-3
# Segments that the spectra of a record need.
FEWEST_SEGMENTS = 10
# Means of so many stretches show how slowly the offset wanders.
STRETCHES = 20
# The converter's rounding is white noise of its own while the noise is this many steps at least.
NOISE_OVER_STEP = 0.5
# Bins above the white noise, from the lowest on, with gaps of at most this many.
LOW_GAP = 2


@dataclass(frozen=True)
class Line:
    """
    A line in the spectrum.

    Parameters
    ----------
    frequency : float
        [Hz].
    amplitude : float
        Root mean square [SI].

    """

    frequency: float
    amplitude: float


@dataclass(frozen=True)
class QuietChannel:
    """
    One channel at rest, in SI by the gain of the layout.

    Parameters
    ----------
    sensor : Sensor
    noise : float
        Standard deviation of one sample, of the white part, rounding of the converter included.
    relative_error : float
        Standard error over it.
    density : float
        The same noise per root hertz, one-sided.
    resolution : float
        Step of the converter; 0: none is seen.
    mean, mean_error : float
        With its standard error, slow changes included.
    drift, drift_error : float
        Growth of the mean [SI/s].
    lines : tuple of Line
        Above the white noise, the strongest first.
    low_frequency : float
        Up to which the noise is more than white [Hz]; 0: nowhere.

    """

    sensor: Sensor
    noise: float
    relative_error: float
    density: float
    resolution: float
    mean: float
    mean_error: float
    drift: float
    drift_error: float
    lines: tuple[Line, ...]
    low_frequency: float

    @property
    def white(self) -> bool:
        """Whether nothing is above the white noise."""
        return not self.lines and not self.low_frequency

    @property
    def own_noise(self) -> float:
        """Without the converter's rounding; NaN: hidden in its steps."""
        if self.resolution and self.noise < NOISE_OVER_STEP * self.resolution:
            return float('nan')
        return float(np.sqrt(self.noise**2 - self.resolution**2 / 12))


def quiet_channels(records: Iterable[MeasuredRecord], layout: Layout) -> tuple[QuietChannel, ...]:
    """
    Find noise, resolution and mean of every channel.

    Parameters
    ----------
    records : iterable of MeasuredRecord
        Of `layout`, at one sample rate.
    layout : Layout

    Returns
    -------
    tuple of QuietChannel
        Of the channels with enough valid samples.

    Raises
    ------
    DataError
        If the record is too short.

    """
    found: list[QuietStatistics] = []
    duration = 0.0
    for record in records:
        duration += len(record.samples) / record.sample_rate
        found = found or [QuietStatistics(record.sample_rate) for _ in layout.sensors]
        if record.sample_rate != found[0].sample_rate:
            raise DataError(
                f'quiet record: sample rates of {found[0].sample_rate:g} and '
                f'{record.sample_rate:g} Hz; give one record'
            )
        for one, samples in zip(found, record.samples.T, strict=True):
            one.add(samples)
    channels = tuple(
        _channel(sensor, one, FALSE_ALARM / len(found))
        for sensor, one in zip(layout.sensors, found, strict=False)
        if one.segments >= FEWEST_SEGMENTS
    )
    if not channels:
        raise DataError(_too_short(duration, found[0].sample_rate if found else None))
    return channels


def _too_short(duration: float, sample_rate: float | None) -> str:
    # Segments overlap by half.
    samples = (FEWEST_SEGMENTS + 1) * SEGMENT // 2
    needed = f'{samples} samples'
    if sample_rate is not None:
        needed = f'{samples / sample_rate:.3g} s ({needed} at {sample_rate:g} Hz)'
    return (
        f'quiet record: no channel is valid for {needed} without a gap, found a record of '
        f'{duration:.3g} s in all; record for longer'
    )


def _channel(sensor: Sensor, found: QuietStatistics, false_alarm: float) -> QuietChannel:
    white = white_noise(found, false_alarm)
    rate = found.sample_rate
    noise = float(np.sqrt(white.density * rate / 2))
    error, drift, drift_error = _slow(found, noise)
    lines, low = _above(found, white.above, white.density)
    return QuietChannel(
        sensor, noise, white.relative_error, float(np.sqrt(white.density)), found.step,
        found.mean, error, drift, drift_error, lines, low,
    )  # fmt: skip


def _slow(found: QuietStatistics, noise: float) -> tuple[float, float, float]:
    """Give the standard error of the mean, the drift and its standard error."""
    white = noise / np.sqrt(found.count)
    means = found.means
    parts = [float(part.mean()) for part in np.array_split(means, min(STRETCHES, len(means)))]
    if len(parts) < 4:
        return float(white), 0.0, float('inf')
    spread = float(np.std(parts, ddof=1) / np.sqrt(len(parts)))
    duration = found.count / found.sample_rate
    time = (np.arange(len(parts)) + 0.5) / len(parts) * duration
    time -= time.mean()
    slope = float(time @ parts / (time @ time))
    rest = np.array(parts) - np.mean(parts) - slope * time
    slope_error = float(np.sqrt(rest @ rest / (len(parts) - 2) / (time @ time)))
    return max(float(white), spread), slope, slope_error


def _above(
    found: QuietStatistics, above: NDArray[np.int64], white: float
) -> tuple[tuple[Line, ...], float]:
    """Group bins above the white noise: growth to low frequencies, and lines."""
    groups: list[list[int]] = []
    for one in above.tolist():
        if groups and one - groups[-1][-1] <= LOW_GAP:
            groups[-1].append(one)
        else:
            groups.append([one])
    frequencies, density = found.frequencies, found.density
    low = 0.0
    # A line has a peak; what begins at the lowest bin and falls is no line.
    if groups and groups[0][0] <= 4 and density[groups[0][0]] >= density[groups[0]].max() / 2:
        low = float(frequencies[groups.pop(0)[-1]])
    step = frequencies[1]
    lines = [
        Line(
            float(frequencies[group] @ density[group] / density[group].sum()),
            float(np.sqrt((density[group] - white).sum() * step)),
        )
        for group in groups
    ]
    return tuple(sorted(lines, key=lambda line: -line.amplitude)), low
