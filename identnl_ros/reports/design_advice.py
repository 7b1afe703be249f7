# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What to do, in a sentence: the plan to make and what stands in its way."""

from collections.abc import Iterable, Sequence

from identnl_ros.core.design.design import Expectation, ExpectedParameter, Outlook
from identnl_ros.core.design.plan import Plan
from identnl_ros.core.design.plan_search import Comparison
from identnl_ros.core.design.sensor_choice import SensorImportance, TOLERATED_GROWTH
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.reports.paper_units import paper_unit

# Sensors named one by one; of more only their number is told.
NAMED = 6


def plan_in_words(plan: Plan) -> str:
    """
    Describe a plan.

    Parameters
    ----------
    plan : Plan

    Returns
    -------
    str
        E.g. ``multisine 5-300 Hz, 100 daN, 2 s``.

    """
    return f'{force_in_words(plan)}, {time_in_words(plan.duration)}'


def force_in_words(plan: Plan) -> str:
    """
    Describe the force of a plan.

    Parameters
    ----------
    plan : Plan

    Returns
    -------
    str
        E.g. ``multisine 5-300 Hz, 100 daN``.

    """
    low, top = plan.band
    band = f'{top:g}' if low == top else f'{low:g}-{top:g}'
    return f'{plan.excitation} {band} Hz, {forces_in_words(plan.amplitudes.values())}'


def forces_in_words(forces: Iterable[float]) -> str:
    """
    Write one force, or several that differ.

    Parameters
    ----------
    forces : iterable of float
        [N].

    Returns
    -------
    str
        E.g. ``100 daN``.

    """
    unit = paper_unit('N')
    different = dict.fromkeys(f'{force / unit.size:.4g}' for force in forces)
    return f'{" and ".join(different)} {unit.name}'


def short_name(parameter: ExpectedParameter) -> str:
    """
    Name a parameter by its part and its symbol.

    Parameters
    ----------
    parameter : ExpectedParameter

    Returns
    -------
    str
        E.g. ``slideway_8 h_t``; with the axis where the part has several.

    """
    part, _, key = parameter.name.rpartition('.')
    last = key.rpartition('_')[2]
    return f'{part} {parameter.symbol}' + (f' ({last})' if last.isdigit() else '')


def time_in_words(seconds: float) -> str:
    """
    Write a duration.

    Parameters
    ----------
    seconds : float

    Returns
    -------
    str
        E.g. ``2 s``, ``12 min``, ``24 h``.

    """
    for size, name in ((3600.0, 'h'), (60.0, 'min')):
        if seconds >= 10 * size:
            return f'{seconds / size:.3g} {name}'
    return f'{seconds:.4g} s'


def percent(fraction: float) -> str:
    """
    Write a fraction.

    Parameters
    ----------
    fraction : float

    Returns
    -------
    str
        E.g. ``0.58 %``.

    """
    return f'{100 * fraction:.3g} %'


def advice_on_run(outlook: Outlook) -> str:
    """
    Sum up what one planned run would tell.

    Parameters
    ----------
    outlook : Outlook

    Returns
    -------
    str

    """
    plan = _capitalised(plan_in_words(outlook.plan))
    expected = outlook.expectation
    if expected.identifiable:
        return f'{plan}: every parameter is identifiable{_bottleneck(expected)}.'
    return f'{plan}: {_not_identifiable(expected)}'


def advice_on_comparison(comparison: Comparison) -> str:
    """
    Advise one plan for a wanted error, or say why there is none.

    Parameters
    ----------
    comparison : Comparison

    Returns
    -------
    str

    """
    best = comparison.best.outlook
    wanted = percent(comparison.wanted)
    plan = plan_in_words(best.plan)
    if not comparison.attainable:
        return (
            f'{wanted} cannot be attained with any of the plans compared, however long: '
            f'{_not_identifiable(best.expectation)}'
        )
    if not comparison.met:
        return (
            f'No plan compared brings every parameter under {wanted} within '
            f'{time_in_words(comparison.longest)}; {plan} would{_bottleneck(best.expectation)}.'
        )
    return f'{_capitalised(plan)}: every parameter under {wanted}{_bottleneck(best.expectation)}.'


