# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Find what a description of a stand lacks, step by step, or say that nothing known explains it.

Fit, test, locate, name, add, refit; again, until what is left is noise or nothing explains it.
A name is given only where everything that is left afterwards is noise, or nearly: what is outside
the library often resembles something in it a little.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Effect, Hypothesis
from identnl_ros.core.discrepancy.evidence import Evidence
from identnl_ros.core.discrepancy.library import EFFECTS, hypotheses_about
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.selection import Finding, SAME, Selection
from identnl_ros.core.discrepancy.settled_model import (
    settled,
    SettledModel,
    start_of,
    with_noise_anew,
)
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

MOST_FINDINGS = 5
# Share of what noise does not explain that may be left once effects are named.
UNEXPLAINED_SHARE = 0.02
# Hypotheses that are fitted in full before one is chosen, and the share of the leader's gain that
# they need.
CONTENDERS = 3
CLOSE = 0.9


class Verdict(Enum):
    """What a diagnosis says."""

    COMPLETE = 'complete'
    EXPLAINED = 'explained'
    PARTLY_EXPLAINED = 'partly_explained'
    UNEXPLAINED = 'unexplained'


@dataclass(frozen=True)
class NamedEffect:
    """
    An effect that was missing.

    Parameters
    ----------
    finding : Finding
        As it was chosen.
    size, deviation : float
        After everything was fitted anew [SI].
    inner : tuple of InnerValue
        Its inner parameters.

    """

    finding: Finding
    size: float
    deviation: float
    inner: tuple['InnerValue', ...] = ()

    @property
    def hypothesis(self) -> Hypothesis:
        """Effect, place and inner parameters."""
        return self.finding.hypothesis


@dataclass(frozen=True)
class InnerValue:
    """
    An inner parameter of an effect that was named.

    Parameters
    ----------
    name, unit : str
    value : float
        [SI].
    deviation : float
        NaN: it was not fitted, only the best of those tried.

    """

    name: str
    unit: str
    value: float
    deviation: float


@dataclass(frozen=True)
class Diagnosis:
    """
    Result of a diagnosis.

    Parameters
    ----------
    verdict : Verdict
    named : tuple of NamedEffect
        In the order of adding.
    suspected : tuple of Hypothesis
        What resembles an unexplained difference most; names that are not vouched for.
    before, after : SettledModel
        The model as given and with the effects, both fitted.
    detectable : dict of str to (str, float, str)
        Per effect: where it could be seen best, the smallest size that this record would have
        shown (with a probability of one half), its unit.

    """

    verdict: Verdict
    named: tuple[NamedEffect, ...]
    suspected: tuple[Hypothesis, ...]
    before: SettledModel
    after: SettledModel
    detectable: dict[str, tuple[str, float, str]]


