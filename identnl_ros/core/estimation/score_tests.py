# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Score tests: whether the residual has a share of what an alternative would do.

What the parameters can imitate of an alternative is taken away first: what is left of its column
is how well the data can contradict it, and the residual along that is its score.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information, RANK_TOLERANCE
from identnl_ros.core.estimation.alternatives import Alternative
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

Reals = NDArray[np.float64]

# What is left of a column below this share of it is rounding: the parameters imitate all of it.
IMITATED = 1e-8
# Alternatives that are told; those whose score is nearly that of the first are hard to tell apart.
MOST_TOLD = 3


@dataclass(frozen=True)
class ScoreTest:
    """
    One alternative, estimated beside the unknowns.

    Parameters
    ----------
    alternative : Alternative
    size : float
        That would explain the residual best [SI].
    deviation : float
        Its standard deviation, if nothing is missing [SI]; infinite where the unknowns imitate it.
    freedom : float
        Degrees of freedom of that deviation.
    effect : ndarray, shape (n_unknowns,)
        By which the estimates change per unit of it.

    """

    alternative: Alternative
    size: float
    deviation: float
    freedom: float
    effect: Reals

    @property
    def score(self) -> float:
        """Size over its standard deviation."""
        return self.size / self.deviation if np.isfinite(self.deviation) else 0.0

    def critical(self, rate: float) -> float:
        """
        Give the absolute score that is exceeded by chance at a rate.

        Parameters
        ----------
        rate : float
            Two-sided.

        Returns
        -------
        float

        """
        return float(student.isf(rate / 2, self.freedom))


@dataclass(frozen=True)
class ScoreNoise:
    """
    What makes scores differ from zero where nothing is missing.

    Parameters
    ----------
    variance : float
        Of the sensors' noise, over the stated one.
    arithmetic : float
        Error of every residual, perhaps all of one sign, over the stated noise.
    force_share : ndarray, shape (n_alternatives,), or None
        Variance of scores by noise of the measured force; None: not known to be any.
    draws : int
        From which that was found.
    force_bias : ndarray, shape (n_alternatives,), or None
        Bound of what a row adds to the product of residual and column by that noise.

    """

    variance: float
    arithmetic: float
    force_share: Reals | None
    draws: int
    force_bias: Reals | None = None


def score_tests(
    tested: Information, unknowns: int, alternatives: Sequence[Alternative], noise: ScoreNoise
) -> tuple[ScoreTest, ...]:
    """
    Test all alternatives, each by itself.

    Parameters
    ----------
    tested : Information
        On the unknowns, then the alternatives.
    unknowns : int
    alternatives : sequence of Alternative
    noise : ScoreNoise

    Returns
    -------
    tuple of ScoreTest
        Of those that would change the data at all.

    """
    end = tested.size
    factor = tested.factor[:end, :end]
    directions = residual_directions(factor, unknowns)
    _, solver = _decomposed(factor[:unknowns, :unknowns])
    found = []
    for place, alternative in enumerate(alternatives):
        column = factor[:, unknowns + place]
        if not column.any():
            continue
        effect = -solver @ column[:unknowns]
        length = float(directions[:, place] @ column)
        if not length:
            found.append(ScoreTest(alternative, 0.0, np.inf, np.inf, effect))
            continue
        share = 0.0 if noise.force_share is None else float(noise.force_share[place])
        variance = noise.variance + share + noise.arithmetic**2 * tested.rows
        if noise.force_bias is not None:
            variance += (float(noise.force_bias[place]) * tested.rows / length) ** 2
        # Satterthwaite: only the share of the force rests on few draws.
        freedom = noise.draws * (variance / share) ** 2 if share else np.inf
        size = float(directions[:, place] @ tested.factor[:end, -1]) / length
        deviation = float(np.sqrt(variance)) / length
        found.append(ScoreTest(alternative, size, deviation, freedom, effect))
    return tuple(found)


def residual_directions(factor: Reals, fitted: int) -> Reals:
    """
    Give the directions in which alternatives show, what is fitted taken away.

    Parameters
    ----------
    factor : ndarray, shape (n, n)
        Triangular, of a regression on what is fitted, then the alternatives.
    fitted : int
        Number of the former.

    Returns
    -------
    ndarray, shape (n, n - fitted)
        Of unit length, in the coordinates of the rows of the factor; zero where nothing is left.

    """
    table = factor[:, fitted:].copy()
    whole = np.linalg.norm(table, axis=0)
    left, _ = _decomposed(factor[:fitted, :fitted])
    table[:fitted] -= left @ (left.T @ table[:fitted])
    length = np.linalg.norm(table, axis=0)
    seen = length > IMITATED * whole
    return np.asarray(np.where(seen, table, 0.0) / np.where(seen, length, 1.0))


def contradiction(tests: Sequence[ScoreTest], rate: float, model: Model) -> str:
    """
    Say which alternatives the data ask for.

    Parameters
    ----------
    tests : sequence of ScoreTest
    rate : float
        Chance that data which contradict nothing are said to contradict something.
    model : Model

    Returns
    -------
    str
        Sentences; empty: none.

    """
    seen = [one for one in tests if np.isfinite(one.deviation)]
    asked = [one for one in seen if abs(one.score) > one.critical(rate / len(seen))]
    if not asked:
        return ''
    asked.sort(key=lambda one: -abs(one.score))
    told = [
        f'{one.alternative.in_words(model, one.size, one.deviation)} ({abs(one.score):.3g} sigma)'
        for one in asked[:MOST_TOLD]
    ]
    others = f'; {len(asked) - MOST_TOLD} more would, too' if len(asked) > MOST_TOLD else ''
    return (
        f'The data contradict the model: {", or ".join(told)} would explain at least part of it'
        f'{others}. It need not be that one.'
    )


def _decomposed(factor: Reals) -> tuple[Reals, Reals]:
    """Directions that the unknowns reach, and the pseudo-inverse of their columns."""
    lengths = np.linalg.norm(factor, axis=0)
    lengths[lengths == 0] = 1.0
    left, singular, right = np.linalg.svd(factor / lengths)
    rank = int((singular > RANK_TOLERANCE * singular.max(initial=0.0)).sum())
    solver = (right[:rank].T / singular[:rank]) @ left[:, :rank].T / lengths[:, np.newaxis]
    return left[:, :rank], solver
