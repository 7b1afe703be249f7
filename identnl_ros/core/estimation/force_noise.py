# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What noise in the measured force does to a fit that takes the force as exact.

The simulation is driven by the noise too, and follows a force that did not act. Random draws of
that noise, carried along as further columns of the linearised motion, show how far it moves the
estimates and how much slow power it leaves in the residual.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.estimation.alternatives import (
    add_readings,
    Alternative,
    Course,
    disturbances,
    slope,
)
from identnl_ros.core.estimation.score_tests import residual_directions
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import RecordedForce
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.simulation.tangent_response import TangentResponse
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

DRAWS = 24
# Draws of which it is followed what they do to the columns of what is tested.
ECHOES = 2
CHUNK = 512


@dataclass(frozen=True)
class ForceNoise:
    """
    Effect of force noise.

    Parameters
    ----------
    variance_share : ndarray, shape (n_unknowns,)
        Variance that it adds to every estimate, over that which the sensors of motion give it.
    slow_share : float
        Power that it adds to averages of the residual, over that of the sensors' noise.
    growth : float
        That power over what it is in most stretches; much where the motion is unstable for a
        while, and noise grows beyond what a linearised motion tells.
    test_share : ndarray, shape (n_tested,), or None
        Variance that it adds to the residual in directions that are tested, over that of the
        sensors' noise; None: there are none.
    test_bias : ndarray, shape (n_tested,), or None
        Bound of what the residual shows per row of each column of what is tested, as both are
        simulated under the same noisy force; over the variance of the sensors' noise.

    """

    variance_share: Reals
    slow_share: float
    growth: float = 1.0
    test_share: Reals | None = None
    test_bias: Reals | None = None

    @classmethod
    def none(cls, unknowns: int) -> 'ForceNoise':
        """
        Describe an exact force.

        Parameters
        ----------
        unknowns : int

        Returns
        -------
        ForceNoise

        """
        return cls(np.zeros(unknowns), 0.0)


def force_noise_effect(
    model: Model,
    whitening: Sequence[tuple[int, Reals]],
    force: Reals,
    force_covariance: Reals,
    sample_rate: float,
    state: tuple[Reals, Reals, Reals],
    average: int,
    start: float = 0.0,
    alternatives: Sequence[Alternative] = (),
) -> ForceNoise:
    """
    Find the effect of force noise on a fit to one record.

    Parameters
    ----------
    model : Model
        At the fitted values.
    whitening : sequence of (int, ndarray)
        What is measured: 0 displacement, 1 velocity, 2 acceleration; the matrix gives residuals
        of unit noise from the coordinates, shape (n_channels, n_coordinates).
    force : ndarray, shape (n_samples, n_excitations)
        Measured force from the first sample that is used on [N].
    force_covariance : ndarray, shape (n_excitations, n_excitations)
        Of its noise at one sample [N^2].
    sample_rate : float
        [Hz].
    state : tuple of ndarray
        Displacement, velocity and hysteretic states at the first sample; where none of the latter
        are given, they are known to be zero.
    average : int
        Samples over which residuals are averaged.
    start : float
        Time of the first sample that is used since the begin of the stream [s].
    alternatives : sequence of Alternative
        That are tested.

    Returns
    -------
    ForceNoise

    Raises
    ------
    MachineError
        If the machine cannot be simulated.

    """
    unknowns = len(model.estimated)
    if not np.any(force_covariance) or len(force) < 2 * CHUNK:
        return ForceNoise.none(unknowns)
    generator = np.random.default_rng(0)
    size = np.linalg.eigh(force_covariance)
    root = size.eigenvectors * np.sqrt(np.maximum(size.eigenvalues, 0.0))
    signals = tuple(RecordedForce(one, sample_rate) for one in force.T)
    simulation = VariedSimulation(
        model, signals, 1 / sample_rate, *state[:2], hidden=state[2], sensitive=False,
        origin=start,
    )  # fmt: skip
    response = TangentResponse(
        model, 1 / sample_rate, DRAWS + len(alternatives), start, hidden_start=len(state[2]) > 0
    )
    columns = unknowns + 2 * len(model.coordinates) + len(state[2])
    end = columns + len(alternatives)
    information = Information.empty(end + DRAWS - 1)
    slopes = slope(force, 1 / sample_rate)
    last = np.zeros((1, len(model.coordinates), DRAWS))
    powers = []
    echo = _Echo(model, whitening, alternatives, sample_rate, start, len(state[2]) > 0)
    # The last chunk needs the force at the instant that follows it.
    for first in range(0, len(force) - CHUNK, CHUNK):
        varied = simulation.advance(CHUNK)
        motion = varied.motion
        following = np.stack((simulation.displacement, simulation.velocity, motion[-1, 2]))
        whole = np.concatenate((motion, following[np.newaxis]))
        noise = root @ generator.standard_normal((CHUNK, len(root), DRAWS))
        disturbance = np.concatenate((last, model.excitation_directions.T @ noise))
        last = disturbance[-1:]
        drawn_force = disturbance
        part = slice(first, first + CHUNK + 1)
        course = Course(model, whole, force[part], slopes[part], 1 / sample_rate)
        disturbance = np.concatenate((disturbance, disturbances(alternatives, course)), axis=2)
        hidden = np.vstack((varied.hidden, simulation.hidden))
        derivatives = response.advance(whole[:, 0], whole[:, 1], whole[:, 2], disturbance, hidden)
        add_readings(derivatives, alternatives, course, unknowns + DRAWS)
        drawn_motion = np.concatenate((derivatives, response.latest[np.newaxis]))
        drawn_motion = drawn_motion[..., unknowns : unknowns + ECHOES]
        echo.add(whole, hidden, drawn_motion, drawn_force)
        white = np.concatenate([one @ derivatives[:, kind] for kind, one in whitening], axis=1)
        drawn = white[:, :, unknowns : unknowns + DRAWS]
        tested = white[:, :, unknowns + DRAWS :][:, :, : len(alternatives)]
        states = white[:, :, unknowns + DRAWS + len(alternatives) :]
        rows = np.concatenate((white[:, :, :unknowns], states, tested, drawn), axis=2)
        rows = rows.reshape(-1, end + DRAWS)
        information = information.with_rows(rows[:, :-1], rows[:, -1])
        whole_averages = CHUNK // average
        averages = drawn[: whole_averages * average].reshape(whole_averages, average, -1)
        powers.append(float((averages.mean(axis=1) ** 2).mean()) * average)
    directions = residual_directions(information.factor[:end, :end], columns)
    scores = directions.T @ information.factor[:end, end:]
    factor = information.factor[:columns]
    lengths = np.linalg.norm(factor[:, :columns], axis=0)
    lengths[lengths == 0] = 1.0
    inverse = np.linalg.pinv(factor[:, :columns] / lengths, rcond=1e-11)[:unknowns]
    moved = (inverse @ factor[:, end:]) ** 2
    variance = (inverse**2).sum(axis=1)
    share = moved.mean(axis=1) / np.where(variance > 0, variance, 1.0)
    # By Schwarz's inequality: how far the two are correlated is not relied upon.
    drawn_squares = (information.factor[:, end:] ** 2).sum() / DRAWS
    bias = np.sqrt(echo.squares * drawn_squares) / max(information.rows, 1.0)
    slow_share, usual = float(np.mean(powers)), float(np.median(powers))
    growth = slow_share / usual if usual > 0 else 1.0
    return ForceNoise(share, slow_share, growth, (scores**2).mean(axis=1), bias)


