# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Find what a description of a stand lacks, step by step, or say that nothing known explains it.

Fit, test, locate, name, add, refit; again, until what is left is noise or nothing explains it.
A name is given only where everything that is left afterwards is noise, or nearly: what is outside
the library often resembles something in it a little.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum

from identnl_ros.core.discrepancy.contenders import chosen
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Effect, Hypothesis
from identnl_ros.core.discrepancy.evidence import Evidence
from identnl_ros.core.discrepancy.library import EFFECTS, hypotheses_about
from identnl_ros.core.discrepancy.machine_columns import with_numbers
from identnl_ros.core.discrepancy.named_effect import named_effect, NamedEffect
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.selection import Finding, Selection
from identnl_ros.core.discrepancy.settled_model import (
    settled,
    SettledModel,
    with_noise_anew,
)
from identnl_ros.core.discrepancy.tones import standing_out
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.model import Model
import numpy as np

MOST_FINDINGS = 5
# Share of the difference that may be left after so many findings; with more there is no hope
# that a few more explain it all.
HOPEFUL = (1.0, 0.9, 0.6, 0.3, 0.1)
# A difference (mean square over that of noise, less one) that is too small to have shares.
SMALL = 0.05
# Mean square of what is left, over that of noise, from which other start values are tried.
FAR_OFF = 100.0
# Share of what noise does not explain that may be left once effects are named, and the mean square
# of what is left over that of noise: names that leave more than that to explain are guesses.
UNEXPLAINED_SHARE = 0.02
UNEXPLAINED_EXCESS = 2.0


class Verdict(Enum):
    """What a diagnosis says."""

    COMPLETE = 'complete'
    EXPLAINED = 'explained'
    PARTLY_EXPLAINED = 'partly_explained'
    UNEXPLAINED = 'unexplained'


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
    threads: int = 1,
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
    threads : int
        That share the work; the result is the same to the last bit.

    Returns
    -------
    Diagnosis

    """
    generator = np.random.default_rng(seed)
    progress('fitting the model as it is')
    before = present = _first_fit(description, model, record)
    named: list[Finding] = []
    detectable: dict[str, tuple[str, float, str]] = {}
    while len(named) < MOST_FINDINGS and _is_hopeful(before, present, len(named)):
        progress(f'testing the library of effects, {len(named)} named')
        comparison = present.comparison
        evidence = with_numbers(Evidence(comparison), present.liberties.numbers)
        scale = replace(comparison.scale, frequencies=standing_out(evidence))
        hypotheses = hypotheses_about(
            present.description, scale, comparison.residual_ratios(), effects
        )
        selection = Selection(evidence, scale, hypotheses, generator, threads)
        null = selection.null_maxima()
        if not detectable:
            detectable = _detectable(selection, float(np.quantile(null, 0.99)))
        best = chosen(selection, null, present, record)
        if best is None:
            break
        finding, after = best
        present = with_noise_anew(after, reread(record, after.description.layout))
        named.append(finding)
    return _judged(before, present, named, detectable)


def _is_hopeful(before: SettledModel, present: SettledModel, findings: int) -> bool:
    whole, left = before.excess - 1, present.excess - 1
    return whole < SMALL or left <= HOPEFUL[findings] * whole


def _first_fit(description: Description, model: Model, record: MeasuredRecord) -> SettledModel:
    """Fit from the start values; from those of the description where that ends far off."""
    described = assemble(description.machine)
    other = described if np.isfinite(described.values).all() else None
    if other is not None:
        model = model.with_values(np.where(model.values > 0, model.values, other.values))
    try:
        fitted = settled(description, model, record)
    except MachineError:
        if other is None:
            raise
        return settled(description, other, record)
    if other is None or fitted.excess < FAR_OFF:
        return fitted
    with suppress(MachineError):
        return min(fitted, settled(description, other, record), key=lambda one: one.cost)
    return fitted


def _judged(
    before: SettledModel,
    after: SettledModel,
    named: list[Finding],
    detectable: dict[str, tuple[str, float, str]],
) -> Diagnosis:
    left = max(after.excess - 1, 0.0) / max(before.excess - 1, 1e-12)
    if after.is_noise:
        verdict = Verdict.EXPLAINED if named else Verdict.COMPLETE
    elif named and left < UNEXPLAINED_SHARE and after.excess < UNEXPLAINED_EXCESS:
        verdict = Verdict.PARTLY_EXPLAINED
    else:
        verdict = Verdict.UNEXPLAINED
    findings = _merged(named)
    vouched = verdict is not Verdict.UNEXPLAINED
    return Diagnosis(
        verdict,
        tuple(named_effect(finding, before, after) for finding in findings) if vouched else (),
        () if vouched else tuple(finding.hypothesis for finding in findings),
        before,
        after if vouched else before,
        detectable,
    )


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