def remarks(outlook: Outlook) -> list[str]:
    """
    Collect what bears on the trust in an outlook.

    Parameters
    ----------
    outlook : Outlook

    Returns
    -------
    list of str

    """
    found = [
        'The errors are the Cramer-Rao bound: no unbiased estimate does better, a '
        'maximum-likelihood fit comes up to it, the pointwise estimator does not. Forces are '
        'taken as exact, the noise as white and as stated, the machine as its file says.'
    ]
    opened = {name: times for name, times in outlook.relief.items() if times >= 1}
    if opened:
        most = max(opened.values())
        found.append(
            f'{", ".join(opened)}: the motion takes away up to {most:.2g} times the compression '
            'at rest. The nonlinear law is simulated beyond this point, but is least certain '
            f'there; about {forces_in_words(f / most for f in outlook.plan.amplitudes.values())} '
            'would stay below.'
        )
    if outlook.computed < outlook.plan.duration * (1 - 1e-9):
        found.append(
            f'Computed on {outlook.computed:.4g} s after {outlook.plan.settling:.4g} s of '
            'settling and scaled: information grows linearly with time.'
        )
    poor = [one for one in outlook.expectation.parameters if one.relative > 1]
    if poor:
        found.append(
            f'{", ".join(short_name(one) for one in poor)}: the expected error exceeds the value.'
        )
    zero = [one for one in outlook.expectation.parameters if one.identifiable and not one.value]
    if zero:
        found.append(
            f'{", ".join(short_name(one) for one in zero)}: a value of 0 has no relative error '
            'and is not judged by it.'
        )
    return found


def sensors_in_words(importances: Sequence[SensorImportance], layout: Layout) -> list[str]:
    """
    Say which sensors are needed and which are not.

    Parameters
    ----------
    importances : sequence of SensorImportance
        The most important first.
    layout : Layout

    Returns
    -------
    list of str

    """
    essential = [one for one in importances if one.essential]
    spared = [one for one in importances if one.spared]
    found = [f'Essential: {_listed(essential, layout)}.'] if essential else []
    if not essential and importances:
        found.append(
            'No single sensor is essential: without '
            f'{layout.sensors[importances[0].channel].name}, the most important one, the largest '
            f'error grows by {percent(importances[0].growth)}.'
        )
    if spared:
        kept = len(importances) - len(spared)
        longer = (1 + TOLERATED_GROWTH) ** 2 - 1
        found.append(
            f'{len(spared)} of {len(importances)} sensors of motion may be left out together for '
            f'at most {percent(TOLERATED_GROWTH)} more error, which a run {percent(longer)} '
            f'longer makes up for. The {kept} that remain: '
            + ', '.join(layout.sensors[one.channel].name for one in importances if not one.spared)
            + '.'
        )
    return found


def _listed(importances: Sequence[SensorImportance], layout: Layout) -> str:
    names = [layout.sensors[one.channel].name for one in importances]
    more = f' and {len(names) - NAMED} more' if len(names) > NAMED else ''
    return ', '.join(names[:NAMED]) + more


def _bottleneck(expected: Expectation) -> str:
    worst = expected.bottleneck
    return f'; bottleneck {short_name(worst)} ({percent(worst.relative)})' if worst else ''


def _not_identifiable(expected: Expectation) -> str:
    names = [one.name for one in expected.parameters if not one.identifiable]
    known = [one.in_words for one in expected.combinations]
    told = (
        f'only {" and ".join(known)} would be determined' if known else 'nothing of them would be'
    )
    return (
        f'{", ".join(names)} would not be identifiable, {told}. Make one of them known, tie it to '
        'another one (same_as), or excite and measure elsewhere.'
    )


def _capitalised(words: str) -> str:
    return words[:1].upper() + words[1:]
