# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A validation as a JSON document and as a table of traces: SI, null where there is no number."""

from collections.abc import Iterator
from typing import Any

from identnl_ros.core.validation.agreement import (
    Agreement,
    ChannelComparison,
    FALSE_ALARM_RATE,
    ScaleTest,
)
from identnl_ros.core.validation.validation import Traces
from identnl_ros.reports.estimate_document import number
import numpy as np

AGREES = 'agrees to the noise'
DIFFERS = 'differs'
NO_READING = 'no valid reading'


def validation_document(agreement: Agreement, stream_ids: tuple[int, ...]) -> dict[str, Any]:
    """
    Build the document of one validation.

    Parameters
    ----------
    agreement : Agreement
    stream_ids : tuple of int

    Returns
    -------
    dict
        Ready for json.dumps.

    """
    return {
        'verdict': AGREES if agreement.agrees else DIFFERS,
        'agrees': agreement.agrees,
        'false_alarm_rate': FALSE_ALARM_RATE,
        'tests': len(agreement.tests),
        'threshold': agreement.threshold,
        'streams': [
            {
                'stream_id': stream_id,
                'sample_rate': stream.sample_rate,
                'samples': stream.samples,
                'runs': stream.runs,
                'joint_verdict': DIFFERS if agreement.differs(stream.joint_tests) else AGREES,
                'joint_tests': [_test(one) for one in stream.joint_tests],
                'channels': [_channel(agreement, one) for one in stream.channels],
            }
            for stream_id, stream in zip(stream_ids, agreement.streams, strict=True)
        ],
    }


def verdict(agreement: Agreement, channel: ChannelComparison) -> str:
    """
    Put the verdict on a channel into words.

    Parameters
    ----------
    agreement : Agreement
    channel : ChannelComparison

    Returns
    -------
    str

    """
    if not channel.tests:
        return NO_READING
    return DIFFERS if agreement.differs(channel.tests) else AGREES


def trace_table(traces: Traces) -> Iterator[str]:
    """
    Write traces as CSV: time, then measurement, simulation and band of every channel.

    Parameters
    ----------
    traces : Traces

    Yields
    ------
    str
        Lines; nothing stands where there is no valid reading.

    """
    kinds = 'measured', 'simulated', 'band'
    names = [
        f'{name} {kind} [{unit}]'
        for name, unit in zip(traces.channels, traces.units, strict=True)
        for kind in kinds
    ]
    yield ','.join(['time [s]', *(_quoted(name) for name in names)]) + '\n'
    table = np.stack((traces.measured, traces.simulated, traces.band), axis=2)
    for time, row in zip(traces.time, table.reshape(len(table), -1), strict=True):
        cells = ('' if np.isnan(value) else f'{value:.9g}' for value in row)
        yield ','.join([f'{time:.9g}', *cells]) + '\n'


def _quoted(name: str) -> str:
    if any(sign in name for sign in ',"\n\r'):
        return '"' + name.replace('"', '""') + '"'
    return name


def _channel(agreement: Agreement, channel: ChannelComparison) -> dict[str, Any]:
    worst = channel.worst
    return {
        'name': channel.sensor.name,
        'kind': channel.sensor.kind.value,
        'unit': channel.sensor.kind.unit,
        'verdict': verdict(agreement, channel),
        'samples': channel.samples,
        'error': number(channel.error),
        'signal': number(channel.signal),
        'nrmse': number(channel.nrmse),
        'noise': number(channel.noise),
        'noise_stated': channel.noise_stated,
        'floor': number(channel.floor),
        'ratio': number(channel.ratio),
        'band': number(channel.band),
        'spread': number(channel.spread),
        'expected': number(channel.expected),
        'worst_test': None if worst is None else _test(worst),
        'tests': [_test(one) for one in channel.tests],
    }


def _test(test: ScaleTest) -> dict[str, Any]:
    return {
        'average': test.average,
        'beyond_band': test.beyond_band,
        'ratio': number(test.ratio),
        'probability': number(test.probability),
    }
