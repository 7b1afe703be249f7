# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Find the hypothesis that explains a residual best, and whether noise could have done the same.

Each hypothesis explains one direction of the residual beyond what the unknowns of the model
explain; the largest of these is compared with the largest that pure noise gives over the same
library, whose hypotheses resemble one another (max-T test of Westfall and Young).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.evidence import Evidence
import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

Reals = NDArray[np.float64]

FALSE_ALARM_RATE = 0.01
# A hypothesis of which less than this share is left beside the unknowns says the same as they.
DISTINCT = 1e-5
DRAWS = 4000
BUCKETS = 4096
# Twice the logarithm of the ratio of likelihoods above which another hypothesis is out.
DECISIVE = 14.0
# A difference of gains that is no difference.
SAME = 0.5


@dataclass(frozen=True)
class Finding:
    """
    A hypothesis that explains what noise does not.

    Parameters
    ----------
    hypothesis : Hypothesis
    size, deviation : float
        Its size and the standard deviation of that [SI].
    gain : float
        By which it lowers the sum of squares of the residual.
    probability : float
        That noise alone makes some hypothesis explain as much.
    rivals : tuple of Hypothesis
        Others, of another name or place, that explain nearly as much.

    """

    hypothesis: Hypothesis
    size: float
    deviation: float
    gain: float
    probability: float
    rivals: tuple[Hypothesis, ...]


class Selection:
    """
    Forward selection among the hypotheses of a regression.

    Parameters
    ----------
    evidence : Evidence
    generator : numpy.random.Generator
        For the draws of noise.

    """

    def __init__(self, evidence: Evidence, generator: np.random.Generator) -> None:
        self.hypotheses = evidence.hypotheses
        self._generator = generator
        basis = _basis(evidence.base)
        self.residual = evidence.residual - basis @ (basis.T @ evidence.residual)
        self.freedom = len(self.residual) - basis.shape[1]
        lengths = np.sqrt(_squares(evidence.columns))
        lengths[lengths == 0] = 1.0
        self._lengths = lengths
        columns = evidence.columns / lengths.astype(evidence.columns.dtype)
        small = basis.astype(columns.dtype)
        self._columns = columns - small @ (small.T @ columns)
        self._shares = _squares(self._columns)

    @property
    def _distinct(self) -> NDArray[np.bool_]:
        return np.asarray(self._shares > DISTINCT)

    def scores(self) -> Reals:
        """
        Give what every hypothesis explains, in standard deviations.

        Returns
        -------
        ndarray, shape (n_hypotheses,)
            Signed; 0 where it says nothing beyond the model.

        """
        used = self._distinct
        scores = np.zeros(len(used))
        products = self._columns.T @ self.residual.astype(self._columns.dtype)
        scores[used] = products[used] / np.sqrt(self._shares[used])
        return scores

    def sizes(self) -> tuple[Reals, Reals]:
        """
        Estimate the size of every hypothesis, if it alone is true.

        Returns
        -------
        sizes, deviations : ndarray, shape (n_hypotheses,)
            [SI]; infinite deviations where the data do not tell.

        """
        used = self._distinct
        deviations = np.full(len(used), np.inf)
        deviations[used] = 1 / (np.sqrt(self._shares[used]) * self._lengths[used])
        sizes = np.zeros(len(used))
        sizes[used] = self.scores()[used] * deviations[used]
        return sizes, deviations

    def null_maxima(self) -> Reals:
        """
        Draw the largest score that noise alone gives.

        Returns
        -------
        ndarray, shape (DRAWS,)

        """
        used = self._distinct
        sketch = _sketch(self._columns, self._generator)[:, used] / np.sqrt(self._shares[used])
        draws = self._generator.standard_normal((DRAWS, len(sketch))) @ sketch
        return np.asarray(np.abs(draws).max(axis=1))

    def best(self, null: Reals, excluded: Sequence[tuple[str, str]] = ()) -> Finding | None:
        """
        Find the hypothesis that explains most, if noise does not explain as much.

        Parameters
        ----------
        null : ndarray
            Of `null_maxima`.
        excluded : sequence of (str, str)
            Effects and places that are out of the question.

        Returns
        -------
        Finding or None

        """
        scores = self.scores()
        sizes, deviations = self.sizes()
        # Of those that explain the same, the foremost of the library.
        order = np.lexsort((np.arange(len(scores)), -np.round(scores**2 / SAME)))
        leader = None
        rivals: dict[tuple[str, str], Hypothesis] = {}
        for i in order:
            one = self.hypotheses[i]
            if scores[i] == 0 or one.key in excluded:
                continue
            if not one.effect.admits(float(sizes[i]), float(deviations[i])):
                continue
            if leader is None:
                leader = i
            elif one.key != self.hypotheses[leader].key:
                if scores[leader] ** 2 - scores[i] ** 2 > DECISIVE:
                    break
                rivals.setdefault(one.key, one)
        if leader is None:
            return None
        probability = tail(float(abs(scores[leader])), null)
        if probability > FALSE_ALARM_RATE:
            return None
        return Finding(
            self.hypotheses[leader], float(sizes[leader]), float(deviations[leader]),
            float(scores[leader] ** 2), probability, tuple(rivals.values()),
        )  # fmt: skip

    def add(self, hypothesis: Hypothesis) -> None:
        """
        Take a hypothesis as part of the model.

        Parameters
        ----------
        hypothesis : Hypothesis

        """
        i = self.hypotheses.index(hypothesis)
        unit = self._columns[:, i] / np.float32(np.sqrt(self._shares[i]))
        self.residual = self.residual - unit * (unit @ self.residual)
        self._columns -= np.outer(unit, unit @ self._columns)
        self._shares = _squares(self._columns)
        self.freedom -= 1

    @property
    def excess(self) -> float:
        """Mean square of the residual; 1 where noise explains it."""
        total: float = np.sum(self.residual**2)
        return float(total / self.freedom)


def tail(score: float, null: Reals) -> float:
    """
    Find the probability that noise alone makes the largest score as large.

    Parameters
    ----------
    score : float
    null : ndarray
        Draws of the largest score.

    Returns
    -------
    float
        Beyond the draws: that of one score times their effective number.

    """
    limit = float(np.quantile(null, 1 - FALSE_ALARM_RATE))
    if score <= limit:
        return float((1 + (null >= score).sum()) / (1 + len(null)))
    number = FALSE_ALARM_RATE / (2 * float(norm.sf(limit)))
    return float(min(FALSE_ALARM_RATE, 2 * number * norm.sf(score)))


def _basis(table: Reals) -> Reals:
    """Find an orthonormal basis of the columns, as far as they are distinct."""
    lengths = np.linalg.norm(table, axis=0)
    used = lengths > 0
    left, sizes, _ = np.linalg.svd(table[:, used] / lengths[used], full_matrices=False)
    return np.asarray(left[:, sizes > 1e-9 * sizes.max(initial=1.0)])


def _squares(columns: Reals) -> Reals:
    return np.asarray(np.einsum('ij,ij->j', columns, columns, dtype=np.float64))


def _sketch(columns: Reals, generator: np.random.Generator) -> Reals:
    """Keep the inner products of columns, to a few percent, in fewer rows."""
    count = len(columns)
    signs = generator.choice(np.array([-1.0, 1.0], columns.dtype), count)
    order = generator.permutation(count)
    rows = -(-count // BUCKETS) * BUCKETS
    padded = np.zeros((rows, columns.shape[1]), columns.dtype)
    padded[:count] = columns[order] * signs[:, np.newaxis]
    return np.asarray(padded.reshape(-1, BUCKETS, columns.shape[1]).sum(axis=0))
