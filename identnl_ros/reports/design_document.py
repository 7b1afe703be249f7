# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A planned run as a JSON document: SI units, null where there is no number."""

from collections.abc import Sequence
from typing import Any

from identnl_ros.core.design.design import Outlook
from identnl_ros.core.design.plan import Plan
from identnl_ros.core.design.plan_search import Comparison
from identnl_ros.core.design.sensor_choice import SensorImportance
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.reports.design_advice import (
    advice_on_comparison,
    advice_on_run,
    remarks,
    sensors_in_words,
)
from identnl_ros.reports.estimate_document import number


def design_document(
    outlook: Outlook,
    layout: Layout,
    importances: Sequence[SensorImportance],
    comparison: Comparison | None = None,
) -> dict[str, Any]:
    """
    Build the document of a planned run.

    Parameters
    ----------
    outlook : Outlook
    layout : Layout
    importances : sequence of SensorImportance
    comparison : Comparison or None
        That the plan is the best of.

    Returns
    -------
    dict
        Ready for json.dumps.

    """
    expected = outlook.expectation
    return {
        'plan': _plan(outlook.plan)
        | {
            'peak_forces': outlook.plan.peak_forces(),
            'computed': outlook.computed,
            'relief': outlook.relief,
        },
        'wanted_error': None if comparison is None else comparison.wanted,
        'parameters': [
            {
                'name': one.name,
                'symbol': one.symbol,
                'unit': one.unit,
                'value': number(one.value),
                'expected_standard_deviation': number(one.standard_deviation),
                'relative': number(one.relative),
                'identifiable': one.identifiable,
            }
            for one in expected.parameters
        ],
        'combinations': [one.in_words for one in expected.combinations],
        'condition_number': number(expected.condition_number),
        'plans': [] if comparison is None else _plans(comparison),
        'sensors': [
            {
                'name': layout.sensors[one.channel].name,
                'kind': layout.sensors[one.channel].kind.value,
                'growth_without': number(one.growth),
                'essential': one.essential,
                'may_be_left_out': one.spared,
            }
            for one in importances
        ],
        'advice': advice_on_run(outlook)
        if comparison is None
        else advice_on_comparison(comparison),
        'remarks': [
            *remarks(outlook),
            *sensors_in_words(importances, layout),
            *(() if comparison is None else comparison.failures),
        ],
    }


def _plan(plan: Plan) -> dict[str, Any]:
    return {
        'excitation': plan.excitation,
        'amplitudes': dict(plan.amplitudes),
        'band': list(plan.band),
        'cycle': plan.cycle,
        'duration': plan.duration,
        'settling': plan.settling,
        'sample_rate': plan.sample_rate,
    }


def _plans(comparison: Comparison) -> list[dict[str, Any]]:
    entries = []
    for one in comparison.candidates:
        outlook = one.outlook
        expected = outlook.expectation
        entries.append(
            _plan(outlook.plan)
            | {
                'duration': number(one.needed),
                'duration_computed': outlook.computed,
                'worst_after_1_s': number(expected.repeated(1 / outlook.plan.duration).worst),
                'bottleneck': expected.bottleneck.name if expected.bottleneck else None,
                'identifiable': expected.identifiable,
                'largest_relief': max(outlook.relief.values(), default=None),
                'advisable': outlook.plan.advisable,
                'advised': one is comparison.best,
            }
        )
    return entries
