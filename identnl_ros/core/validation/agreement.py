# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Does a simulation agree with what the sensors show? Statistics and verdict.

A residual that is nothing but sensor noise has the size of that noise, and averages over k
samples are smaller by the root of k. Two more errors are allowed for: the parameters and the
measured force are uncertain, and the simulation with them; what they do to every average is
known from derivatives. So the mean square of the averages of every channel has a known
distribution, and one that is too large is as improbable as `tail_probability` says. Where the
parameters are known so badly that this hides everything, a second test takes out what they can
explain within their uncertainty (generalised least squares) and looks at the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.algebra.quadratic_form import tail_probability
from identnl_ros.core.measurement.layout import Sensor
from identnl_ros.core.validation.residual_sums import SCALES
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Chance that a right model is said to differ, over all tests of a comparison.
FALSE_ALARM_RATE = 0.01
# A stated noise is known as well as one estimated from so many samples: to 10 %.
STATED_DEGREES = 50.0


@dataclass(frozen=True)
class ScaleTest:
    """
    Mean square of averages of a residual against what noise and band make of it.

    Parameters
    ----------
    average : int
        Samples averaged over; 1: the size of the residual itself.
    ratio : float
        Root mean square over its expectation [-].
    probability : float
        Of so large a ratio or a larger one, if the model is right.
    beyond_band : bool
        What errors of the parameters within their uncertainty can explain is taken out.

    """

    average: int
    ratio: float
    probability: float
    beyond_band: bool = False


@dataclass(frozen=True)
class ChannelComparison:
    """
    One sensor against the simulation; NaN where it has no valid reading.

    Parameters
    ----------
    sensor : Sensor
    samples : int
        Valid readings compared.
    error : float
        Root mean square of measured minus simulated [SI].
    signal : float
        Root mean square of the measured signal about its mean [SI].
    noise : float
        Of one sample [SI]; 0: a perfect sensor.
    noise_stated : bool
        False: estimated from the fastest changes of the residual.
    band : float
        Standard deviation of the simulated signal from that of the parameters, root mean square
        over time, the initial state being fitted anew [SI].
    spread : float
        The same, from the noise of the force sensors and from what is not linear in the errors
        of the parameters [SI].
    tests : tuple of ScaleTest

    """

    sensor: Sensor
    samples: int
    error: float
    signal: float
    noise: float
    noise_stated: bool
    band: float
    spread: float
    tests: tuple[ScaleTest, ...]

    @property
    def nrmse(self) -> float:
        """Error over signal [-]; infinite or NaN where there is no signal."""
        return _quotient(self.error, self.signal)

    @property
    def floor(self) -> float:
        """Noise over signal [-]: the NRMSE that no model can do better than."""
        return _quotient(self.noise, self.signal)

    @property
    def ratio(self) -> float:
        """Error over noise [-]; infinite or NaN for a perfect sensor."""
        return _quotient(self.error, self.noise)

    @property
    def expected(self) -> float:
        """Error expected of a right model: all that it allows for together [SI]."""
        return float(np.linalg.norm((self.noise, self.band, self.spread)))

    @property
    def worst(self) -> ScaleTest | None:
        """The test with the least probability; None: no valid reading."""
        return min(self.tests, key=lambda one: (one.probability, -one.ratio), default=None)


@dataclass(frozen=True)
class StreamComparison:
    """
    All sensors of motion of a stream against the simulation.

    Parameters
    ----------
    sample_rate : float
        [Hz].
    runs : int
        Uninterrupted runs, each with an initial state of its own.
    samples : int
        Instants compared.
    channels : tuple of ChannelComparison
    joint_tests : tuple of ScaleTest
        Of all noisy channels together.

    """

    sample_rate: float
    runs: int
    samples: int
    channels: tuple[ChannelComparison, ...]
    joint_tests: tuple[ScaleTest, ...]


@dataclass(frozen=True)
class Agreement:
    """
    The verdict on one or several streams.

    Parameters
    ----------
    streams : tuple of StreamComparison

    """

    streams: tuple[StreamComparison, ...]

    @property
    def tests(self) -> tuple[ScaleTest, ...]:
        """All tests that the verdict rests on."""
        own = [test for one in self.streams for channel in one.channels for test in channel.tests]
        return (*own, *(test for one in self.streams for test in one.joint_tests))

    @property
    def threshold(self) -> float:
        """Probability below which a single test says that the model differs."""
        return FALSE_ALARM_RATE / max(len(self.tests), 1)

    @property
    def agrees(self) -> bool:
        """Nothing was seen that noise and stated uncertainty do not explain."""
        return not self.differs(self.tests)

    def differs(self, tests: Sequence[ScaleTest]) -> bool:
        """
        Judge some of the tests.

        Parameters
        ----------
        tests : sequence of ScaleTest

        Returns
        -------
        bool

        """
        return any(test.probability < self.threshold for test in tests)


