# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as a JSON document and in sentences."""

from math import isfinite
from typing import Any

from identnl_ros.core.discrepancy.checked_diagnosis import CheckedDiagnosis
from identnl_ros.core.discrepancy.diagnosis import Verdict
from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.named_effect import NamedEffect
from identnl_ros.reports.paper_units import readable_unit
from identnl_ros.reports.splitting_test import splitting_test


def diagnosis_document(result: CheckedDiagnosis) -> dict[str, Any]:
    """
    Write a diagnosis as plain data.

    Parameters
    ----------
    result : CheckedDiagnosis

    Returns
    -------
    dict
        SI units.

    """
    diagnosis = result.diagnosis
    return {
        'verdict': diagnosis.verdict.value,
        'summary': summary(result),
        'findings': [_finding(one) for one in diagnosis.named],
        'suspected': [_named(one) for one in diagnosis.suspected],
        'held_out': {
            'before': {
                'response_nrmse': result.before.response,
                'relative_force_error': result.before.force.relative,
            },
            'after': {
                'response_nrmse': result.after.response,
                'relative_force_error': result.after.force.relative,
            },
            'noise_floor': {
                'response_nrmse': result.after.noise_floor,
                'relative_force_error': result.after.force.noise_floor,
            },
            'samples': result.held_out_samples,
        },
        'residual_over_noise': {
            'before': float(diagnosis.before.excess**0.5),
            'after': float(diagnosis.after.excess**0.5),
        },
        'detectable_size': {
            name: {'location': place, 'size': size, 'unit': unit}
            for name, (place, size, unit) in diagnosis.detectable.items()
        },
        'samples': result.samples,
        'sample_rate': result.sample_rate,
    }


def summary(result: CheckedDiagnosis) -> str:
    """
    Say what was found in one paragraph.

    Parameters
    ----------
    result : CheckedDiagnosis

    Returns
    -------
    str

    """
    diagnosis = result.diagnosis
    floor = f'{100 * result.after.noise_floor:.3g} %'
    gap = (
        f'Held-out error falls from {100 * result.before.response:.3g} % to '
        f'{100 * result.after.response:.3g} %; sensor noise alone is {floor}.'
    )
    same = (
        f'Held-out error is {100 * result.before.response:.3g} %; sensor noise alone is {floor}.'
    )
    match diagnosis.verdict:
        case Verdict.COMPLETE:
            return f'Nothing is missing that these data could show. {same}'
        case Verdict.UNEXPLAINED:
            return (
                'Simulation and measurement differ, and no known effect explains it: '
                f'unexplained.{_resembles(diagnosis.suspected)} {same}'
            )
        case Verdict.EXPLAINED:
            return f'{_sentences(diagnosis.named)} {gap}'
        case Verdict.PARTLY_EXPLAINED:
            return (
                f'{_sentences(diagnosis.named)} {gap} A small part of the difference remains '
                'unexplained.'
            )


def sentence(named: NamedEffect) -> str:
    """
    Say what is missing, where, and how much of it.

    Parameters
    ----------
    named : NamedEffect

    Returns
    -------
    str

    """
    hypothesis = named.hypothesis
    effect, place = hypothesis.effect, hypothesis.place
    unit = readable_unit(effect.unit(place), named.size)
    name = '' if unit.name == '1' else f' {unit.name}'
    size = f'{named.size / unit.size:.4g} ± {named.deviation / unit.size:.2g}{name}'
    rivals = named.finding.rivals
    doubt = ''
    if rivals:
        others = ', '.join(f'{one.effect.title} ({one.place.words})' for one in rivals[:3])
        doubt = f' These data do not tell it from {others}.'
    return f'At {place.words}, {effect.title} of {size} is missing.{doubt}'


def _sentences(named: tuple[NamedEffect, ...]) -> str:
    return ' '.join(sentence(one) for one in named)


def _resembles(suspected: tuple[Hypothesis, ...]) -> str:
    if not suspected:
        return ''
    first = suspected[0]
    return f' It looks most like {first.effect.title} at {first.place.words}.'


def _named(hypothesis: Hypothesis) -> dict[str, Any]:
    return {'effect': hypothesis.effect.name, 'location': hypothesis.place.label}


def _finding(named: NamedEffect) -> dict[str, Any]:
    hypothesis = named.hypothesis
    effect = hypothesis.effect
    return {
        **_named(hypothesis),
        'parameters': [
            {
                'name': effect.size_name,
                'unit': effect.unit(hypothesis.place),
                'value': named.size,
                'standard_deviation': named.deviation,
            },
            *(
                {
                    'name': one.name,
                    'unit': one.unit,
                    'value': one.value,
                    'standard_deviation': one.deviation if isfinite(one.deviation) else None,
                }
                for one in named.inner
            ),
        ],
        'p_value': named.finding.probability,
        'confusable_with': [
            {**_named(one), 'split_by': splitting_test(hypothesis, one)}
            for one in named.finding.rivals
        ],
        'sentence': sentence(named),
    }
