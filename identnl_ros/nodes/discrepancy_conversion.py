# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as a message."""

from collections.abc import Mapping
from math import nan
from typing import Any

from identnl_msgs.msg import Discrepancy, DiscrepancyReport, ParameterEstimate
from identnl_ros.nodes.conversions import to_header

# Standard deviations to either side of a 95 % interval.
NORMAL_95 = 1.959963984540054


def report_to_message(
    document: Mapping[str, Any], *, stand: str, stream_id: int, stamp: int
) -> DiscrepancyReport:
    """
    Make a message of a diagnosis.

    Parameters
    ----------
    document : mapping
        As `diagnosis_document` writes it, and the text of the corrected ``machine_file``.
    stand : str
        Name of the stand.
    stream_id : int
        Stream of the last sample used.
    stamp : int
        Acquisition clock at the last sample used [ns].

    Returns
    -------
    identnl_msgs.msg.DiscrepancyReport

    """
    held_out = {
        name: float(document['held_out'][name]['relative_force_error'])
        for name in ('before', 'after', 'noise_floor')
    }
    return DiscrepancyReport(
        header=to_header(stamp),
        stand=stand,
        stream_id=stream_id,
        verdict=getattr(DiscrepancyReport, f'VERDICT_{document["verdict"].upper()}'),
        findings=[_finding(one) for one in document['findings']],
        held_out_error_before=held_out['before'],
        held_out_error_after=held_out['after'],
        held_out_error_floor=held_out['noise_floor'],
        machine_file=document['machine_file'],
        sentence=document['summary'],
    )


def _finding(finding: Mapping[str, Any]) -> Discrepancy:
    return Discrepancy(
        effect=finding['effect'],
        location=finding['location'],
        parameters=[_parameter(one) for one in finding['parameters']],
        p_value=float(finding['p_value']),
        confusable_with=[
            f'{one["effect"]} at {one["location"]}' for one in finding['confusable_with']
        ],
        sentence=finding['sentence'],
    )


def _parameter(parameter: Mapping[str, Any]) -> ParameterEstimate:
    value, deviation = float(parameter['value']), parameter['standard_deviation']
    deviation = nan if deviation is None else float(deviation)
    return ParameterEstimate(
        name=parameter['name'],
        unit=parameter['unit'],
        value=value,
        standard_deviation=deviation,
        lower=value - NORMAL_95 * deviation,
        upper=value + NORMAL_95 * deviation,
        status=ParameterEstimate.STATUS_OK,
    )
