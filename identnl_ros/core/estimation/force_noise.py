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
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import RecordedForce
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.simulation.tangent_response import TangentResponse
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

DRAWS = 24
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

    """

    variance_share: Reals
    slow_share: float
    growth: float = 1.0

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
        model, 1 / sample_rate, DRAWS, start, hidden_start=len(state[2]) > 0
    )
    columns = unknowns + 2 * len(model.coordinates) + len(state[2])
    information = Information.empty(columns + DRAWS - 1)
    last = np.zeros((1, len(model.coordinates), DRAWS))
    powers = []
    for _ in range(len(force) // CHUNK):
        varied = simulation.advance(CHUNK)
        motion = varied.motion
        following = np.stack((simulation.displacement, simulation.velocity, motion[-1, 2]))
        whole = np.concatenate((motion, following[np.newaxis]))
        noise = root @ generator.standard_normal((CHUNK, len(root), DRAWS))
        disturbance = np.concatenate((last, model.excitation_directions.T @ noise))
        last = disturbance[-1:]
        hidden = np.vstack((varied.hidden, simulation.hidden))
        derivatives = response.advance(whole[:, 0], whole[:, 1], whole[:, 2], disturbance, hidden)
        white = np.concatenate([one @ derivatives[:, kind] for kind, one in whitening], axis=1)
        drawn = white[:, :, unknowns : unknowns + DRAWS]
        fitted = np.concatenate((white[:, :, :unknowns], white[:, :, unknowns + DRAWS :]), axis=2)
        rows = np.concatenate((fitted, drawn), axis=2).reshape(-1, columns + DRAWS)
        information = information.with_rows(rows[:, :-1], rows[:, -1])
        whole_averages = CHUNK // average
        averages = drawn[: whole_averages * average].reshape(whole_averages, average, -1)
        powers.append(float((averages.mean(axis=1) ** 2).mean()) * average)
    factor = information.factor[:columns]
    lengths = np.linalg.norm(factor[:, :columns], axis=0)
    lengths[lengths == 0] = 1.0
    inverse = np.linalg.pinv(factor[:, :columns] / lengths, rcond=1e-11)[:unknowns]
    moved = (inverse @ factor[:, columns:]) ** 2
    variance = (inverse**2).sum(axis=1)
    share = moved.mean(axis=1) / np.where(variance > 0, variance, 1.0)
    slow_share, usual = float(np.mean(powers)), float(np.median(powers))
    return ForceNoise(share, slow_share, slow_share / usual if usual > 0 else 1.0)
