# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A planned run as people speak of it, with the forces that it means."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from identnl_ros.core.simulation.excitation import Signal
import numpy as np


@dataclass(frozen=True)
class Plan:
    """
    What the exciters are to do, for how long, and how fast the sensors are read.

    Parameters
    ----------
    excitation : str
        E.g. ``multisine``.
    signals : tuple of Signal
        Force of every excitation point.
    amplitudes : mapping of str to float
        By exciter [N]; a multisine has the root mean square of a sine of this amplitude.
    band : tuple of float
        Lowest and highest frequency, the same for a sine [Hz].
    cycle : float
        Time after which the force repeats [s].
    sample_rate : float
        [Hz].
    duration : float
        Of the samples used [s].
    settling : float
        From rest to the first sample used [s].
    advisable : bool
        False: stronger than the exciters are said to be; for comparison only.

    """

    excitation: str
    signals: tuple[Signal, ...]
    amplitudes: Mapping[str, float]
    band: tuple[float, float]
    cycle: float
    sample_rate: float
    duration: float
    settling: float = 0.0
    advisable: bool = True

    def lasting(self, duration: float) -> 'Plan':
        """
        Copy of another duration.

        Parameters
        ----------
        duration : float
            [s].

        Returns
        -------
        Plan

        """
        return replace(self, duration=duration)

    def whole_cycles(self, duration: float) -> float:
        """
        Round up to whole cycles of the force.

        Parameters
        ----------
        duration : float
            [s].

        Returns
        -------
        float
            At least one cycle, also in samples [s].

        """
        cycles = max(1.0, np.ceil(duration / self.cycle * (1 - 1e-9)))
        return float(max(cycles * self.cycle, 2 / self.sample_rate))

    def peak_forces(self) -> dict[str, float]:
        """
        Find the largest force of every exciter, which its amplifier must bear.

        Returns
        -------
        dict of str to float
            By exciter [N].

        """
        count = int(np.ceil(self.cycle * self.sample_rate)) + 1
        return {
            name: float(np.abs(signal.on_grid(0.0, 1 / self.sample_rate, count)).max())
            for name, signal in zip(self.amplitudes, self.signals, strict=True)
        }
