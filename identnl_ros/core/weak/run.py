# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""An uninterrupted record on its way through the recursion, and the noise that is stated of it."""

from dataclasses import dataclass, field, replace

from identnl_ros.core.measurement.motion_record import MotionRecord
from identnl_ros.core.measurement.motion_weights import MotionWeights
from identnl_ros.core.weak.response_fit import FORCE_MARGIN, ResponseFit, State
from identnl_ros.core.weak.response_search import CHUNK, WeighedRecord
from identnl_ros.core.weak.weighting_function import bandwidth, weighting_function_for
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# A record shorter than this many test functions tells little more than its initial state.
SHORTEST_RECORD = 2


@dataclass(frozen=True)
class Noise:
    """
    What is stated of the noise of measured motion.

    Parameters
    ----------
    covariances : tuple of 3 ndarray, shape (n, n)
        Of displacement, velocity, acceleration at one sample; NaN: to be estimated.
    force : ndarray, shape (n_excitations, n_excitations)
        Covariance of the force at one sample; NaN: to be estimated.
    derived : tuple of 3 bool
        Differentiated, at least partly, rather than measured.

    """

    covariances: tuple[Reals, Reals, Reals]
    force: Reals
    derived: tuple[bool, bool, bool]

    def weigh(self, record: MotionRecord) -> WeighedRecord:
        """
        Find weights and test function of a record.

        Parameters
        ----------
        record : MotionRecord

        Returns
        -------
        WeighedRecord

        """
        weights = MotionWeights.of(record, self.covariances, self.derived)
        white = record.bridged().displacement @ weights.matrices[0][1].T
        frequency = bandwidth(white, record.sample_rate, 0)
        function = weighting_function_for(frequency, record.sample_rate)
        return WeighedRecord(record, weights, function)


@dataclass
class Run:
    """
    An uninterrupted record on its way through the recursion.

    Parameters
    ----------
    record : MotionRecord
    noise : Noise
    weighed : WeighedRecord or None
        Its weights and test function, once there is enough of it to find them.
    state : tuple of ndarray or None
        Estimated state at the first sample that is used.
    fit : ResponseFit or None
        While the run grows.
    position : int
        Samples used.
    waiting : list of MotionRecord
        What follows the record, less than a chunk.

    """

    record: MotionRecord
    noise: Noise
    weighed: WeighedRecord | None = None
    state: State | None = None
    fit: ResponseFit | None = None
    position: int = 0
    waiting: list[MotionRecord] = field(default_factory=list)

    def join(self) -> None:
        """Make what waits part of the record."""
        if self.waiting:
            self.record = self.record.followed_by(*self.waiting)
            self.waiting = []

    @property
    def whole(self) -> WeighedRecord:
        """The whole record, weighed as its beginning was."""
        if self.weighed is None:
            raise AssertionError('a record that has not been weighed')
        return replace(self.weighed, record=self.record)

    def weigh(self, anew: bool) -> bool:
        """Find the weights; False where the record tells little more than its initial state."""
        if not self.position and len(self.record):
            # Without a valid reading there is nothing to begin with.
            begin = int(np.argmax(self.record.valid))
            self.record = self.record.part(begin, len(self.record))
        if np.count_nonzero(self.record.valid) < 4 * FORCE_MARGIN:
            return False
        if anew or self.weighed is None:
            self.weighed = self.noise.weigh(self.record)
            self.state = None
        length = 2 * self.weighed.function.half_length
        if self.whole.end - self.whole.first < SHORTEST_RECORD * length:
            self.weighed = None
            return False
        if self.state is None:
            self.state = self.whole.initial_state()
        return True

    def skip_rest(self) -> None:
        """Leave out chunks before the machine begins to move: they tell nothing."""
        begin = 0
        length = CHUNK + self.whole.first + FORCE_MARGIN
        while begin + CHUNK + length < len(self.record):
            part = self.record.part(begin, begin + length)
            if replace(self.whole, record=part).moves:
                break
            begin += CHUNK
        if begin:
            self.record, self.state = self.record.part(begin, len(self.record)), None
