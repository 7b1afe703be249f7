# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Offset and rate of a source's clock from stamps that arrive with jitter."""

from copy import deepcopy
from dataclasses import dataclass, field

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS
import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

# Of a free-running crystal oscillator, two cheap ones included [-].
CRYSTAL_TOLERANCE = 1e-4
# Residuals beyond so many standard deviations count less (Huber 1981, Robust Statistics): late
# arrivals. Costs 0.4 % of the variance where there are none.
HUBER = 2.5
# E min(z^2, HUBER^2) of a standard normal z.
HUBER_VARIANCE = float(
    1 - 2 * norm.sf(HUBER) - 2 * HUBER * norm.pdf(HUBER) + 2 * HUBER**2 * norm.sf(HUBER)
)
NORMAL_MAD = float(norm.ppf(0.75))
# Stamps that are fitted together before the recursion begins.
FIRST_STAMPS = 32
# Cumulative sums of clipped recursive residuals (Page 1954): one false step in 1e7 stamps.
CUSUM_SLACK = 0.5
CUSUM_LIMIT = 16.0
CUSUM_CLIP = 3.0
LONGEST_SUSPICION = 512
# Variance of an offset of which nothing is known, over that of a stamp.
UNKNOWN_OFFSET = 1e12


@dataclass(frozen=True)
class Clock:
    """
    Straight line from the running index of samples to the host's time.

    ``time = offset + index / sample_rate * (1 + skew)``, both errors jointly normal.

    Parameters
    ----------
    sample_rate : float
        Nominal [Hz].
    origin_ns : int
        Host time that `offset` counts from [ns].
    offset : float
        Of sample 0, with the mean latency of the stamps [s].
    skew : float
        Relative error of the sample interval; positive: the source is slow [-].
    covariance : ndarray, shape (2, 2)
        Of offset and skew.
    jitter : float
        Standard deviation of a stamp, late ones clipped [s].

    """

    sample_rate: float
    origin_ns: int
    offset: float
    skew: float
    covariance: NDArray[np.float64]
    jitter: float

    def time(self, index: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Host time of samples.

        Parameters
        ----------
        index : ndarray
            Running index; may be a fraction.

        Returns
        -------
        ndarray
            Since the origin [s].

        """
        return np.asarray(self.offset + index / self.sample_rate * (1 + self.skew))

    def standard_deviation(self, index: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Tell the standard deviation of host times, the unknown mean latency left out.

        Parameters
        ----------
        index : ndarray

        Returns
        -------
        ndarray
            [s].

        """
        row = np.stack((np.ones(np.shape(index)), index / self.sample_rate))
        return np.asarray(np.sqrt(np.einsum('i...,ij,j...->...', row, self.covariance, row)))


@dataclass(frozen=True)
class ClockStep:
    """
    A jump of the stamps against the running index: samples were lost, or the clock was set.

    Parameters
    ----------
    index : int
        First stamped sample after it.
    duration : float
        Positive: time without samples [s].
    standard_deviation : float
        [s].
    lost_samples : int
        As many nominal intervals.

    """

    index: int
    duration: float
    standard_deviation: float
    lost_samples: int


@dataclass
class _Line:
    """Recursive least squares: offset and skew at the first stamp, covariance over jitter^2."""

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    squares: float
    count: int
    wander: float = 0.0
    last: float = 0.0

    @property
    def jitter(self) -> float:
        return float(np.sqrt(self.squares / (self.count * HUBER_VARIANCE)))

    def residual(self, time: float, stamp: float) -> tuple[float, float]:
        """Stamp minus prediction, and its standard deviation over the jitter."""
        row = np.array([1.0, time])
        return (
            stamp - time - float(row @ self.values),
            float(np.sqrt(1 + row @ self.covariance @ row)),
        )

    def add(self, time: float, stamp: float) -> float:
        """Take a stamp; return its residual in standard deviations."""
        if self.wander:
            # The skew has gone astray since the last stamp, the time then is still known.
            turn = np.array([-self.last, 1.0])
            spread = self.wander**2 * (time - self.last) / self.jitter**2
            self.covariance = self.covariance + spread * np.outer(turn, turn)
            self.last = time
        row = np.array([1.0, time])
        residual, spread = self.residual(time, stamp)
        score = residual / (spread * self.jitter)
        weight = min(1.0, HUBER / abs(score)) if score else 1.0
        gain = self.covariance @ row / (1 / weight + spread**2 - 1)
        self.values = self.values + gain * residual
        self.covariance = self.covariance - np.outer(gain, row @ self.covariance)
        self.squares += min((residual / spread) ** 2, (HUBER * self.jitter) ** 2)
        self.count += 1
        return score


@dataclass
class _Suspicion:
    """A cumulative sum of residuals of one sign, and all that came since it was zero."""

    sign: float
    total: float = 0.0
    before: _Line | None = None
    stamps: list[tuple[int, float, float]] = field(default_factory=list)


class ClockFit:
    """
    Follow a clock stamp by stamp, in memory that does not grow.

    Recursive least squares with Huber's weights on the recursive residuals, so that late
    arrivals count little; cumulative sums of these residuals (Brown, Durbin and Evans 1975)
    show steps, after which the offset is found anew and the skew kept.

    Parameters
    ----------
    sample_rate : float
        Nominal [Hz].
    tolerance : float
        Standard deviation of the skew before any stamp; infinite: not known [-].
    wander : float
        Standard deviation by which the skew changes in a second, as a random walk: old stamps
        are forgotten [1/sqrt(s)].

    """

    def __init__(
        self, sample_rate: float, tolerance: float = CRYSTAL_TOLERANCE, wander: float = 0.0
    ) -> None:
        if not (np.isfinite(sample_rate) and sample_rate > 0 and tolerance > 0):
            raise DataError(
                f'clock: sample rate {sample_rate} Hz and tolerance {tolerance} must be positive'
            )
        self._rate = sample_rate
        self._tolerance = tolerance
        self._wander = wander
        self._first: list[tuple[int, int]] = []
        self._line: _Line | None = None
        self._suspicions = (_Suspicion(1.0), _Suspicion(-1.0))
        self._last_index = -1
        self.steps: tuple[ClockStep, ...] = ()
        """Steps found so far; the clock is that after the last one."""

    def add(self, index: int, stamp_ns: int) -> None:
        """
        Take the stamp of a sample.

        Parameters
        ----------
        index : int
            Running index of the sample, larger than the one before.
        stamp_ns : int
            Its host time, or its arrival's [ns].

        Raises
        ------
        DataError
            If the index does not grow.

        """
        if index <= self._last_index:
            raise DataError(
                f'clock: stamp of sample {index} after that of sample {self._last_index}; '
                'stamps must come in the order of the samples'
            )
        self._last_index = index
        if self._line is None:
            self._first.append((index, stamp_ns))
            if len(self._first) == FIRST_STAMPS:
                self._line = self._fitted()
                self._line.wander = self._wander
                self._line.last = (index - self._first[0][0]) / self._rate
            return
        time = (index - self._first[0][0]) / self._rate
        stamp = (stamp_ns - self._first[0][1]) / NANOSECONDS
        self._follow(index, time, stamp)

    @property
    def ready(self) -> bool:
        """Whether there are stamps enough for a clock."""
        return len(self._first) >= 3

    @property
    def clock(self) -> Clock:
        """
        What is known of the clock now.

        Raises
        ------
        DataError
            If there were fewer than three stamps.

        """
        line = self._line or self._fitted()
        start = self._first[0][0] / self._rate
        # From time since the first stamp to time since sample 0.
        shift = np.array([[1.0, -start], [0.0, 1.0]])
        offset, skew = shift @ line.values
        return Clock(
            self._rate,
            self._first[0][1],
            float(offset - start),
            float(skew),
            shift @ (line.covariance * line.jitter**2) @ shift.T,
            line.jitter,
        )

    def _fitted(self) -> _Line:
        index, stamps = np.array(self._first, dtype=np.int64).reshape(-1, 2).T
        if len(index) < 3:
            raise DataError(f'clock: {len(index)} stamps are too few, expected at least 3')
        return _robust_line(
            (index - index[0]) / self._rate, (stamps - stamps[0]) / NANOSECONDS, self._tolerance
        )

    def _follow(self, index: int, time: float, stamp: float) -> None:
        assert self._line is not None
        before = deepcopy(self._line)
        score = self._line.add(time, stamp)
        clipped = float(np.clip(score, -CUSUM_CLIP, CUSUM_CLIP))
        for one in self._suspicions:
            if one.total == 0.0 or len(one.stamps) >= LONGEST_SUSPICION:
                one.total, one.before, one.stamps = 0.0, before, []
            one.total = max(0.0, one.total + one.sign * clipped - CUSUM_SLACK)
            one.stamps.append((index, time, stamp))
            if one.total > CUSUM_LIMIT:
                self._step(one)
                return

    def _step(self, found: _Suspicion) -> None:
        assert found.before is not None
        line = found.before
        jitter, known = line.jitter, deepcopy(line)
        line.covariance = line.covariance + np.diag([UNKNOWN_OFFSET, 0.0])
        for _, time, stamp in found.stamps:
            line.add(time, stamp)
        index, time, _ = found.stamps[0]
        row = np.array([1.0, time])
        duration = float(row @ (line.values - known.values))
        variance = float(row @ (line.covariance + known.covariance) @ row) * jitter**2
        lost = max(0, round(duration * self._rate))
        self.steps = (*self.steps, ClockStep(index, duration, float(np.sqrt(variance)), lost))
        self._line = line
        self._suspicions = (_Suspicion(1.0), _Suspicion(-1.0))


def fit_clock(
    sample_rate: float,
    index: NDArray[np.int64],
    stamps_ns: NDArray[np.int64],
    tolerance: float = CRYSTAL_TOLERANCE,
) -> Clock:
    """
    Fit the clock of a whole record without steps.

    Parameters
    ----------
    sample_rate : float
        Nominal [Hz].
    index : ndarray of int, shape (n_stamps,)
        Running index of the stamped samples, rising.
    stamps_ns : ndarray of int, shape (n_stamps,)
        [ns].
    tolerance : float
        Standard deviation of the skew before any stamp; infinite: not known [-].

    Returns
    -------
    Clock

    Raises
    ------
    DataError
        If there are too few stamps, they do not rise, or they have a step.

    """
    recursion = ClockFit(sample_rate, tolerance)
    for one, stamp in zip(index.tolist(), stamps_ns.tolist(), strict=True):
        recursion.add(one, stamp)
    if recursion.steps:
        step = recursion.steps[0]
        raise DataError(
            f'clock: the stamps jump by {step.duration * 1e3:.3f} ms '
            f'(standard deviation {step.standard_deviation * 1e3:.3f} ms) at sample {step.index}, '
            f'about {step.lost_samples} samples lost; cut the record there'
        )
    if len(index) < 3:
        raise DataError(f'clock: {len(index)} stamps are too few, expected at least 3')
    # About the middle, where offset and skew hardly depend on each other.
    middle = float(index.mean()) / sample_rate
    origin = int(stamps_ns[0])
    line = _robust_line(
        index / sample_rate - middle, (stamps_ns - origin) / NANOSECONDS - middle, tolerance
    )
    shift = np.array([[1.0, -middle], [0.0, 1.0]])
    offset, skew = shift @ line.values
    covariance = shift @ (line.covariance * line.jitter**2) @ shift.T
    return Clock(sample_rate, origin, float(offset), float(skew), covariance, line.jitter)


def _robust_line(
    time: NDArray[np.float64], stamps: NDArray[np.float64], tolerance: float
) -> _Line:
    """Huber's estimate of a line, by weighted least squares again and again."""
    rows = np.stack((np.ones(len(time)), time), axis=1)
    target = stamps - time
    weights = np.ones(len(time))
    squares = jitter = 0.0
    # One rounding of a stamp, where there is no jitter.
    smallest = 0.3 / NANOSECONDS
    for _ in range(30):
        information = (rows.T * weights) @ rows
        if jitter:
            information[1, 1] += (jitter / tolerance) ** 2
        covariance = np.linalg.inv(information)
        values = covariance @ (rows.T @ (weights * target))
        residuals = target - rows @ values
        if not jitter:
            jitter = float(np.median(np.abs(residuals))) / NORMAL_MAD
        clipped = np.clip(residuals, -HUBER * jitter, HUBER * jitter)
        squares = float(clipped @ clipped) * len(time) / (len(time) - 2)
        jitter = max(float(np.sqrt(squares / (len(time) * HUBER_VARIANCE))), smallest)
        weights = HUBER * jitter / np.maximum(np.abs(residuals), HUBER * jitter)
    # A residual beyond the limit counts nothing for the slope of Huber's function.
    inside = np.abs(residuals) < HUBER * jitter
    information = rows[inside].T @ rows[inside]
    information[1, 1] += (jitter / tolerance) ** 2
    return _Line(
        values,
        np.asarray(np.linalg.inv(information), dtype=np.float64),
        max(squares, len(time) * HUBER_VARIANCE * smallest**2),
        len(time),
    )
