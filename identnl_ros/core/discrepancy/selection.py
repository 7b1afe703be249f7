# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Find the hypothesis that explains a residual best, and whether noise could have done the same.

Each hypothesis explains one direction of the residual beyond what the unknowns of the model
explain; the largest of these is compared with the largest that pure noise gives over the same
library, whose hypotheses resemble one another (max-T test of Westfall and Young).
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from identnl_ros.core.discrepancy.circumstances import Scale
from identnl_ros.core.discrepancy.effect import Hypothesis, SensorFault
from identnl_ros.core.discrepancy.evidence import Evidence, real_rows, Remaining
from identnl_ros.core.discrepancy.machine_columns import MachineColumns
from identnl_ros.core.discrepancy.sensor_columns import SensorColumns
import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

Reals = NDArray[np.float64]

FALSE_ALARM_RATE = 0.01
# A hypothesis of which less than this share is left beside the unknowns says the same as they.
DISTINCT = 1e-5
DRAWS = 4000
BUCKETS = 512
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
    Forward selection among hypotheses.

    Parameters
    ----------
    evidence : Evidence
    scale : Scale
        By which inner parameters were chosen.
    hypotheses : sequence of Hypothesis
    generator : numpy.random.Generator
        For the draws of noise.
    threads : int
        That share the work; the result is the same to the last bit.

    """

    def __init__(
        self,
        evidence: Evidence,
        scale: Scale,
        hypotheses: Sequence[Hypothesis],
        generator: np.random.Generator,
        threads: int = 1,
    ) -> None:
        self.evidence = evidence
        self.scale = scale
        inner = [one for one in hypotheses if not isinstance(one.effect, SensorFault)]
        faults = [one for one in hypotheses if isinstance(one.effect, SensorFault)]
        self.hypotheses = (*inner, *faults)
        self.generator = generator
        left = evidence.remaining
        machine = _of_machine(evidence, inner, left, generator, threads)
        sensors, self._fault_products = _of_sensors(evidence, faults, left)
        self._sketch = machine.sketch
        self._products = np.concatenate((machine.products, sensors.products))
        self._squares = np.concatenate((machine.squares, sensors.squares))
        self._shares = np.concatenate((machine.shares, sensors.shares))

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
        scores[used] = self._products[used] / np.sqrt(self._squares[used])
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
        deviations[used] = 1 / np.sqrt(self._squares[used])
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
        count = len(self._sketch)
        maxima = np.zeros(DRAWS)
        sketch = self._sketch[used[:count]]
        if len(sketch):
            # Columns of the machine and of sensors are drawn apart: if that matters, the limit
            # is a little too high.
            sketch = sketch / np.linalg.norm(sketch, axis=1, keepdims=True)
            noise = self.generator.standard_normal((DRAWS, sketch.shape[1]), dtype=np.float32)
            maxima = np.abs(noise @ sketch.T).max(axis=1).astype(np.float64)
        among = self._fault_products[np.ix_(used[count:], used[count:])]
        if len(among):
            size = np.sqrt(np.diag(among))
            squares, directions = np.linalg.eigh(among / np.outer(size, size))
            root = directions * np.sqrt(np.maximum(squares, 0.0))
            draws = self.generator.standard_normal((DRAWS, len(among)))
            maxima = np.maximum(maxima, np.abs(draws @ root.T).max(axis=1))
        return np.asarray(maxima, dtype=np.float64)

    def equals_of(self, finding: Finding) -> list[tuple[str, str]]:
        """
        Find the hypotheses that explain the same.

        Parameters
        ----------
        finding : Finding

        Returns
        -------
        list of (str, str)
            Effects and places.

        """
        gains = self.scores() ** 2
        return [
            one.key
            for one, gain in zip(self.hypotheses, gains, strict=True)
            if abs(gain - finding.gain) < SAME and one.effect is finding.hypothesis.effect
        ]

    def best(self, null: Reals | None, excluded: Sequence[tuple[str, str]] = ()) -> Finding | None:
        """
        Find the hypothesis that explains most, if noise does not explain as much.

        Parameters
        ----------
        null : ndarray or None
            Of `null_maxima`; None: whatever explains most is given, with no probability (NaN).
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
        probability = float('nan') if null is None else tail(float(abs(scores[leader])), null)
        if probability > FALSE_ALARM_RATE:
            return None
        return Finding(
            self.hypotheses[leader], float(sizes[leader]), float(deviations[leader]),
            float(scores[leader] ** 2), probability, tuple(rivals.values()),
        )  # fmt: skip


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


@dataclass(frozen=True)
class _Columns:
    """Columns beyond what the unknowns explain: products with the residual, squares, shares."""

    products: Reals
    squares: Reals
    shares: Reals
    sketch: NDArray[np.float32]


def _of_machine(
    evidence: Evidence,
    hypotheses: Sequence[Hypothesis],
    left: Remaining,
    generator: np.random.Generator,
    threads: int,
) -> _Columns:
    columns = MachineColumns(evidence, hypotheses)
    motion = evidence.channels.count
    residual = real_rows(left.residual[None, :motion])[0]
    basis = real_rows(left.basis).astype(np.float32)
    signs = generator.choice(np.array([-1, 1], np.float32), len(residual))

    def work(block: Sequence[int]) -> _Columns:
        table = columns.of(block)
        lengths = np.sqrt(_squares(table))
        lengths[lengths == 0] = 1.0
        table /= lengths[:, np.newaxis].astype(np.float32)
        table -= (table @ basis.T) @ basis
        shares = _squares(table)
        # Noise of single precision, summed in double.
        products = np.einsum('ij,j->i', table, residual) * lengths
        return _Columns(products, shares * lengths**2, shares, _sketch(table * signs))

    with ThreadPoolExecutor(threads) as pool:
        parts = list(pool.map(work, columns.blocks))
    if not parts:
        none = np.zeros(0)
        return _Columns(none, none, none, np.zeros((0, BUCKETS), np.float32))
    return _Columns(
        np.concatenate([one.products for one in parts]),
        np.concatenate([one.squares for one in parts]),
        np.concatenate([one.shares for one in parts]),
        np.concatenate([one.sketch for one in parts]),
    )


def _of_sensors(
    evidence: Evidence, hypotheses: Sequence[Hypothesis], left: Remaining
) -> tuple[_Columns, Reals]:
    columns = SensorColumns(evidence, hypotheses)
    gram = columns.gram()
    explained = columns.products(left.basis)
    beyond = gram - explained @ explained.T
    whole, squares = np.diag(gram), np.maximum(np.diag(beyond), 0.0)
    shares = np.divide(squares, whole, out=np.zeros_like(squares), where=whole > 0)
    products = columns.products(left.residual[None])[:, 0]
    return _Columns(products, squares, shares, np.zeros((0, BUCKETS), np.float32)), beyond


def _squares(rows: NDArray[np.floating]) -> Reals:
    return np.asarray(np.einsum('ij,ij->i', rows, rows, dtype=np.float64))


def _sketch(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Keep the inner products of rows with random signs, to a few percent, in fewer numbers."""
    count = rows.shape[1]
    padded = np.zeros((len(rows), -(-count // BUCKETS) * BUCKETS), np.float32)
    padded[:, :count] = rows
    return np.asarray(padded.reshape(len(rows), -1, BUCKETS).sum(axis=1))
