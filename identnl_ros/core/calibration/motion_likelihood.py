# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Likelihood of gains, directions and delays of sensors that ride on rigid bodies."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from identnl_ros.core.calibration.cross_spectra import CrossSpectra
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Singular values of the column-scaled sensor matrix below this are rounding.
SEEING = 1e-12
# Bins worked on at once.
CHUNK = 32

GAIN, FIRST_ANGLE, SECOND_ANGLE, DELAY = range(4)
ANGLES = FIRST_ANGLE, SECOND_ANGLE
Parameter = tuple[int, int]
"""Channel of the layout, and which of its numbers."""


@dataclass
class SensorState:
    """
    What is believed of all sensors.

    Parameters
    ----------
    gains : ndarray, shape (n_sensors,)
        Factors on what the layout says.
    directions : ndarray, shape (n_sensors, 3)
    delays : ndarray, shape (n_sensors,)
        Beyond those that are taken out of the spectra [s].
    axes : ndarray, shape (n_sensors, 2, 3)
        Across the directions of the layout, that the two angles lean to.
    points : ndarray, shape (n_sensors, 3, n_coordinates)
        Readings of sensors in the place of each one, along x, y and z.

    """

    gains: Reals
    directions: Reals
    delays: Reals
    axes: Reals
    points: Reals

    def rows(self) -> Reals:
        """Give the readings per unit of every coordinate, shape (n_sensors, n_coordinates)."""
        along = np.einsum('sk,skq->sq', self.directions, self.points)
        return np.asarray(self.gains[:, np.newaxis] * along)

    def slope(self, parameter: Parameter) -> Reals:
        """
        Change of a row with a parameter; for a delay the row itself.

        Parameters
        ----------
        parameter : tuple of int

        Returns
        -------
        ndarray, shape (n_coordinates,)

        """
        channel, which = parameter
        if which == GAIN:
            return np.asarray(self.directions[channel] @ self.points[channel])
        along = self.directions[channel] if which == DELAY else self._across(channel)[which - 1]
        return np.asarray(self.gains[channel] * along @ self.points[channel])

    def moved(self, parameters: Sequence[Parameter], step: Reals) -> None:
        """
        Change parameters.

        Parameters
        ----------
        parameters : sequence of tuple of int
        step : ndarray, shape (n_parameters,)
            Gain factors [-], angles [rad], delays [s].

        """
        turned: dict[int, Reals] = {}
        for (channel, which), change in zip(parameters, step, strict=True):
            if which == GAIN:
                self.gains[channel] += change
            elif which == DELAY:
                self.delays[channel] += change
            else:
                across = self._across(channel)[which - 1]
                turned[channel] = turned.get(channel, self.directions[channel]) + change * across
        for channel, direction in turned.items():
            self.directions[channel] = direction / np.linalg.norm(direction)

    def _across(self, channel: int) -> Reals:
        """Directions of the two angles, across the direction as it is now."""
        along = self.directions[channel]
        across = self.axes[channel] - np.outer(self.axes[channel] @ along, along)
        across[1] -= across[0] * (across[0] @ across[1]) / (across[0] @ across[0])
        return np.asarray(across / np.linalg.norm(across, axis=1)[:, np.newaxis])


@dataclass
class Likelihood:
    """
    First and second derivatives of the likelihood, and how well all sensors agree.

    The motion is eliminated at every frequency; its estimate carries noise, which the raw
    information holds as a surplus (Kay 1993, chapter 7; the delay estimate does alike).

    Parameters
    ----------
    score : ndarray, shape (n_parameters,)
    raw : ndarray, shape (n_parameters, n_parameters)
        Information with the noise of the estimated motion.
    surplus : ndarray
        What that noise adds.
    alone : ndarray, shape (n_parameters,)
        Information if the motion were known.
    spread : ndarray
        Variance of the score.
    cost : float
        Sum of squares of what no rigid motion explains, over the variance.
    expected : float
        Of a right model.
    uncertainty : float
        Standard deviation of cost over expected.
    channel_cost, channel_expected : ndarray, shape (n_sensors,)
        The same by sensor.

    """

    score: Reals
    raw: Reals
    surplus: Reals
    alone: Reals
    spread: Reals
    cost: float
    expected: float
    uncertainty: float
    channel_cost: Reals
    channel_expected: Reals

    def first(self, count: int) -> 'Likelihood':
        """
        Copy for the first parameters alone, the others as they are.

        Parameters
        ----------
        count : int

        Returns
        -------
        Likelihood

        """
        part = slice(count)
        return replace(
            self,
            score=self.score[part],
            raw=self.raw[part, part],
            surplus=self.surplus[part, part],
            alone=self.alone[part],
            spread=self.spread[part, part],
        )


