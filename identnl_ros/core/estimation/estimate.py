# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What an identification returns: parameters with covariance, status and remarks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import isnan

import numpy as np
from numpy.typing import NDArray

NORMAL_QUANTILE = 1.959963984540054  # of 97.5 %
IN_DOUBT = 'its standard deviation does not hold'


class EstimateStatus(Enum):
    """
    How far an estimate may be trusted.

    The order of members is that of the STATUS_ constants of ParameterEstimate.msg.

    """

    UNKNOWN = 'unknown'
    OK = 'ok'
    NOT_IDENTIFIABLE = 'not_identifiable'
    NOISE_LIMITED = 'noise_limited'
    MODEL_IN_DOUBT = 'model_in_doubt'


@dataclass(frozen=True)
class ParameterEstimate:
    """
    Estimate of one parameter.

    Parameters
    ----------
    name : str
        E.g. ``slideway_6.normal_stiffness``.
    symbol : str
        Symbol of the literature, e.g. ``a_n``.
    unit : str
        SI unit of `value`.
    value : float
        NaN when the data do not determine it.
    standard_deviation : float
        In `unit`; NaN when the data do not determine it.
    status : EstimateStatus
    note : str
        For people: why the status is not OK.
    lower, upper : float
        95 % confidence interval; made from value and standard deviation where not given.

    """

    name: str
    symbol: str
    unit: str
    value: float
    standard_deviation: float
    status: EstimateStatus
    note: str = ''
    lower: float = float('nan')
    upper: float = float('nan')

    def __post_init__(self) -> None:
        """Complete the interval."""
        if isnan(self.lower) and isnan(self.upper):
            reach = NORMAL_QUANTILE * self.standard_deviation
            object.__setattr__(self, 'lower', self.value - reach)
            object.__setattr__(self, 'upper', self.value + reach)


@dataclass(frozen=True)
class CombinationEstimate:
    """
    Estimate of a sum of parameters that are not determined one by one.

    Parameters
    ----------
    in_words : str
        E.g. ``slideway_8.normal_damping + slideway_9.normal_damping``.
    value, standard_deviation : float
        SI, of the sum as written; NaN where not known.

    """

    in_words: str
    value: float = float('nan')
    standard_deviation: float = float('nan')


@dataclass(frozen=True)
class Estimate:
    """
    Estimates of all unknown parameters of a machine.

    Parameters
    ----------
    estimator : str
        Name of the method.
    parameters : tuple of ParameterEstimate
    covariance : ndarray, shape (n_parameters, n_parameters)
        SI units; rows and columns of parameters without a value are NaN.
    samples : int
        Instants used.
    rejected_samples : int
        Instants left out: no valid measurement, borders of gaps.
    residual : float
        Norm of the residual over the norm of the known side of the regression [-].
    condition_number : float
        Of the column-scaled regression [-].
    combinations : tuple of CombinationEstimate
        What is determined where single parameters are not.
    notes : tuple of str
        Remarks that bear on trust, in sentences.

    """

    estimator: str
    parameters: tuple[ParameterEstimate, ...]
    covariance: NDArray[np.float64]
    samples: int
    rejected_samples: int
    residual: float
    condition_number: float
    combinations: tuple[CombinationEstimate, ...] = ()
    notes: tuple[str, ...] = ()

    def doubted(self, reasons: Sequence[str]) -> 'Estimate':
        """
        Withdraw trust for what is known of the data from elsewhere.

        Parameters
        ----------
        reasons : sequence of str
            In sentences; none: nothing changes.

        Returns
        -------
        Estimate
            What has a value is in doubt.

        """
        if not reasons:
            return self
        trusted = EstimateStatus.OK, EstimateStatus.NOISE_LIMITED
        parameters = tuple(
            replace(one, status=EstimateStatus.MODEL_IN_DOUBT, note=one.note or IN_DOUBT)
            if one.status in trusted
            else one
            for one in self.parameters
        )
        return replace(self, parameters=parameters, notes=(*self.notes, *reasons))

    def noted(self, remarks: Sequence[str]) -> 'Estimate':
        """
        Add what bears on trust but withdraws none.

        Parameters
        ----------
        remarks : sequence of str
            In sentences.

        Returns
        -------
        Estimate

        """
        return replace(self, notes=(*self.notes, *remarks))
