# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What a record says: a linear regression about the nominal motion.

What the measured readings deviate from the nominal motion by is, to first order, a sum of the
responses of the linearised machine to: errors of the unknowns and of the initial state, what the
nominal motion lacks in the equations of motion (known), and each effect that is missing, in
proportion to its size; and of the deviations that sensor faults add. Rows are spectral lines of
averages over a few samples, weighted so that noise has unit variance.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from identnl_ros.core.discrepancy.comparison import averages, Comparison
from identnl_ros.core.discrepancy.features import left_hand_side
from identnl_ros.core.discrepancy.force_noise import (
    Lines,
    spectral_lines,
    Whitening,
    whitening,
)
from identnl_ros.core.discrepancy.motion_channels import MotionChannels
from identnl_ros.core.mechanics.hidden_states import hidden_motion
from identnl_ros.core.simulation.tangent_response import (
    linearise,
    LinearisedEquations,
    TangentResponse,
)
import numpy as np
from numpy.typing import NDArray
from scipy import fft

Reals = NDArray[np.float64]

CHUNK = 512
# Directions of the unknowns that the data see less than this, relatively, do not count.
DISTINCT = 1e-9


@dataclass(frozen=True)
class Remaining:
    """
    What the unknowns and the initial state leave.

    Parameters
    ----------
    residual : ndarray, shape (n_sensors, n_lines)
        Complex.
    basis : ndarray, shape (n_basis, n_motion_channels, n_lines)
        Complex; orthonormal as real rows. What the unknowns and the initial state can explain.

    """

    residual: Lines
    basis: Lines


class Evidence:
    """
    The regression of a record by the unknowns of the model and the initial state.

    Parameters
    ----------
    comparison : Comparison

    Attributes
    ----------
    comparison : Comparison
    channels : MotionChannels
    equations : LinearisedEquations
        About the nominal motion.
    residual : ndarray, shape (n_sensors, n_lines)
        Complex: what the nominal motion and its defect leave of the readings, by channel.
    base : ndarray, shape (n_unknowns + n_state, n_motion_channels, n_lines)
        Complex, of the channels in which motion shows.

    """

    def __init__(self, comparison: Comparison) -> None:
        self.comparison = comparison
        self.channels = MotionChannels(comparison.rows, comparison.deviation, comparison.tilt)
        motion = comparison.motion
        model = comparison.model
        hidden = hidden_motion(
            model, motion.displacement, motion.velocity, comparison.state.hidden
        )
        self.equations: LinearisedEquations = linearise(
            model, motion.displacement, motion.velocity, motion.acceleration, hidden,
            1 / comparison.rate, comparison.time,
        )  # fmt: skip
        table = self._table(hidden)
        white = (comparison.measured - comparison.readings(motion)) / comparison.deviation
        white[~comparison.valid] = 0.0
        readings = averages(white[: comparison.count], comparison.average) @ self.channels.turn
        deviation = np.ascontiguousarray(readings.T)
        deviation[: self.channels.count] -= table[0]
        residual = spectral_lines(deviation)
        residual[: self.channels.count] = self.whitened(residual[None, : self.channels.count])[0]
        self.residual: Lines = residual
        self.base: Lines = self.whitened(spectral_lines(table[1:]))

    @property
    def rows(self) -> int:
        """Real numbers that are compared."""
        comparison = self.comparison
        return comparison.count // comparison.average * len(comparison.sensors)

    @cached_property
    def frequencies(self) -> Reals:
        """Of the lines [Hz]."""
        comparison = self.comparison
        count = comparison.count // comparison.average
        return np.asarray(fft.rfftfreq(count, comparison.average / comparison.rate))

    @cached_property
    def weights(self) -> Whitening | None:
        """Of noise of the force; None: there is none."""
        comparison = self.comparison
        return whitening(
            self.equations,
            comparison.description.layout,
            self.channels.per_motion,
            self.frequencies,
        )

    def whitened(self, lines: Lines) -> Lines:
        """
        Weight spectra of the motion channels.

        Parameters
        ----------
        lines : ndarray, shape (n_columns, n_motion_channels, n_lines)

        Returns
        -------
        ndarray
            The same array.

        """
        return lines if self.weights is None else self.weights.apply(lines)

    @cached_property
    def remaining(self) -> Remaining:
        """What the unknowns and the initial state leave."""
        rows = real_rows(self.base)
        lengths = np.linalg.norm(rows, axis=1)
        rows = rows[lengths > 0] / lengths[lengths > 0, np.newaxis]
        left, triangle = np.linalg.qr(rows.T)
        outer, sizes, _ = np.linalg.svd(triangle)
        distinct = outer[:, sizes > DISTINCT * sizes.max(initial=1.0)]
        basis = np.ascontiguousarray((left @ distinct).T)
        residual = self.residual.copy()
        count, lines = self.channels.count, residual.shape[1]
        own = real_rows(residual[None, :count])[0]
        own = own - basis.T @ (basis @ own)
        residual[:count] = own.view(np.complex128).reshape(count, lines)
        return Remaining(residual, basis.view(np.complex128).reshape(len(basis), count, lines))

    def _table(self, hidden: Reals) -> Reals:
        """Respond to the defect and to the unknowns; (n_columns, n_motion_channels, n)."""
        comparison = self.comparison
        model, motion, count = comparison.model, comparison.motion, comparison.count
        interval = 1 / comparison.rate
        n = len(model.coordinates)
        unknowns = TangentResponse(model, interval)
        first_state = 1 + len(model.estimated)
        columns = first_state + 2 * n + hidden.shape[1]
        state = np.zeros((3, n, columns))
        state[0, :, first_state : first_state + n] = np.eye(n)
        state[1, :, first_state + n : first_state + 2 * n] = np.eye(n)
        inside = np.zeros((2, hidden.shape[1], columns))
        inside[0, :, first_state + 2 * n :] = np.eye(hidden.shape[1])
        force = comparison.force() @ model.excitation_directions
        size = max(CHUNK // comparison.average, 1) * comparison.average
        parts = []
        for first in range(0, count, size):
            part = slice(first, min(first + size, count) + 1)
            piece = motion.displacement[part], motion.velocity[part], motion.acceleration[part]
            time = comparison.time[part]
            defect = force[part] - left_hand_side(model, *piece, time, hidden[part])
            forcing = np.concatenate(
                (defect[:, :, np.newaxis], unknowns.forcing(*piece, hidden[part], time)), axis=2
            )
            means = self.equations.respond(state, forcing, inside, first, comparison.average)
            parts.append(self.channels.of_motion(means))
        return np.asarray(np.concatenate(parts, axis=2) * np.sqrt(comparison.average))


def real_rows(lines: Lines) -> NDArray[Any]:
    """
    View spectra as real numbers.

    Parameters
    ----------
    lines : ndarray, shape (n_columns, n_channels, n_lines)

    Returns
    -------
    ndarray, shape (n_columns, 2 * n_channels * n_lines)

    """
    whole = np.ascontiguousarray(lines).reshape(len(lines), -1)
    return whole.view(whole.real.dtype)