def motion_likelihood(
    spectra: Sequence[CrossSpectra],
    state: SensorState,
    parameters: Sequence[Parameter],
    delay_unit: float,
) -> Likelihood:
    """
    Evaluate the likelihood.

    Parameters
    ----------
    spectra : sequence of CrossSpectra
        Bins with motion.
    state : SensorState
    parameters : sequence of tuple of int
        By which to differentiate.
    delay_unit : float
        In which delays are counted, so that all parameters are of one size [s].

    Returns
    -------
    Likelihood

    """
    size, sensors = len(parameters), len(state.gains)
    square = np.zeros((size, size))
    found = Likelihood(
        np.zeros(size), square, square.copy(), np.zeros(size), square.copy(),
        0.0, 0.0, 0.0, np.zeros(sensors), np.zeros(sensors),
    )  # fmt: skip
    rows = state.rows()
    slopes = np.array([state.slope(one) for one in parameters]).reshape(size, rows.shape[1])
    late = np.array([which == DELAY for _, which in parameters], dtype=bool)
    variance = 0.0
    for one in spectra:
        where = {channel: i for i, channel in enumerate(one.channels.tolist())}
        own = np.array([i for i, (channel, _) in enumerate(parameters) if channel in where], int)
        place = np.array([where[parameters[i][0]] for i in own], int)
        before = found.expected
        for part in _parts(one):
            phase = np.exp(1j * np.outer(part.frequencies, state.delays[one.channels]))
            sums = phase[:, :, np.newaxis] * part.sums * np.conj(phase)[:, np.newaxis, :]
            motion, noise, weights = elimination(rows[one.channels], part.variance)
            moved = motion.astype(np.complex128)
            moments = moved @ sums @ np.swapaxes(moved, 1, 2)
            # Of a spectrum that is late by tau: -i omega times itself.
            turn = np.ones((len(part.frequencies), len(own)), dtype=np.complex128)
            turn[:, late[own]] = (-1j * delay_unit * part.frequencies)[:, np.newaxis]
            left = weights @ sums
            slope = np.einsum('fpq,pq->fp', (left @ np.swapaxes(moved, 1, 2))[:, place],
                              slopes[own])  # fmt: skip
            found.score[own] += np.einsum('fp,fp->p', np.conj(turn), slope).real
            own_weights = weights[:, place][:, :, place]
            raw = _products(moments, slopes[own], turn)
            found.alone[own] += np.einsum('fpp,fp->p', raw, 1 / part.variance[:, place]).real
            raw = (own_weights * raw).real.sum(axis=0)
            found.raw[np.ix_(own, own)] += raw
            found.spread[np.ix_(own, own)] += one.overlap * raw
            counted = part.counts[:, np.newaxis, np.newaxis] * noise
            extra = own_weights * _products(counted.astype(np.complex128), slopes[own], turn)
            found.surplus[np.ix_(own, own)] += extra.real.sum(axis=0)
            found.cost += float(np.einsum('fcc->', left).real)
            freedom = np.einsum('fcc,fc->f', weights, part.variance)
            found.expected += float(part.counts @ freedom)
            found.channel_cost[one.channels] += np.einsum('fcd,fdc->c', left, weights).real
            found.channel_expected[one.channels] += np.einsum('f,fcc->c', part.counts, weights)
        variance += 2 * one.overlap * (found.expected - before)
    found.uncertainty = float(np.sqrt(variance) / max(found.expected, 1e-300))
    return found


def elimination(rows: Reals, variance: Reals) -> tuple[Reals, Reals, Reals]:
    """
    Eliminate the motion at every frequency.

    Parameters
    ----------
    rows : ndarray, shape (n_sensors, n_coordinates)
    variance : ndarray, shape (n_bins, n_sensors)
        Of the spectra.

    Returns
    -------
    motion : ndarray, shape (n_bins, n_coordinates, n_sensors)
        Its estimate per unit of a spectrum.
    noise : ndarray, shape (n_bins, n_coordinates, n_coordinates)
        Covariance of the estimate.
    weights : ndarray, shape (n_bins, n_sensors, n_sensors)
        Of what no motion explains.

    """
    weighted = np.swapaxes(rows / variance[:, :, np.newaxis], 1, 2)
    information = weighted @ rows
    # Metres and radians on one footing; motions that no sensor sees drop out.
    scale = np.sqrt(np.einsum('fii->fi', information))
    scale[scale == 0] = 1.0
    both = scale[:, :, np.newaxis] * scale[:, np.newaxis, :]
    noise = np.linalg.pinv(information / both, SEEING, True) / both
    motion = noise @ weighted
    weights = -np.swapaxes(weighted, 1, 2) @ motion
    own = np.arange(len(rows))
    weights[:, own, own] += 1 / variance
    return motion, noise, weights


def _parts(spectra: CrossSpectra) -> Iterator[CrossSpectra]:
    """Cut into few bins at a time."""
    for begin in range(0, len(spectra.frequencies), CHUNK):
        yield spectra.bins(slice(begin, begin + CHUNK))


def _products(moments: NDArray[np.complex128], slopes: Reals,
              turn: NDArray[np.complex128]) -> NDArray[np.complex128]:  # fmt: skip
    """Products of the changes of two readings, for motion of these second moments."""
    inner = slopes @ moments @ slopes.T
    inner = np.swapaxes(inner, 1, 2)
    return np.asarray(np.conj(turn)[:, :, np.newaxis] * inner * turn[:, np.newaxis, :])
