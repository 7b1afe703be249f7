# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Fit the foremost hypotheses in full and choose among them."""

from dataclasses import replace

from identnl_ros.core.discrepancy.changed_number import numbers_to_fit
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.selection import Finding, SAME, Selection
from identnl_ros.core.discrepancy.settled_model import (
    Liberties,
    settled,
    SettledModel,
    start_of,
)
from identnl_ros.core.discrepancy.size_fit import fitted_size
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
import numpy as np
from numpy.typing import NDArray

# Hypotheses that are fitted in full before one is chosen, and the share of the leader's gain that
# they need.
CONTENDERS = 3
CLOSE = 0.9
# By which one more number to fit must lower the sum of squares.
PER_NUMBER = 8.0


def chosen(
    selection: Selection,
    null: NDArray[np.float64],
    present: SettledModel,
    record: MeasuredRecord,
) -> tuple[Finding, SettledModel] | None:
    """
    Fit the foremost hypotheses in full; the one that leaves least is chosen.

    Parameters
    ----------
    selection : Selection
    null : ndarray
        Draws of the largest score.
    present : SettledModel
        Without any of them.
    record : MeasuredRecord

    Returns
    -------
    (Finding, SettledModel) or None
        None: nothing is significant, or nothing makes the fit better.

    """
    found: list[tuple[Finding, SettledModel]] = []
    excluded: list[tuple[str, str]] = []
    leader: Finding | None = None
    for _ in range(CONTENDERS):
        finding = selection.best(null, excluded)
        if finding is None or (leader is not None and finding.gain < CLOSE * leader.gain):
            break
        leader = leader or finding
        excluded += [finding.hypothesis.key, *selection.equals_of(finding)]
        finding = _refined(finding, selection, present)
        try:
            finding, after = _with(present, finding, record)
        except MachineError:
            continue  # no machine that could have this effect, or could not be simulated
        found.append((finding, after))
        others = {one.key for one in finding.rivals} - set(excluded)
        if after.is_noise and len(found) == 1 and not others:
            break
    improved = [one for one in found if _price(one[1]) < _price(present)]
    least = min((_price(after) for _, after in improved), default=0.0)
    return next((one for one in improved if _price(one[1]) < least + SAME), None)


def _price(after: SettledModel) -> float:
    """Of models that leave the same, the one with fewer numbers is the better one."""
    numbers = len(after.deviations) + len(after.number_deviations)
    return after.cost + PER_NUMBER * numbers


def _refined(finding: Finding, selection: Selection, present: SettledModel) -> Finding:
    """Look for better inner parameters where the effect has been found."""
    effect, place = finding.hypothesis.effect, finding.hypothesis.place
    finer = effect.finer_variants(present.description, place, selection.scale)
    if not finer:
        return finding
    hypotheses = [Hypothesis(effect, place, inner) for inner in finer]
    closer = Selection(selection.evidence, selection.scale, hypotheses, selection.generator)
    best = closer.best(None)
    if best is None or best.gain < finding.gain:
        return finding
    return replace(
        finding, hypothesis=best.hypothesis, size=best.size, deviation=best.deviation,
        gain=best.gain,
    )  # fmt: skip


def _with(
    present: SettledModel, finding: Finding, record: MeasuredRecord
) -> tuple[Finding, SettledModel]:
    """Add an effect and fit everything anew."""
    hypothesis = finding.hypothesis
    description = hypothesis.applied(present.description, finding.size)
    known = {one.name: one.value for one in present.model.parameters}
    model = start_of(description, _carried(known, description, present.description))
    either_sign, numbers = present.liberties.either_sign, present.liberties.numbers
    if hypothesis.effect.sign == 0:
        either_sign |= {hypothesis.effect.part_name(hypothesis.place)}
    liberties = Liberties(either_sign, (*numbers, *numbers_to_fit(hypothesis, description)))
    # All contenders are judged by the same noise.
    noise = present.comparison.deviation
    read = reread(record, description.layout)
    after = settled(description, model, read, noise=noise, liberties=liberties)
    if len(model.estimated) == len(present.model.estimated):
        return fitted_size(after, record, finding)
    return finding, after


def _carried(
    known: dict[str, float], description: Description, before: Description
) -> dict[str, float]:
    """Carry fitted values over, but those that the effect itself has changed."""
    old = {one.name: one.value for one in assemble(before.machine).parameters}
    return {
        one.name: known[one.name]
        for one in assemble(description.machine).parameters
        if one.name in known and (one.value == old[one.name] or np.isnan(one.value))
    }
