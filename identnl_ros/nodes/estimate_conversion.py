# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Estimates as messages and back, to the last bit."""

from identnl_msgs.msg import (
    DeterminedCombination,
    ParameterEstimate as ParameterEstimateMessage,
    ParameterEstimateArray,
)
from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.estimate import (
    CombinationEstimate,
    Estimate,
    EstimateStatus,
    ParameterEstimate,
)
from identnl_ros.nodes.conversions import doubles, to_header
import numpy as np

_STATUS_NUMBERS = {
    status: getattr(ParameterEstimateMessage, f'STATUS_{status.name}') for status in EstimateStatus
}
_STATUSES = {number: status for status, number in _STATUS_NUMBERS.items()}


def estimate_to_message(
    estimate: Estimate,
    *,
    stand: str,
    stream_id: int,
    stamp: int,
    last_index: int,
    stream_ended: bool,
) -> ParameterEstimateArray:
    """
    Make a message of an estimate.

    Parameters
    ----------
    estimate : Estimate
    stand : str
        Name of the stand.
    stream_id : int
        Stream of the last sample used.
    stamp : int
        Acquisition clock at the last sample used [ns].
    last_index : int
        Running index of the last sample seen.
    stream_ended : bool
        The estimate uses all of the stream.

    Returns
    -------
    identnl_msgs.msg.ParameterEstimateArray

    """
    return ParameterEstimateArray(
        header=to_header(stamp),
        stand=stand,
        stream_id=stream_id,
        estimator=estimate.estimator,
        parameters=[_parameter_to_message(parameter) for parameter in estimate.parameters],
        covariance=doubles(estimate.covariance),
        samples_used=estimate.samples,
        samples_rejected=estimate.rejected_samples,
        last_sample_index=last_index,
        residual=estimate.residual,
        condition_number=estimate.condition_number,
        combinations=[
            DeterminedCombination(
                in_words=one.in_words,
                value=one.value,
                standard_deviation=one.standard_deviation,
            )
            for one in estimate.combinations
        ],
        notes=list(estimate.notes),
        stream_ended=stream_ended,
    )


def estimate_from_message(message: ParameterEstimateArray) -> Estimate:
    """
    Make an estimate from a message.

    Parameters
    ----------
    message : identnl_msgs.msg.ParameterEstimateArray

    Returns
    -------
    Estimate

    Raises
    ------
    DataError
        If the message contradicts itself.

    """
    where = f'estimate at sample {message.last_sample_index}'
    size = len(message.parameters)
    if len(message.covariance) != size**2:
        raise DataError(
            f'{where}: {len(message.covariance)} covariances of {size} parameters, '
            f'expected {size**2}; the message is damaged'
        )
    return Estimate(
        estimator=message.estimator,
        parameters=tuple(_parameter_from_message(item, where) for item in message.parameters),
        covariance=np.array(message.covariance, np.float64).reshape(size, size),
        samples=message.samples_used,
        rejected_samples=message.samples_rejected,
        residual=message.residual,
        condition_number=message.condition_number,
        combinations=tuple(
            CombinationEstimate(one.in_words, one.value, one.standard_deviation)
            for one in message.combinations
        ),
        notes=tuple(message.notes),
    )


def _parameter_to_message(parameter: ParameterEstimate) -> ParameterEstimateMessage:
    return ParameterEstimateMessage(
        name=parameter.name,
        symbol=parameter.symbol,
        unit=parameter.unit,
        value=parameter.value,
        standard_deviation=parameter.standard_deviation,
        lower=parameter.lower,
        upper=parameter.upper,
        status=_STATUS_NUMBERS[parameter.status],
        note=parameter.note,
    )


def _parameter_from_message(message: ParameterEstimateMessage, where: str) -> ParameterEstimate:
    if message.status not in _STATUSES:
        raise DataError(
            f'{where}: the status of {message.name} is {message.status}, '
            f'expected one of {sorted(_STATUSES)}'
        )
    return ParameterEstimate(
        name=message.name,
        symbol=message.symbol,
        unit=message.unit,
        value=message.value,
        standard_deviation=message.standard_deviation,
        status=_STATUSES[message.status],
        note=message.note,
        lower=message.lower,
        upper=message.upper,
    )
