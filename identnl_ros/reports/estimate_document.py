# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""An estimate as a JSON document: SI units, null where there is no number."""

from collections.abc import Mapping
import math
from typing import Any

from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus


def estimate_document(estimate: Estimate, truth: Mapping[str, float]) -> dict[str, Any]:
    """
    Build the document of one identification.

    Parameters
    ----------
    estimate : Estimate
    truth : mapping of str to float
        True values by parameter name where they are known, SI.

    Returns
    -------
    dict
        Ready for json.dumps.

    """
    parameters = []
    for parameter in estimate.parameters:
        entry = {
            'name': parameter.name,
            'symbol': parameter.symbol,
            'unit': parameter.unit,
            'value': number(parameter.value),
            'standard_deviation': number(parameter.standard_deviation),
            'interval': [number(parameter.lower), number(parameter.upper)],
            'identifiable': parameter.status is not EstimateStatus.NOT_IDENTIFIABLE,
            'status': parameter.status.value,
        }
        if parameter.note:
            entry['note'] = parameter.note
        if parameter.name in truth:
            entry['true_value'] = number(truth[parameter.name])
        parameters.append(entry)
    return {
        'trusted': all(one.status is EstimateStatus.OK for one in estimate.parameters),
        'estimator': estimate.estimator,
        'parameters': parameters,
        'covariance': [[number(value) for value in row] for row in estimate.covariance.tolist()],
        'samples': estimate.samples,
        'rejected_samples': estimate.rejected_samples,
        'residual': number(estimate.residual),
        'condition_number': number(estimate.condition_number),
        'combinations': [
            {
                'combination': one.in_words,
                'value': number(one.value),
                'standard_deviation': number(one.standard_deviation),
            }
            for one in estimate.combinations
        ],
        'notes': list(estimate.notes),
    }


def number(value: float) -> float | None:
    """
    Make a number fit for JSON, which has neither NaN nor infinity.

    Parameters
    ----------
    value : float

    Returns
    -------
    float or None

    """
    return float(value) if math.isfinite(value) else None
