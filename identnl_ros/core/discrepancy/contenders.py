# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Fit the foremost hypotheses in full and choose among them."""

from dataclasses import replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.inner_fit import fitted_fault, fitted_numbers
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.selection import Finding, SAME, Selection
from identnl_ros.core.discrepancy.settled_model import settled, SettledModel, start_of
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
import numpy as np
from numpy.typing import NDArray

# Hypotheses that are fitted in full before one is chosen, and the share of the leader's gain that
# they need.
CONTENDERS = 3
CLOSE = 0.9


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
    improved = [one for one in found if one[1].cost < present.cost]
    least = min((one[1].cost for one in improved), default=0.0)
    return next((one for one in improved if one[1].cost < least + SAME), None)


def _refined(finding: Finding, selection: Selection, present: SettledModel) -> Finding:
    """Look for better inner parameters where the effect has been found."""
    effect, place = finding.hypothesis.effect, finding.hypothesis.place
    finer = effect.finer_variants(present.description, place, selection.scale)
    if not finer:
        return finding
    hypotheses = [Hypothesis(effect, place, inner) for inner in finer]
    closer = Selection(selection.evidence, selection.scale, hypotheses, selection.generator)
    best = closer.best(np.zeros(1))
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
    description = finding.hypothesis.applied(present.description, finding.size)
    known = {one.name: one.value for one in present.model.parameters}
    model = start_of(description, _carried(known, description, present.description))
    # All contenders are judged by the same noise.
    noise = present.comparison.deviation
    read = reread(record, description.layout)
    after = settled(description, model, read, noise=noise)
    if description.machine is present.description.machine:
        return fitted_fault(after, record, finding)
    if not after.is_noise:
        after = fitted_numbers(after, read, finding.hypothesis)
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
