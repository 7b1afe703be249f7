# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Estimates of parameters that physics bounds, e.g. stiffness and damping from below by zero.

The values are those of greatest likelihood within the bounds: the feasible point nearest to the
unconstrained estimate in the metric of its information. Held at a bound, a parameter moves all
that are correlated with it.

The intervals rest on the unconstrained estimate alone, whose error has the same law wherever the
truth lies. The shorter ones that follow from the constrained estimate cover too seldom: the
deviation conditional on a neighbour at its bound holds only where the neighbour truly lies on it,
and the likelihood ratio near bounds follows mixtures of chi-squared laws that depend on the
unknown truth (Self and Liang 1987, JASA 82, 605-610). The unconstrained interval merely cut off at
the bounds does cover, but shrinks to nothing, and beyond, the worse the estimate misses the range
(Feldman and Cousins 1998, Phys. Rev. D 57, 3873-3889). So it is centred on the unconstrained
estimate moved into the range, with the same deviation, cut off at the bounds, and widened to
contain the constrained value. It always includes the feasible part of the unconstrained interval,
hence covers every feasible truth at least as often, whatever the correlations; a truth on its
bound in 97.5 % instead of 95 %.
"""

from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.errors import DataError
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.special import stdtrit

COVERAGE = 0.95


@dataclass(frozen=True)
class BoundedEstimate:
    """
    Estimate within bounds.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of greatest likelihood; NaN where the data do not determine a parameter.
    lower, upper : ndarray, shape (n,)
        Interval of each parameter by itself, with a coverage of at least `COVERAGE`; the bounds
        where the data do not determine it.
    at_bound : ndarray of bool, shape (n,)
        The value is a bound.
    contradicted : ndarray of bool, shape (n,)
        The data contradict the bounds: the unconstrained interval lies outside of them. Where
        they hold and the deviations are right, this happens once in forty times for each bound.

    """

    values: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    at_bound: NDArray[np.bool_]
    contradicted: NDArray[np.bool_]


def bounded(
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
    lowest: NDArray[np.float64],
    highest: NDArray[np.float64],
    freedom: float = np.inf,
) -> BoundedEstimate:
    """
    Move an estimate into its bounds.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Unconstrained.
    covariance : ndarray, shape (n, n)
        Of their errors; not finite on the diagonal where the data do not determine a parameter.
    lowest, highest : ndarray, shape (n,)
        Bounds; infinite where there is none.
    freedom : float
        Degrees of freedom that the size of `covariance` was estimated from; infinite where it is
        known.

    Returns
    -------
    BoundedEstimate

    Raises
    ------
    DataError
        If a lowest value is not less than the highest, or there are no degrees of freedom.

    """
    if not np.all(lowest < highest):
        wrong = int(np.flatnonzero(~(lowest < highest))[0])
        raise DataError(
            f'bounds of parameter {wrong}: lowest {lowest[wrong]}, highest {highest[wrong]}; '
            'the lowest must be less than the highest'
        )
    _check_freedom(freedom)
    result = BoundedEstimate(
        np.full(len(values), np.nan),
        lowest.astype(np.float64),
        highest.astype(np.float64),
        np.zeros(len(values), np.bool_),
        np.zeros(len(values), np.bool_),
    )
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(np.diagonal(covariance)))
    free, low, high = values[known], lowest[known], highest[known]
    block = covariance[np.ix_(known, known)]
    reach = _quantile(freedom) * np.sqrt(np.diagonal(block))
    nearest = _nearest(free, block, low, high)
    centre = np.clip(free, low, high)
    result.values[known] = nearest
    result.lower[known] = np.minimum(np.maximum(centre - reach, low), nearest)
    result.upper[known] = np.maximum(np.minimum(centre + reach, high), nearest)
    result.at_bound[known] = (nearest == low) | (nearest == high)
    result.contradicted[known] = (free + reach < low) | (free - reach > high)
    return result


def bounded_solution(
    information: Information, lowest: NDArray[np.float64], highest: NDArray[np.float64]
) -> BoundedEstimate:
    """
    Solve a regression with equal, independent residuals within bounds.

    Parameters
    ----------
    information : Information
        Of more rows than unknowns.
    lowest, highest : ndarray, shape (n,)
        Bounds; infinite where there is none.

    Returns
    -------
    BoundedEstimate

    Raises
    ------
    DataError
        If a lowest value is not less than the highest, or there are too few rows.

    """
    solution = information.solve()
    freedom = information.rows - information.size + solution.null_space.shape[1]
    _check_freedom(freedom)
    # No estimate is surer than the arithmetic behind it.
    covariance = solution.residual_squares / freedom * solution.inverse
    covariance += np.diag(solution.rounding**2)
    covariance[solution.free, :] = np.nan
    covariance[:, solution.free] = np.nan
    return bounded(solution.values, covariance, lowest, highest, freedom)


def _check_freedom(freedom: float) -> None:
    if not freedom > 0:
        raise DataError(f'degrees of freedom: {freedom}, expected more than 0; add data')


def _quantile(freedom: float) -> float:
    """Half length, in standard deviations, of an interval with the coverage."""
    # Student's law: freedom beyond this makes no difference.
    return float(stdtrit(min(freedom, 1e12), 0.5 + COVERAGE / 2))


def _nearest(
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
    lowest: NDArray[np.float64],
    highest: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Feasible point nearest to the values in the metric of the inverse covariance."""
    if np.all((lowest <= values) & (values <= highest)):
        return values
    deviation = np.sqrt(np.diagonal(covariance))
    # Without scatter the values are exact; the unit then only has to be a number.
    deviation = np.where(deviation > 0, deviation, np.finfo(float).eps * (1 + np.abs(values)))
    spread, turn = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    # As surely determined as double precision can tell; also where there is no scatter at all.
    floor = len(values) * np.finfo(float).eps * max(float(spread[-1]), 1.0)
    whiten = turn.T / np.sqrt(np.maximum(spread, floor))[:, np.newaxis]
    found = lsq_linear(
        whiten,
        np.zeros(len(values)),
        ((lowest - values) / deviation, (highest - values) / deviation),
        method='bvls',
        max_iter=100 * len(values),
    )
    nearest = np.clip(values + deviation * found.x, lowest, highest)
    nearest = np.where(found.active_mask < 0, lowest, nearest)
    result: NDArray[np.float64] = np.where(found.active_mask > 0, highest, nearest)
    return result