def diagnose(
    description: Description,
    model: Model,
    record: MeasuredRecord,
    seed: int = 0,
    effects: Sequence[Effect] = EFFECTS,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """
    Diagnose a record.

    Parameters
    ----------
    description : Description
        As believed; its layout is that of the record.
    model : Model
        Assembled from its machine; its values are where the fit starts.
    record : MeasuredRecord
    seed : int
        Of the draws of noise.
    effects : sequence of Effect
        That may be named.
    progress : callable
        Is told what goes on, in words.

    Returns
    -------
    Diagnosis

    """
    generator = np.random.default_rng(seed)
    progress('fitting the model as it is')
    before = present = settled(description, model, record)
    named: list[Finding] = []
    detectable: dict[str, tuple[str, float, str]] = {}
    while len(named) < MOST_FINDINGS:
        progress(f'testing the library of effects, {len(named)} named')
        comparison = present.comparison
        hypotheses = hypotheses_about(
            present.description, comparison.scale, comparison.residual_ratios(), effects
        )
        selection = Selection(Evidence(comparison), hypotheses, generator)
        null = selection.null_maxima()
        if not detectable:
            detectable = _detectable(selection, float(np.quantile(null, 0.99)))
        chosen = _chosen(selection, null, present, record)
        if chosen is None:
            break
        finding, after = chosen
        present = with_noise_anew(after, reread(record, after.description.layout))
        named.append(finding)
    return _judged(before, present, named, detectable)


def _chosen(
    selection: Selection, null: NDArray[np.float64], present: SettledModel, record: MeasuredRecord
) -> tuple[Finding, SettledModel] | None:
    """Fit the foremost hypotheses in full; the one that leaves least is chosen."""
    found: list[tuple[Finding, SettledModel]] = []
    excluded: list[tuple[str, str]] = []
    while len(found) < CONTENDERS:
        finding = selection.best(null, excluded)
        if finding is None or (found and finding.gain < CLOSE * found[0][0].gain):
            break
        excluded.append(finding.hypothesis.key)
        after = _with(present, finding, record)
        found.append((finding, after))
        if after.is_noise and len(found) == 1 and not finding.rivals:
            break
    improved = [one for one in found if one[1].cost < present.cost]
    least = min((one[1].cost for one in improved), default=0.0)
    return next((one for one in improved if one[1].cost < least + SAME), None)


def _with(present: SettledModel, finding: Finding, record: MeasuredRecord) -> SettledModel:
    """Add an effect and fit everything anew."""
    description = finding.hypothesis.applied(present.description, finding.size)
    known = {one.name: one.value for one in present.model.parameters}
    model = start_of(description, _carried(known, description, present.description))
    # All contenders are judged by the same noise.
    noise = present.comparison.deviation
    return settled(description, model, reread(record, description.layout), noise=noise)


def _carried(
    known: dict[str, float], description: Description, before: Description
) -> dict[str, float]:
    """Carry fitted values over, but those that the effect itself has changed."""
    old = {one.name: one for one in assemble(before.machine).parameters}
    return {
        one.name: known[one.name]
        for one in assemble(description.machine).parameters
        if one.name in known and one.value == old[one.name].value
    }


def _judged(
    before: SettledModel,
    after: SettledModel,
    named: list[Finding],
    detectable: dict[str, tuple[str, float, str]],
) -> Diagnosis:
    left = max(after.excess - 1, 0.0) / max(before.excess - 1, 1e-12)
    if after.is_noise:
        verdict = Verdict.EXPLAINED if named else Verdict.COMPLETE
    elif named and left < UNEXPLAINED_SHARE:
        verdict = Verdict.PARTLY_EXPLAINED
    else:
        verdict = Verdict.UNEXPLAINED
    findings = _merged(named)
    vouched = verdict is not Verdict.UNEXPLAINED
    return Diagnosis(
        verdict,
        tuple(_final(finding, before, after) for finding in findings) if vouched else (),
        () if vouched else tuple(finding.hypothesis for finding in findings),
        before,
        after if vouched else before,
        detectable,
    )


def _final(finding: Finding, before: SettledModel, after: SettledModel) -> NamedEffect:
    """Read the size off the last fit, where it is a parameter of the machine."""
    hypothesis = finding.hypothesis
    effect, place = hypothesis.effect, hypothesis.place
    known = {before.model.parameters[i].name for i in before.model.estimated}
    given = {one.name: one.value for one in before.model.parameters}
    fitted = _fitted(after)
    changed = f'{place.part}.{effect.size_name}'
    inner = _inner(hypothesis, after)
    size = effect.fitted_size(place, fitted)
    if size is not None:
        return NamedEffect(finding, *size, inner)
    if changed in fitted and changed not in known:
        value, deviation = fitted[changed]
        return NamedEffect(finding, value - _described(before, changed, given), deviation)
    return NamedEffect(finding, finding.size, finding.deviation, inner)


def _fitted(settled: SettledModel) -> dict[str, tuple[float, float]]:
    """Collect estimates and their standard deviations by name."""
    return {
        settled.model.parameters[index].name: (
            settled.model.parameters[index].value,
            float(deviation),
        )
        for index, deviation in zip(settled.model.estimated, settled.deviations, strict=True)
    }


def _inner(hypothesis: Hypothesis, after: SettledModel) -> tuple[InnerValue, ...]:
    """Read inner parameters off the last fit, as far as it fitted them."""
    effect, place = hypothesis.effect, hypothesis.place
    prefix = effect.part_name(place)
    fitted = _fitted(after)
    values = {one.name: one.value for one in after.model.parameters}
    numbers = effect.fitted_inner(place, hypothesis.inner, values)
    return tuple(
        InnerValue(
            name,
            effect.inner_unit(name, place),
            float(value),
            fitted.get(f'{prefix}.{name}', (0.0, float('nan')))[1],
        )
        for name, value in numbers.items()
    )


def _described(before: SettledModel, name: str, given: dict[str, float]) -> float:
    """Find the value of a number that the description had."""
    if name in given:
        return given[name]
    part, key = name.split('.')
    return float(getattr(before.description.joint(part), key).value)


def _merged(named: list[Finding]) -> list[Finding]:
    """Put together what was found of one effect in several steps."""
    merged: dict[tuple[str, str], Finding] = {}
    for one in named:
        key = one.hypothesis.key
        if key in merged:
            first = merged[key]
            one = replace(first, size=first.size + one.size, deviation=one.deviation)
        merged[key] = one
    return list(merged.values())


def _detectable(selection: Selection, limit: float) -> dict[str, tuple[str, float, str]]:
    _, deviations = selection.sizes()
    result: dict[str, tuple[str, float, str]] = {}
    for one, deviation in zip(selection.hypotheses, deviations, strict=True):
        size = limit * float(deviation)
        name = one.effect.name
        if np.isfinite(size) and (name not in result or size < result[name][1]):
            result[name] = one.place.label, size, one.effect.unit(one.place)
    return result