@dataclass(frozen=True)
class NoiseReference:
    """
    Variance of the noise that a test compares with, and how well it is known.

    Parameters
    ----------
    variance : float
    degrees : float
        As if estimated from so many independent samples.

    """

    variance: float
    degrees: float


def scale_tests(
    level: int,
    products: Reals,
    count: float,
    draws: int,
    noise: NoiseReference,
    computation: float = 0.0,
) -> tuple[ScaleTest, ...]:
    """
    Test the averages of one channel, or of several together, at one scale.

    Parameters
    ----------
    level : int
        Index into `SCALES`.
    products : ndarray, shape (n, n)
        Of the columns of `ResidualSums`: band, draws of the force's noise, residual.
    count : float
        Number of averages.
    draws : int
    noise : NoiseReference
        In the units of the columns.
    computation : float
        Sum of squares of what the simulation itself may be wrong by, in these units.

    Returns
    -------
    tuple of ScaleTest
        Of the residual and, where there is a band, of what lies beyond it.

    """
    average = SCALES[level]
    if noise.variance == 0:
        total = float(products[-1, -1])
        return (ScaleTest(average, np.inf if total else 0.0, 0.0 if total else 1.0),)
    products = products / noise.variance
    total = float(products[-1, -1])
    band, (force, force_degrees) = _band(products, draws), _force(products, draws, count)
    own = [1 + force, 1.0, 0.0]
    computed = np.array([computation / noise.variance])

    def test(total: float, more: Reals, beyond_band: bool) -> ScaleTest:
        white = max(count - more.size - force_degrees, 0.0)
        expected = count + float(more.sum()) + force * force_degrees
        weights = np.array([*(1 + more), *own])
        degrees = np.array([*np.ones(more.size), force_degrees, white, noise.degrees])
        weights[-1] = -total / noise.degrees
        probability = tail_probability(weights, degrees)
        return ScaleTest(average, float(np.sqrt(total / expected)), probability, beyond_band)

    result = test(total, np.append(band, computed), beyond_band=False)
    if not band.size:
        return (result,)
    table, target = products[: band.size, : band.size], products[: band.size, -1]
    explained = float(target @ np.linalg.solve(np.eye(band.size) + table, target))
    return result, test(max(total - explained, 0.0), computed, beyond_band=True)


def exact_test(products: Reals, count: float, draws: int, tolerance: float) -> ScaleTest:
    """
    Test the size of the residual of a sensor without noise.

    Parameters
    ----------
    products, count, draws
        As for `scale_tests`, of single samples.
    tolerance : float
        Standard deviation of the error of the computation, the same all the time.

    Returns
    -------
    ScaleTest

    """
    total = float(products[-1, -1])
    band, (force, force_degrees) = _band(products, draws), _force(products, draws, count)
    own = count * tolerance**2
    weights = np.array([*band, force, own, -total / STATED_DEGREES])
    degrees = np.array([*np.ones(band.size), force_degrees, 1.0, STATED_DEGREES])
    expected = own + float(band.sum()) + force * force_degrees
    return ScaleTest(1, float(np.sqrt(total / expected)), tail_probability(weights, degrees))


def _band(products: Reals, draws: int) -> Reals:
    """Variances of the independent parts of what the parameters' uncertainty does."""
    size = len(products) - 1 - draws
    return np.asarray(np.maximum(np.linalg.eigvalsh(products[:size, :size]), 0.0))


def _force(products: Reals, draws: int, count: float) -> tuple[float, float]:
    """
    Describe what the force's noise does as so many equal parts: their variance and number.

    Two numbers of its covariance C fit: tr C, the mean square of a draw, and tr C^2, the mean
    square of the product of two independent draws.
    """
    own = products[-1 - draws : -1, -1 - draws : -1]
    trace = float(np.trace(own)) / max(draws, 1)
    if draws < 2 or trace <= 0 or count == 0:
        return 0.0, 0.0
    pairs = float(np.sum(own**2) - np.sum(np.diag(own) ** 2)) / (draws * (draws - 1))
    square = min(max(pairs, trace**2 / count), trace**2)
    return square / trace, trace**2 / square


def _quotient(left: float, right: float) -> float:
    if right > 0:
        return left / right
    return float('inf') if left > 0 else float('nan')
