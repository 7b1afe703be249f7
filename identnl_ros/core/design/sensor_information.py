# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What each sensor of a run tells by itself, so that any choice of sensors can be judged."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.design.planned_run import PlannedRun
from identnl_ros.core.likelihood.nuisance import RecordInformation
import numpy as np
from numpy.typing import NDArray

# Samples triangularised together.
SAMPLES_AT_ONCE = 1024


@dataclass(frozen=True)
class SensorInformation:
    """
    A triangular factor for every sensor of motion.

    The initial state is common to all sensors: it can be eliminated only after the sensors of a
    choice have been put together.

    Parameters
    ----------
    channels : tuple of int
        Of the layout.
    factors : ndarray, shape (n_channels, n, n)
        Upper triangular; columns: initial state, then the unknowns, in units of the noise.
    n_own : int
        Number of unknowns of the initial state.
    samples : int
        Of each sensor.

    """

    channels: tuple[int, ...]
    factors: NDArray[np.float64]
    n_own: int
    samples: int

    def together(self, choice: Sequence[int] | None = None) -> Information:
        """
        Give the information of several sensors, the initial state eliminated.

        Parameters
        ----------
        choice : sequence of int, optional
            Positions in `channels`; by default all.

        Returns
        -------
        Information
            On the unknowns of the machine.

        """
        chosen = range(len(self.channels)) if choice is None else choice
        chosen = range(len(self.channels)) if choice is None else choice
        empty = np.zeros(self.factors.shape[1:])
        return self._marginal(_merged(empty, *self.factors[list(chosen)]), len(chosen))

    def without_each(self, choice: Sequence[int]) -> Iterator[Information]:
        """
        Give the information of several sensors without each of them in turn.

        Parameters
        ----------
        choice : sequence of int
            Positions in `channels`.

        Yields
        ------
        Information
            Without the first, without the second and so on.

        """
        empty = np.zeros(self.factors.shape[1:])
        behind = [empty]
        for i in reversed(choice[1:]):
            behind.append(_merged(self.factors[i], behind[-1]))
        before = empty
        for i in choice:
            yield self._marginal(_merged(before, behind.pop()), len(choice) - 1)
            before = _merged(before, self.factors[i])

    def _marginal(self, factor: NDArray[np.float64], sensors: int) -> Information:
        information = Information(np.pad(factor, ((0, 1), (0, 1))), sensors * self.samples)
        return RecordInformation(information, self.n_own).marginal()


def sensor_information(run: PlannedRun) -> SensorInformation:
    """
    Simulate a planned run once and sort what it tells by sensor.

    Parameters
    ----------
    run : PlannedRun

    Returns
    -------
    SensorInformation

    Raises
    ------
    MachineError
        If the motion grows without bound.

    """
    factors = np.zeros((len(run.channels), run.size, run.size))
    waiting: list[NDArray[np.float64]] = []
    samples = waiting_samples = 0
    for derivatives in run.weighted_derivatives():
        waiting.append(derivatives)
        waiting_samples += len(derivatives)
        if waiting_samples >= SAMPLES_AT_ONCE:
            factors = _absorbed(factors, waiting)
            samples += waiting_samples
            waiting, waiting_samples = [], 0
    if waiting:
        factors = _absorbed(factors, waiting)
    return SensorInformation(run.channels, factors, run.n_own, samples + waiting_samples)


def _absorbed(
    factors: NDArray[np.float64], parts: list[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Triangularise the rows of every sensor with its factor."""
    rows = np.concatenate(parts)
    return np.stack([_merged(factor, rows[:, i]) for i, factor in enumerate(factors)])


def _merged(*tables: NDArray[np.float64]) -> NDArray[np.float64]:
    """Triangularise stacked rows; the first table is square already."""
    return np.asarray(np.linalg.qr(np.vstack(tables), mode='r'))
