# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Fit a simulation to a few samples and to what was known before them, of a machine that changes.

A single linearised step per part of a stream needs values that are good already. Those of a
machine that has changed since are not, nor is the state that a simulation with them has come to:
so both are sought again, as often as it takes, before the simulation goes on.
"""

from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.motion_record import MotionRecord
from identnl_ros.core.weak.response_fit import Deviation, joined, ResponseFit
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Reals = NDArray[np.float64]

# Simulations of a part of the stream at most, with what was known counting as much as it does.
PASSES = 12
# A step that gains less than this for every number it moves is as small as noise makes it: the
# linearised equations have told all about it.
USUAL_GAIN = 4.0
# A search that has begun ends at steps this small, in the same measure.
SMALL_GAIN = 0.01
# Chance that samples of a machine that has not changed seem to contradict what was known.
FALSE_ALARM_RATE = 1e-6
# How often what was known may be made to count less, for the sake of the same samples.
CONCESSIONS = 5


@dataclass(frozen=True)
class ChunkFit:
    """
    What suits samples and earlier knowledge best.

    Parameters
    ----------
    fit : ResponseFit
        Behind the samples, linearised about the values found.
    residuals : ndarray, shape (n_samples, n_channels)
        At these values.
    energy : float
        Of the simulated motion, see `Deviation`.
    share : float
        How much what was known still counts: 1 where the samples do not contradict it.
    contradiction : Contradiction
        That is left.

    """

    fit: ResponseFit
    residuals: Reals
    energy: float
    share: float
    contradiction: 'Contradiction'


def fitted_to_chunk(known: ResponseFit, record: MotionRecord, first: int, end: int) -> ChunkFit:
    """
    Find the unknowns and the initial state that suit samples and earlier knowledge best.

    Where the two contradict each other, the machine has changed, and what was known counts less:
    just so much that they agree.

    Parameters
    ----------
    known : ResponseFit
        Before the samples: what is known of the unknowns and the state at the first of them.
    record : MotionRecord
    first, end : int
        The samples to take.

    Returns
    -------
    ChunkFit

    Raises
    ------
    MachineError
        If the simulation grows beyond all bounds at the values known before.

    """
    chunk = _Chunk(known, record, first, end)
    share = 1.0
    best = chunk.fitted(share)
    for _ in range(CONCESSIONS):
        excess = best.contradiction.excess(FALSE_ALARM_RATE)
        if excess <= 1:
            break
        share /= excess
        best = chunk.fitted(share)
    contradiction = best.contradiction
    best.fit.tested = best.joint
    residuals = best.deviation.after(best.step)
    best.fit.move(best.step)
    return ChunkFit(best.fit, residuals, best.deviation.energy, share, contradiction)


@dataclass(frozen=True)
class _Chunk:
    """Samples, and what was known before them."""

    known: ResponseFit
    record: MotionRecord
    first: int
    end: int

    def fitted(self, share: float) -> '_Point':
        """Find the values that suit both best, the latter counting a share."""
        size = len(self.known.model.estimated) + self.known.states
        best = self._at(np.zeros(size), share)
        enough = USUAL_GAIN
        length = 1.0
        for _ in range(PASSES):
            if best.gain <= enough * len(best.step):
                break
            enough = SMALL_GAIN
            try:
                other = self._at(best.difference + length * best.step, share)
            except MachineError:
                length /= 4
                continue
            if other.cost < best.cost:
                best, length = other, 1.0
            else:
                length /= 2
        return best

    def _at(self, difference: Reals, share: float) -> '_Point':
        """Simulate the samples at other values than those known."""
        difference = self.known.feasible(difference)
        fit = self.known.begun_at(difference)
        deviation = fit.advance(self.record, self.first, self.end)
        known = self.known.tested.shifted(self.known.padded(difference)).discounted(share)
        return _Point(difference, fit, deviation, known)


class _Point:
    """Values and initial state, by their difference from those known, and what they leave."""

    def __init__(
        self, difference: Reals, fit: ResponseFit, deviation: Deviation, known: Information
    ) -> None:
        self.difference, self.fit, self.deviation = difference, fit, deviation
        self._known = known
        self.joint = joined(fit.tested, known)
        solution = self._fitted(self.joint).solve()
        self.step = solution.values
        self.cost = float((self.joint.factor[:, -1] ** 2).sum())
        self.gain = self.cost - solution.residual_squares

    @property
    def contradiction(self) -> 'Contradiction':
        """Of the samples and what was known."""
        return Contradiction.between(self._fitted(self.fit.tested), self._fitted(self._known))

    def _fitted(self, information: Information) -> Information:
        """Alternatives are as stated."""
        unknowns = len(self.fit.model.estimated)
        return information.without(range(unknowns, unknowns + len(self.fit.alternatives)))


@dataclass(frozen=True)
class Contradiction:
    """
    Difference between samples and earlier knowledge, chi squared where the two agree.

    Parameters
    ----------
    squares : float
        Over what the errors of both explain.
    freedom : float
        Degrees of freedom.

    """

    squares: float = 0.0
    freedom: float = 0.0

    @classmethod
    def between(cls, alone: Information, known: Information) -> 'Contradiction':
        """
        Compare what both together leave over with what each leaves by itself.

        Noise that is greater than stated, and what the model lacks, counts as noise.

        Parameters
        ----------
        alone : Information
            Of the samples, on the unknowns and the initial state.
        known : Information
            Earlier knowledge on all or the first of these, linearised about the same values.

        Returns
        -------
        Contradiction

        """
        size = alone.size
        if alone.rows <= 2 * size:
            return cls()
        left = [float(one.factor[-1, -1] ** 2) for one in (joined(alone, known), alone, known)]
        variance = max(1.0, left[1] / (alone.rows - size))
        return cls((left[0] - left[1] - left[2]) / variance, size)

    def excess(self, false_alarm_rate: float) -> float:
        """
        Compare with what chance explains.

        Parameters
        ----------
        false_alarm_rate : float

        Returns
        -------
        float
            Above 1: samples and knowledge do not agree.

        """
        if self.freedom < 1:
            return 0.0
        return self.squares / float(chi2.isf(false_alarm_rate, self.freedom))

    def followed_by(self, other: 'Contradiction', share: float) -> 'Contradiction':
        """
        Add that of the next samples; this one counts a share.

        Parameters
        ----------
        other : Contradiction
        share : float

        Returns
        -------
        Contradiction

        """
        return Contradiction(
            share * self.squares + other.squares, share * self.freedom + other.freedom
        )
