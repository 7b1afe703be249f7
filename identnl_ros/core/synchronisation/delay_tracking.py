# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Residual delays of sources as they drift: a Kalman filter over stamps and motion."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# Standard deviation by which the skew of a crystal changes in a second [1/sqrt(s)]. Within the
# seconds between two looks at the motion that is more than 1e-6 in a minute, as on warming up.
CLOCK_WANDER = 4e-8
# The same of the mean latency of stamps: 10 us in a minute [s/sqrt(s)].
LATENCY_WANDER = 1e-5 / np.sqrt(60.0)
DELAY, SKEW, LATENCY = range(3)
STATES = 3


class DelayTracker:
    """
    Delay, its growth and the latency of the stamps of every source, against one of them.

    The skews walk at random; delay and latency both shift the stamps, the motion shows the
    delay alone. So stamps go on with what motion has shown while there is none.

    Parameters
    ----------
    sources : int
    reference : int
        The source whose delay is 0.

    """

    def __init__(self, sources: int, reference: int) -> None:
        self.reference = reference
        self.mean = np.zeros(STATES * sources)
        """Delay [s], skew [-] and latency [s] of each source, one after the other."""
        self.covariance = np.zeros((STATES * sources, STATES * sources))

    def place(self, source: int, state: int) -> int:
        """
        Find a state in the mean.

        Parameters
        ----------
        source : int
        state : int
            `DELAY`, `SKEW` or `LATENCY`.

        Returns
        -------
        int

        """
        return STATES * source + state

    def deviation(self, source: int, ahead: float = 0.0) -> float:
        """
        Tell the standard deviation of a delay.

        Parameters
        ----------
        source : int
        ahead : float
            After so long without any news [s].

        Returns
        -------
        float
            [s].

        """
        if source == self.reference:
            return 0.0
        row = np.zeros(len(self.mean))
        row[self.place(source, DELAY)] = 1.0
        row[self.place(source, SKEW)] = ahead
        known = max(0.0, float(row @ self.covariance @ row))
        return float(np.sqrt(known + 2 * CLOCK_WANDER**2 * ahead**3 / 3))

    def begin(self, source: int, clock: NDArray[np.float64], latency: float) -> None:
        """
        Forget a source; its readings have been placed by its stamps.

        Parameters
        ----------
        source : int
        clock : ndarray, shape (2, 2)
            Covariance of delay and skew, latency left out [s, -].
        latency : float
            Standard deviation of the latency of its stamps against those of the reference [s].

        """
        own = slice(STATES * source, STATES * (source + 1))
        self.mean[own] = 0.0
        self.covariance[own, :] = self.covariance[:, own] = 0.0
        block = np.zeros((STATES, STATES))
        block[:2, :2] = clock
        # A latency that is not known has moved the readings as much.
        shift = np.array([1.0, 0.0, 1.0])
        self.covariance[own, own] = block + latency**2 * np.outer(shift, shift)

    def refer_to(self, source: int) -> None:
        """
        Take another source as the reference.

        Parameters
        ----------
        source : int

        """
        size = len(self.mean)
        change = np.eye(size)
        for state in range(STATES):
            change[state::STATES, self.place(source, state)] -= 1.0
        self.mean = change @ self.mean
        self.covariance = change @ self.covariance @ change.T
        self.reference = source

    def predict(self, duration: float) -> None:
        """
        Let time pass.

        Parameters
        ----------
        duration : float
            [s].

        """
        size = len(self.mean)
        change = np.eye(size)
        change[DELAY::STATES, SKEW::STATES] += duration * np.eye(size // STATES)
        wander = np.zeros((STATES, STATES))
        wander[:2, :2] = CLOCK_WANDER**2 * np.array(
            [[duration**3 / 3, duration**2 / 2], [duration**2 / 2, duration]]
        )
        wander[LATENCY, LATENCY] = LATENCY_WANDER**2 * duration
        # The reference wanders too, and all others against it.
        others = np.ones(size // STATES)
        others[self.reference] = 0.0
        noise = np.kron(np.diag(others) + np.outer(others, others), wander)
        self.mean = change @ self.mean
        self.covariance = change @ self.covariance @ change.T + noise

    def add_stamps(self, source: int, mean: float, variance: float, age: float) -> None:
        """
        Weigh in by how much the stamps of a source are late against those of the reference.

        Parameters
        ----------
        source : int
        mean : float
            Stamp minus what the placing of the readings makes of it [s].
        variance : float
            [s^2].
        age : float
            Since then, on average [s].

        """
        row = np.zeros(len(self.mean))
        row[self.place(source, DELAY)] = -1.0
        row[self.place(source, SKEW)] = age
        row[self.place(source, LATENCY)] = 1.0
        gain = self.covariance @ row / (row @ self.covariance @ row + variance)
        self.mean = self.mean + gain * (mean - row @ self.mean)
        rest = np.eye(len(row)) - np.outer(gain, row)
        self.covariance = rest @ self.covariance @ rest.T + variance * np.outer(gain, gain)

    def known(
        self, sources: Sequence[int], age: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Tell delays and skews as they were.

        Parameters
        ----------
        sources : sequence of int
        age : float
            How long ago [s].

        Returns
        -------
        mean : ndarray, shape (2 * n_sources,)
            Delay [s] and skew [-] of each.
        covariance : ndarray

        """
        rows = self._rows(sources, age)
        return rows @ self.mean, rows @ self.covariance @ rows.T

    def add_motion(
        self,
        sources: Sequence[int],
        mean: NDArray[np.float64],
        covariance: NDArray[np.float64],
        age: float,
    ) -> None:
        """
        Take what the motion has made of what was `known`.

        Parameters
        ----------
        sources : sequence of int
        mean : ndarray, shape (2 * n_sources,)
        covariance : ndarray
        age : float
            As it was asked for [s].

        """
        rows = self._rows(sources, age)
        before, spread = rows @ self.mean, rows @ self.covariance @ rows.T
        gain = self.covariance @ rows.T @ np.linalg.inv(spread)
        self.mean = self.mean + gain @ (mean - before)
        found = self.covariance + gain @ (covariance - spread) @ gain.T
        self.covariance = (found + found.T) / 2

    def corrected(self, source: int, delay: float = 0.0, skew: float = 0.0) -> None:
        """
        Note that readings are placed anew.

        Parameters
        ----------
        source : int
        delay, skew : float
            By which they have been read later [s, -].

        """
        self.mean[self.place(source, DELAY)] -= delay
        self.mean[self.place(source, SKEW)] -= skew

    def _rows(self, sources: Sequence[int], age: float) -> NDArray[np.float64]:
        rows = np.zeros((2 * len(sources), len(self.mean)))
        for i, source in enumerate(sources):
            rows[2 * i, self.place(source, DELAY)] = 1.0
            rows[2 * i, self.place(source, SKEW)] = -age
            rows[2 * i + 1, self.place(source, SKEW)] = 1.0
        return rows
