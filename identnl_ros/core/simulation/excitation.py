# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Force signals of exciters, as functions of time."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from identnl_ros.core.errors import DataError
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

# Instants evaluated together by the addition theorem.
GRID_CHUNK = 256
# Of the spline through a record: leaves 3e-10 of a sine at a tenth of the sample rate, where a
# cubic one leaves 3e-4, and 1e-15 at a thirtieth.
SPLINE_DEGREE = 9
# Pieces of a recorded force that are kept once they were evaluated.
MOST_KNOWN = 256


class Signal(Protocol):
    """A force over time."""

    def on_grid(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        """
        Evaluate at equally spaced instants.

        Parameters
        ----------
        start : float
            First instant [s].
        step : float
            [s].
        count : int

        Returns
        -------
        ndarray, shape (count,)
            [N].

        """
        ...


@dataclass(frozen=True)
class Harmonics:
    """
    Sum of sines: a single sine or a multisine.

    Parameters
    ----------
    amplitudes : ndarray, shape (n_lines,)
        [N].
    frequencies : ndarray, shape (n_lines,)
        [Hz].
    phases : ndarray, shape (n_lines,)
        Of the sine at time zero [rad].

    """

    amplitudes: NDArray[np.float64]
    frequencies: NDArray[np.float64]
    phases: NDArray[np.float64]

    def on_grid(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        """Evaluate at equally spaced instants (see `Signal`)."""
        # sin(coarse + fine) = sin coarse cos fine + cos coarse sin fine: two small tables and
        # a matrix product instead of a sine for every line and instant.
        coarse = start + step * GRID_CHUNK * np.arange(-(-count // GRID_CHUNK))
        angle = np.outer(coarse, 2 * np.pi * self.frequencies) + self.phases
        left = np.hstack((self.amplitudes * np.sin(angle), self.amplitudes * np.cos(angle)))
        return (left @ self._fine_table(step)).ravel()[:count]

    def _fine_table(self, step: float) -> NDArray[np.float64]:
        if step not in self._fine_tables:
            angle = np.outer(2 * np.pi * self.frequencies, step * np.arange(GRID_CHUNK))
            self._fine_tables[step] = np.vstack((np.cos(angle), np.sin(angle)))
        return self._fine_tables[step]

    @cached_property
    def _fine_tables(self) -> dict[float, NDArray[np.float64]]:
        return {}


@dataclass(frozen=True)
class Sweep:
    """
    Sine whose frequency rises linearly, again and again.

    Parameters
    ----------
    amplitude : float
        [N].
    band : tuple of float
        First and last frequency [Hz].
    duration : float
        Of one sweep [s].

    """

    amplitude: float
    band: tuple[float, float]
    duration: float

    def on_grid(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        """Evaluate at equally spaced instants (see `Signal`)."""
        time = np.mod(start + step * np.arange(count), self.duration)
        low, high = self.band
        cycles = low * time + (high - low) * time**2 / (2 * self.duration)
        return np.asarray(self.amplitude * np.sin(2 * np.pi * cycles))


@dataclass(frozen=True)
class Impulses:
    """
    Half-sine pulses, as of a hammer.

    Parameters
    ----------
    amplitude : float
        Peak [N].
    width : float
        Contact time of one blow [s].
    interval : float
        Between blows [s]; the first starts at half a contact time.

    """

    amplitude: float
    width: float
    interval: float

    def on_grid(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        """Evaluate at equally spaced instants (see `Signal`)."""
        time = np.mod(start + step * np.arange(count) - self.width / 2, self.interval)
        pulse = np.sin(np.pi * time / self.width)
        return np.where(time < self.width, self.amplitude * pulse, 0.0)


@dataclass(frozen=True)
class RecordedForce:
    """
    A measured force, interpolated by a spline; zero outside the record.

    Parameters
    ----------
    samples : ndarray, shape (n_samples,)
        [N].
    sample_rate : float
        [Hz].

    Raises
    ------
    DataError
        If the record is too short or not finite.

    """

    samples: NDArray[np.float64]
    sample_rate: float

    def __post_init__(self) -> None:
        """Check the record."""
        if self.samples.size < 4 or not np.all(np.isfinite(self.samples)):
            raise DataError('recorded force: expected at least four finite samples')

    def on_grid(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        """Evaluate at equally spaced instants (see `Signal`)."""
        # Fits simulate the same stretch again and again.
        if (start, step, count) not in self._known:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            self._known[start, step, count] = self._evaluated(start, step, count)
        return self._known[start, step, count]

    def _evaluated(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        time = start + step * np.arange(count)
        # A thousandth of a sample: instants computed in another order may round otherwise.
        place = time * self.sample_rate
        inside = (place > -1e-3) & (place < self.samples.size - 1 + 1e-3)
        force = np.where(inside, self._spline(time), 0.0)
        force.flags.writeable = False
        return force

    @cached_property
    def _known(self) -> dict[tuple[float, float, int], NDArray[np.float64]]:
        return {}

    @cached_property
    def _spline(self) -> BSpline:
        degree = min(SPLINE_DEGREE, (self.samples.size - 2) // 2 * 2 + 1)
        time = np.arange(self.samples.size) / self.sample_rate
        return make_interp_spline(time, self.samples, degree)


def sine(amplitude: float, frequency: float) -> Harmonics:
    """
    Single sine, zero at time zero.

    Parameters
    ----------
    amplitude : float
        [N].
    frequency : float
        [Hz].

    Returns
    -------
    Harmonics

    """
    return Harmonics(np.array([amplitude]), np.array([frequency]), np.zeros(1))


def multisine(
    amplitude: float,
    band: tuple[float, float],
    period: float,
    generator: np.random.Generator,
    odd: bool = False,
) -> Harmonics:
    """
    Random-phase multisine: equal lines at the multiples of 1 / period in a band.

    Parameters
    ----------
    amplitude : float
        The multisine has the root mean square of a sine of this amplitude [N].
    band : tuple of float
        Lowest and highest frequency [Hz].
    period : float
        After which it repeats [s].
    generator : numpy.random.Generator
        For the phases.
    odd : bool
        Odd multiples only: what the response shows at even ones is then even nonlinearity.

    Returns
    -------
    Harmonics

    Raises
    ------
    DataError
        If no line falls into the band.

    """
    lines = np.arange(
        np.ceil(band[0] * period * (1 - 1e-12)), np.floor(band[1] * period * (1 + 1e-12)) + 1
    )
    lines = lines[(lines > 0) & ((lines % 2 == 1) | (not odd))]
    if lines.size == 0:
        raise DataError(
            f'multisine: no {"odd " if odd else ""}multiple of {1 / period:g} Hz lies between '
            f'{band[0]:g} and {band[1]:g} Hz; widen the band or lengthen the period'
        )
    return multisine_of(amplitude, lines / period, generator)


def multisine_of(
    amplitude: float, frequencies: NDArray[np.float64], generator: np.random.Generator
) -> Harmonics:
    """
    Random-phase multisine of chosen lines.

    Parameters
    ----------
    amplitude : float
        The multisine has the root mean square of a sine of this amplitude [N].
    frequencies : ndarray, shape (n_lines,)
        [Hz].
    generator : numpy.random.Generator
        For the phases.

    Returns
    -------
    Harmonics

    """
    return Harmonics(
        np.full(frequencies.size, amplitude / np.sqrt(frequencies.size)),
        frequencies,
        generator.uniform(0, 2 * np.pi, frequencies.size),
    )
