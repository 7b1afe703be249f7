# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How much motion there is without a gap: why nothing may be known after many samples."""

from dataclasses import dataclass

from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus
from identnl_ros.core.measurement.blocks import MotionBlock
import numpy as np


@dataclass
class UsablePieces:
    """
    Count of instants whose force and motion are known.

    Parameters
    ----------
    instants, usable : int
        All; those with force, displacement, velocity and acceleration.
    longest : int
        Of the usable ones, most in a row.
    longest_duration : float
        The same [s].
    sample_rate : float
        Of the latest block [Hz].

    """

    instants: int = 0
    usable: int = 0
    longest: int = 0
    longest_duration: float = 0.0
    sample_rate: float = 0.0
    _next_index: int = -1
    _stream_id: int = -1
    _open: int = 0

    def add(self, block: MotionBlock) -> None:
        """
        Take the next motion.

        Parameters
        ----------
        block : MotionBlock

        """
        motion = block.displacement, block.velocity, block.acceleration, block.force
        known = np.asarray(np.isfinite(np.concatenate(motion, axis=1)).all(axis=1))
        if (block.stream_id, block.first_index) != (self._stream_id, self._next_index):
            self._open = 0
        self._stream_id, self._next_index = block.stream_id, block.next_index
        self.sample_rate = block.sample_rate
        self.instants += len(known)
        self.usable += int(known.sum())
        breaks = np.flatnonzero(~known)
        if not len(breaks):
            self._open += len(known)
            lengths = np.array([self._open])
        else:
            lengths = np.diff(breaks, prepend=-1 - self._open, append=len(known)) - 1
            self._open = int(lengths[-1])
        if lengths.max() > self.longest:
            self.longest = int(lengths.max())
            self.longest_duration = self.longest / block.sample_rate

    def remarks(self, estimate: Estimate) -> tuple[str, ...]:
        """
        Say why nothing is known.

        Parameters
        ----------
        estimate : Estimate

        Returns
        -------
        tuple of str
            None where something is.

        """
        if any(one.status is not EstimateStatus.UNKNOWN for one in estimate.parameters):
            return ()
        reasons = '; '.join(dict.fromkeys(one.note for one in estimate.parameters if one.note))
        return (
            f'Nothing is known: {reasons}. Of {self.instants} instants, {self.usable} have force '
            f'and motion; the longest piece without a gap has {self.longest} of them '
            f'({self.longest_duration:.3g} s at {self.sample_rate:g} Hz). It should hold several '
            'periods of the slowest motion, and a period at least ten samples: see why samples '
            'are missing, whether the sample rate is right, or record longer.',
        )
