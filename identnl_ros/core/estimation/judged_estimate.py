# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""From a fitted simulation to estimates that say how far to trust them."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.algebra.information import Solution
from identnl_ros.core.estimation.combinations import combination_estimates
from identnl_ros.core.estimation.estimate import (
    Estimate,
    EstimateStatus,
    IN_DOUBT,
    ParameterEstimate,
)
from identnl_ros.core.estimation.force_noise import ForceNoise
from identnl_ros.core.estimation.residual_statistics import QUIETEST, ResidualStatistics
from identnl_ros.core.mechanics.model import Parameter
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

# Chance that a complete model is doubted.
FALSE_ALARM_RATE = 0.01
# The noise in the samples may exceed the stated one by this factor, as rough as that often is.
LARGEST_NOISE = 1.5
# The power that force noise adds to a residual is narrow-banded and varies: so much is allowed.
FORCE_MARGIN = 1.5
# Power of the force noise in the residual over what it is in most stretches. A steady vibration
# stays below 3; where contacts open and the motion is unstable for a while, it is tens.
LARGEST_GROWTH = 10.0
NOT_HELD = 'The standard deviations do not hold.'
# Deviation of the noise from the stated one that is worth a remark.
NOTABLE_NOISE = 0.1


@dataclass(frozen=True)
class Verdict:
    """
    Whether the residual of a fit is sensor noise and nothing else.

    Parameters
    ----------
    variance : float
        Factor on the covariance that stated noise gives.
    doubt : str
        Why not, in a sentence; empty: nothing speaks against it.
    remark : str
        What else the residual shows; empty: nothing.

    """

    variance: float
    doubt: str
    remark: str


def verdict_on(
    statistics: ResidualStatistics,
    fitted: int,
    force_noise: ForceNoise,
    perfect: float | None = None,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> Verdict:
    """
    Judge the residual of a fit.

    Parameters
    ----------
    statistics : ResidualStatistics
        Of the residuals, in units of the stated noise.
    fitted : int
        Numbers that were fitted.
    force_noise : ForceNoise
        What noise of the measured force adds.
    perfect : float or None
        Of sensors that are stated to be without noise: the unit of the residuals over what the
        sensor shows; as much counts as arithmetic. None: the noise is stated.
    false_alarm_rate : float
        Chance that a complete model is doubted.

    Returns
    -------
    Verdict

    """
    known = statistics.noise[np.isfinite(statistics.noise)]
    noise = float(np.sqrt(np.mean(known**2))) if known.size else 1.0
    quietest = QUIETEST if perfect is None else 1.0
    excesses = {
        '': statistics.slow_excess(fitted, quietest),
        ', weighted with the motion,': statistics.moving_excess(fitted, quietest),
    }
    excesses = {of: one for of, one in excesses.items() if np.isfinite(one).all()}
    slow = []
    for of, (ratio, deviation) in excesses.items():
        # A mean of squares: chi squared with the degrees of freedom that give it its deviation.
        freedom = 2 / deviation**2
        limit = float(chi2.isf(false_alarm_rate / len(excesses), freedom)) / freedom
        limit += FORCE_MARGIN * force_noise.slow_share / noise**2
        if ratio > limit:
            slow.append(
                f'The slow part of the residual{of} has {ratio:.3g} times the power that sensor '
                f'noise explains (expected below {limit:.3g}): the model lacks something, or a '
                'gain, direction, delay or column in the layout is wrong.'
            )
    doubts, remark = [], ''
    said = f'The samples are {noise:.3g} times as noisy as the layout states.'
    if noise > LARGEST_NOISE:
        if perfect is not None:
            said = (
                'The layout states sensors without noise, but one shows noise of '
                f'{perfect * float(known.max()):.2g} of its motion: state the noise, or leave it '
                'out to have it estimated.'
            )
        doubts.append(said)
    elif abs(noise - 1) > NOTABLE_NOISE and perfect is None:
        remark = said
    doubts += slow[:1]
    if not doubts and force_noise.growth > LARGEST_GROWTH:
        doubts.append(
            f'Noise of the measured force grows for a while to {force_noise.growth:.3g} times its '
            'usual power in the motion, which is unstable there, as where contacts open: it may '
            'move the estimates further than a linearised motion tells. Excite less.'
        )
    doubt = ' '.join([*doubts, NOT_HELD]) if doubts else ''
    return Verdict(max(1.0, noise**2), doubt, '' if doubt else remark)


def judged_estimate(
    estimator: str,
    unknowns: Sequence[Parameter],
    values: NDArray[np.float64],
    solution: Solution,
    verdict: Verdict,
    samples: int,
    rejected: int,
    residual: float,
    force_noise: ForceNoise,
    failure: str = '',
    remarks: Sequence[str] = (),
) -> Estimate:
    """
    Turn what a fit has learned into estimates.

    Parameters
    ----------
    estimator : str
    unknowns : sequence of Parameter
    values : ndarray, shape (n_unknowns,)
        Best values [SI].
    solution : Solution
        Of the linearised fit, with rows of unit variance.
    verdict : Verdict
        On the residual.
    samples, rejected : int
        Instants used and left out.
    residual : float
        Root mean square of the residual over the stated noise [-].
    force_noise : ForceNoise
        What noise of the measured force adds to the variances.
    failure : str
        Why the fit has not converged; empty: it has.
    remarks : sequence of str
        Added to the notes.

    Returns
    -------
    Estimate

    """
    covariance = verdict.variance * solution.inverse + np.diag(solution.rounding**2)
    share = np.zeros(len(values))
    share[: len(force_noise.variance_share)] = force_noise.variance_share
    covariance *= np.sqrt(np.outer(1 + share, 1 + share))
    combinations = combination_estimates(
        solution.null_space, solution.free, [one.name for one in unknowns], values, covariance
    )
    covariance[solution.free, :] = np.nan
    covariance[:, solution.free] = np.nan
    if failure:
        covariance[:] = np.nan
    deviations = np.sqrt(np.diag(covariance))
    parameters = []
    for i, one in enumerate(unknowns):
        status, note = EstimateStatus.OK, ''
        value, deviation = float(values[i]), float(deviations[i])
        if solution.free[i]:
            value = deviation = float('nan')
            status = EstimateStatus.NOT_IDENTIFIABLE
            note = 'these data do not determine it by itself'
        elif failure:
            status, note = EstimateStatus.NOISE_LIMITED, 'a rough start, not converged'
        elif verdict.doubt:
            status, note = EstimateStatus.MODEL_IN_DOUBT, IN_DOUBT
        parameters.append(
            ParameterEstimate(one.name, one.symbol, one.unit, value, deviation, status, note)
        )
    notes = [
        f'The estimates have not converged: {failure}.' if failure else '',
        verdict.doubt,
        verdict.remark,
        *remarks,
        'Noise of the force sensors adds more to the errors than that of the sensors of motion.'
        if share.max(initial=0.0) > 1
        else '',
    ]
    return Estimate(
        estimator=estimator,
        parameters=tuple(parameters),
        covariance=covariance,
        samples=samples,
        rejected_samples=rejected,
        residual=residual,
        condition_number=solution.condition_number,
        combinations=combinations,
        notes=tuple(note for note in notes if note),
    )