class _Echo:
    """What force noise does to the columns of alternatives, found along the motion."""

    def __init__(
        self,
        model: Model,
        whitening: Sequence[tuple[int, Reals]],
        alternatives: Sequence[Alternative],
        sample_rate: float,
        start: float,
        hidden_start: bool,
    ) -> None:
        self._model, self._whitening, self._rate = model, whitening, sample_rate
        self._alternatives = alternatives
        self._count = ECHOES * len(alternatives)
        self._response = TangentResponse(model, 1 / sample_rate, self._count, start, hidden_start)
        # Sums of squares, mean of the draws.
        self.squares = np.zeros(len(alternatives))

    def add(self, motion: Reals, hidden: Reals, drawn: Reals, force: Reals) -> None:
        """
        Take a stretch of the motion, with the instant that follows it.

        Parameters
        ----------
        motion : ndarray, shape (n_samples + 1, 3, n_coordinates)
        hidden : ndarray, shape (n_samples + 1, n_hidden)
        drawn : ndarray, shape (n_samples + 1, 3, n_coordinates, n_echoes)
            What draws of the noise do to the motion.
        force : ndarray, shape (n_samples + 1, n_coordinates, n_draws)
            These draws, as generalised forces.

        """
        if not self._count:
            return
        to_exciters = np.linalg.pinv(self._model.excitation_directions)
        courses = []
        for draw in range(ECHOES):
            own = force[:, :, draw] @ to_exciters
            slopes = slope(own, 1 / self._rate)
            courses.append(Course(self._model, drawn[..., draw], own, slopes, 1 / self._rate))
        forcing = [disturbances(self._alternatives, course) for course in courses]
        derivatives = self._response.advance(
            motion[:, 0], motion[:, 1], motion[:, 2], np.concatenate(forcing, axis=2), hidden
        )
        first = len(self._model.estimated)
        for draw, course in enumerate(courses):
            place = first + draw * len(self._alternatives)
            add_readings(derivatives, self._alternatives, course, place)
        for kind, matrix in self._whitening:
            white = matrix @ derivatives[:, kind, :, first : first + self._count]
            sums = (white**2).sum(axis=(0, 1)).reshape(ECHOES, -1)
            self.squares += sums.mean(axis=0)
