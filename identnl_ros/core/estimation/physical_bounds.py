# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Estimates within what physics allows: stiffness, damping, mass and preload are not negative."""

from dataclasses import replace

from identnl_ros.core.algebra.bounds import bounded
from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus
import numpy as np

# Symbols of quantities that cannot be negative; a quadratic or cubic stiffness, a constant force
# and what is unknown of a sensor can.
NOT_NEGATIVE = ('a_n', 'a_t', 'h_n', 'h_t', 'c_n', 'c_t', 'k', 'c', 'm', 'delta_0')


def within_physical_bounds(estimate: Estimate) -> Estimate:
    """
    Move an estimate to the most likely one that physics allows.

    Parameters
    ----------
    estimate : Estimate

    Returns
    -------
    Estimate
        Values at bounds say so in their notes; intervals end at the bounds; standard deviations
        are those of the unbounded estimate.

    """
    values = np.array([one.value for one in estimate.parameters])
    lowest = np.array(
        [0.0 if one.symbol in NOT_NEGATIVE else -np.inf for one in estimate.parameters]
    )
    if not np.isfinite(np.diag(estimate.covariance)).any():
        return estimate
    found = bounded(values, estimate.covariance, lowest, np.full(len(values), np.inf))
    parameters = []
    for i, one in enumerate(estimate.parameters):
        if np.isnan(found.values[i]):
            parameters.append(one)
            continue
        note, status = one.note, one.status
        if found.contradicted[i]:
            note = 'the data contradict that it is not negative'
            status = EstimateStatus.MODEL_IN_DOUBT
        elif found.at_bound[i]:
            note = '; '.join(filter(None, (note, 'at its bound: physics allows no less')))
        parameters.append(
            replace(
                one,
                value=float(found.values[i]),
                lower=float(found.lower[i]),
                upper=float(found.upper[i]),
                status=status,
                note=note,
            )
        )
    return replace(estimate, parameters=tuple(parameters))
