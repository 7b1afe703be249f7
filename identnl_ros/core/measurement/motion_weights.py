# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Weights that make the noise of measured motion white and of unit size."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from identnl_ros.core.measurement.motion_record import MotionRecord
from identnl_ros.core.measurement.noise import DIFFERENCES, fast_part
from identnl_ros.core.measurement.stencils import stencil
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

Reals = NDArray[np.float64]
Whitening = tuple[int, int, tuple[tuple[int, Reals], ...]]

# A sensor stated to be perfect is taken to be good to this fraction of what it shows.
PERFECT = 1e-6
# A rate is measured, not differentiated, where its variance is below this share of what
# differences of the displacement would give it.
BETTER = 0.1
HALF_WIDTH = 8
# For an estimate of noise.
FEWEST_SAMPLES = 64
# Below this noise, relative to the motion, the arithmetic must be as exact as it can be.
QUIET = 1e-3


@dataclass(frozen=True)
class MotionWeights:
    """
    Whitening of the measured quantities: displacement, velocity and acceleration in this order.

    Parameters
    ----------
    matrices : tuple of (int, ndarray)
        0 displacement, 1 velocity, 2 acceleration, those that are measured; matrix times
        the deviation of the coordinates has unit covariance, shape (n_measured, n).
    covariances : tuple of ndarray, shape (n, n)
        Of the same quantities.
    perfect : bool
        The sensors are stated to be without noise.
    quiet : bool
        The noise is very small beside the motion.
    estimated : bool
        The noise was estimated from the record.

    """

    matrices: tuple[tuple[int, Reals], ...]
    covariances: tuple[Reals, ...]
    perfect: bool
    quiet: bool
    estimated: bool

    @property
    def places(self) -> NDArray[np.int_]:
        """Place of every measured quantity among all that could be measured."""
        n = self.matrices[0][1].shape[1]
        return np.concatenate([kind * n + np.arange(len(one)) for kind, one in self.matrices])

    def whitening(self, record: MotionRecord, first: int, end: int) -> Iterator[Whitening]:
        """
        Give the weights along a record: where its noise is another one, others.

        Parameters
        ----------
        record : MotionRecord
        first, end : int
            The samples wanted.

        Yields
        ------
        int, int
            From a sample of those wanted up to, not including, another one.
        tuple of (int, ndarray)
            The matrices there.

        """
        place = first
        # Where sensors are taken to be better than they can be, that does not change.
        for span in () if self.perfect else record.spans:
            begin, stop = (
                min(max(index - record.first_index, place), end)
                for index in (span.first_index, span.end_index)
            )
            if begin > place:
                yield place - first, begin - first, self.matrices
            if stop > begin:
                yield begin - first, stop - first, self._for_noise(span.covariances)
            place = stop
        if place < end:
            yield place - first, end - first, self.matrices

    def _for_noise(self, covariances: Sequence[Reals]) -> tuple[tuple[int, Reals], ...]:
        """Whiten the same motions under another noise."""
        matrices = []
        for kind, matrix in self.matrices:
            square = matrix @ covariances[kind] @ matrix.T
            matrices.append((kind, np.linalg.solve(np.linalg.cholesky(square), matrix)))
        return tuple(matrices)

    @classmethod
    def of(
        cls, record: MotionRecord, covariances: Sequence[Reals], derived: Sequence[bool]
    ) -> 'MotionWeights':
        """
        Find the weights.

        Parameters
        ----------
        record : MotionRecord
        covariances : sequence of 3 ndarray, shape (n, n)
            Of displacement, velocity and acceleration at one sample; NaN: not known, then
            estimated from the record; zero: perfect sensors.
        derived : sequence of 3 bool
            At least partly differentiated displacement, not measured.

        Returns
        -------
        MotionWeights

        """
        tables = (record.displacement, record.velocity, record.acceleration)
        matrices: list[tuple[int, Reals]] = []
        used: list[Reals] = []
        perfect = estimated = False
        quiet = True
        for kind, (table, covariance) in enumerate(zip(tables, covariances, strict=True)):
            size = _root_mean_square(table)
            if np.isnan(covariance).any():
                covariance, estimated = noise_covariance(table), True
            if np.all(np.diag(covariance) <= (1e-3 * PERFECT * size) ** 2):
                covariance, perfect = np.diag((PERFECT * size) ** 2), True
                if derived[kind]:
                    continue  # which part is measured does not show
            noise = np.sqrt(np.diag(covariance))
            scaled = np.linalg.cholesky(covariance / np.outer(noise, noise))
            matrix = np.linalg.inv(scaled) / noise
            if derived[kind]:
                matrix = _measured(covariance, used[0] * record.sample_rate ** (2 * kind), kind)
            if not len(matrix):
                continue
            quiet &= bool(np.all(noise <= QUIET * size))
            matrices.append((kind, matrix))
            used.append(covariance)
        return cls(tuple(matrices), tuple(used), perfect, perfect or quiet, estimated)


def _root_mean_square(table: Reals) -> Reals:
    """Size of every coordinate; those that rest count as small as the smallest that moves."""
    table = table[np.isfinite(table).all(axis=1)]
    if not len(table):
        return np.ones(table.shape[1])
    size: Reals = np.sqrt(np.mean(table**2, axis=0))
    moving = size[size > 1e-12 * size.max(initial=0.0)]
    return np.maximum(size, moving.min() if moving.size else 1.0)


def noise_covariance(table: Reals) -> Reals:
    """
    Estimate the covariance of white noise upon a smooth motion or force.

    Parameters
    ----------
    table : ndarray, shape (n_samples, n)

    Returns
    -------
    ndarray, shape (n, n)

    """
    # Where samples are missing often, only lower orders find enough of them in a row.
    for differences in range(DIFFERENCES, 0, -1):
        fast = fast_part(table, differences)
        fast = fast[np.isfinite(fast).all(axis=1)]
        if len(fast) >= FEWEST_SAMPLES:
            break
    return np.asarray(fast.T @ fast / max(len(fast), 1))


def _measured(covariance: Reals, displacement: Reals, order: int) -> Reals:
    """Whiten the motions whose rate is measured better than differences could give it."""
    squares, motions = eigh(covariance, displacement)
    weights = stencil(order, 0.0, HALF_WIDTH)
    kept = squares < BETTER * float(weights @ weights)
    return np.asarray(motions[:, kept].T / np.sqrt(squares[kept])[:, np.newaxis])
