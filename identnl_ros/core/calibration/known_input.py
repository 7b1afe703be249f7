# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Gains from a calibrator whose amplitude is known."""

from collections.abc import Iterable
from dataclasses import dataclass

from identnl_ros.core.calibration.findings import Calibrated, Findings, Property
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MeasuredRecord
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

Reals = NDArray[np.float64]

# The line is looked for so far from the frequency that is given.
BAND = 0.05
# Periods that a record of a calibrator needs.
FEWEST_PERIODS = 20
# Parts of a record whose amplitudes are compared.
PARTS = 8
# Of the amplitude's standard deviation between the parts, relative, from which on it is told.
UNSTEADY = 0.01


@dataclass(frozen=True)
class KnownAmplitude:
    """
    What a calibrator does.

    Parameters
    ----------
    sensor : str
    amplitude : float
        Root mean square [SI].
    frequency : float or None
        [Hz]; None: the strongest line.
    relative_error : float
        Standard uncertainty of the amplitude over it.
    standard : str
        What the uncertainty comes from, which others may have in common; empty: this alone.

    """

    sensor: str
    amplitude: float
    frequency: float | None = None
    relative_error: float = 0.0
    standard: str = ''


def calibrate_amplitude(
    records: Iterable[MeasuredRecord], layout: Layout, known: KnownAmplitude
) -> Findings:
    """
    Find the gain of a sensor from the amplitude of a line.

    Parameters
    ----------
    records : iterable of MeasuredRecord
        The longest one is used.
    layout : Layout
        By which the samples are SI.
    known : KnownAmplitude

    Returns
    -------
    Findings
        The sign of the gain is left as it is.

    Raises
    ------
    DataError
        If there is no such sensor, or too little of the line.

    """
    channel = channel_of(layout, known.sensor)
    sensor = layout.sensors[channel]
    samples, rate = _longest(records, channel, known.sensor)
    frequency = _line(samples, rate, known)
    periods = len(samples) * frequency / rate
    if periods < FEWEST_PERIODS:
        raise DataError(
            f'{known.sensor}: the record has {periods:.3g} periods of {frequency:.4g} Hz, '
            f'expected at least {FEWEST_PERIODS}'
        )
    amplitude, residual = _sine(samples, rate, frequency)
    parts = [_sine(part, rate, frequency)[0] for part in np.array_split(samples, PARTS)]
    spread = float(np.std(parts, ddof=1))
    error = max(_density(residual, rate, frequency) * rate / 2 / len(samples), spread**2 / PARTS)
    if amplitude < 5 * np.sqrt(error):
        raise DataError(
            f'{known.sensor}: no line of {frequency:.4g} Hz stands out of the noise; is it the '
            'sensor on the calibrator?'
        )
    factor = amplitude / known.amplitude
    relative = float(np.hypot(np.sqrt(error) / amplitude, known.relative_error))
    gain = sensor.gain * factor
    shares = {}
    if known.relative_error:
        name = known.standard or f'calibrator of {known.sensor}'
        shares[name] = gain * known.relative_error
    remarks = [
        f'{known.sensor}: {amplitude:.6g} {sensor.kind.unit} rms at {frequency:.6g} Hz by the '
        f'layout, {known.amplitude:.6g} known.'
    ]
    if spread > UNSTEADY * amplitude:
        remarks.append(
            f'{known.sensor}: the amplitude varies by {100 * spread / amplitude:.2g} % within the '
            'record; cut it to where the calibrator is steady.'
        )
    if not known.relative_error:
        remarks.append(
            f'{known.sensor}: the uncertainty of the known amplitude is not given, the standard '
            'error is that of the record alone.'
        )
    calibrated = Calibrated(
        known.sensor, Property.GAIN, sensor.gain, gain, abs(gain) * relative, shares=shares
    )
    return Findings((calibrated,), (), tuple(remarks))


def channel_of(layout: Layout, name: str) -> int:
    """
    Find a sensor.

    Parameters
    ----------
    layout : Layout
    name : str

    Returns
    -------
    int

    Raises
    ------
    DataError
        If there is none of this name.

    """
    names = [sensor.name for sensor in layout.sensors]
    if name not in names:
        raise DataError(f'there is no sensor {name}; the record has {", ".join(names)}')
    return names.index(name)


def _longest(records: Iterable[MeasuredRecord], channel: int, name: str) -> tuple[Reals, float]:
    """Find the longest uninterrupted samples of a channel."""
    best, rate = np.empty(0), 1.0
    for record in records:
        valid = np.isfinite(record.samples[:, channel])
        edges = np.flatnonzero(np.diff(np.concatenate(([False], valid, [False])).astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            if end - begin > len(best):
                best, rate = record.samples[begin:end, channel], record.sample_rate
    if len(best) < 4 * PARTS:
        raise DataError(f'{name}: the record of the calibrator has no valid samples')
    return best - best.mean(), rate


def _line(samples: Reals, rate: float, known: KnownAmplitude) -> float:
    """Find the frequency of the strongest line, in the band that is given."""
    power = np.abs(np.fft.rfft(samples * np.hanning(len(samples)))) ** 2
    frequencies = np.fft.rfftfreq(len(samples), 1 / rate)
    allowed = np.arange(len(power)) > 2
    if known.frequency is not None:
        allowed &= np.abs(frequencies - known.frequency) <= max(
            BAND * known.frequency, 2 * rate / len(samples)
        )
    if not allowed.any():
        raise DataError(
            f'{known.sensor}: {known.frequency:g} Hz is beyond half the sample rate, '
            f'{rate / 2:g} Hz'
        )
    near = float(frequencies[np.argmax(np.where(allowed, power, -1.0))])
    width = rate / len(samples)
    found = minimize_scalar(
        lambda one: float((_sine(samples, rate, one)[1] ** 2).sum()),
        bounds=(near - 0.6 * width, near + 0.6 * width), method='bounded',
        options={'xatol': 1e-6 * width},
    )  # fmt: skip
    return float(found.x)


def _sine(samples: Reals, rate: float, frequency: float) -> tuple[float, Reals]:
    """Root mean square of a line, and what is left without it."""
    angle = 2 * np.pi * frequency / rate * np.arange(len(samples))
    table = np.stack((np.cos(angle), np.sin(angle), np.ones(len(samples))), axis=1)
    values = np.linalg.lstsq(table, samples, rcond=None)[0]
    return float(np.hypot(values[0], values[1]) / np.sqrt(2)), samples - table @ values


def _density(residual: Reals, rate: float, frequency: float) -> float:
    """One-sided power spectral density beside the line, robust against other lines."""
    power = 2 * np.abs(np.fft.rfft(residual)) ** 2 / (rate * len(residual))
    frequencies = np.fft.rfftfreq(len(residual), 1 / rate)
    near = np.abs(frequencies - frequency) <= max(0.2 * frequency, 10 * rate / len(residual))
    return float(np.median(power[near]) / np.log(2))
