# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
The size of an effect that is no unknown of the machine: of faults of sensors, of inertia.

A step of it and steps of everything else take turns.
"""

from dataclasses import replace

from identnl_ros.core.discrepancy.evidence import Evidence
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.selection import Finding, Selection
from identnl_ros.core.discrepancy.settled_model import settled, SettledModel, start_of
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
import numpy as np

STEPS = 4
# A step of this many standard deviations is the last.
SMALL_STEP = 0.3


def fitted_size(
    start: SettledModel, record: MeasuredRecord, finding: Finding
) -> tuple[Finding, SettledModel]:
    """
    Fit the size of an effect that changes numbers which the machine takes as known.

    Parameters
    ----------
    start : SettledModel
        With the effect.
    record : MeasuredRecord
        As it was read before.
    finding : Finding
        With its size as taken into account.

    Returns
    -------
    Finding, SettledModel
        With the final size; as good as the start or better.

    """
    hypothesis = finding.hypothesis
    best = start
    for _ in range(STEPS):
        comparison = best.comparison
        selection = Selection(
            Evidence(comparison), comparison.scale, [hypothesis], np.random.default_rng(0)
        )
        (size,), (deviation,) = selection.sizes()
        if not np.isfinite(deviation) or abs(size) < SMALL_STEP * deviation:
            break
        if not hypothesis.effect.admits(float(size), float(deviation)):
            break
        description = hypothesis.applied(best.description, float(size))
        values = {one.name: one.value for one in best.model.parameters}
        try:
            after = settled(
                description, start_of(description, values), reread(record, description.layout),
                best.state, noise=comparison.deviation, liberties=best.liberties,
            )  # fmt: skip
        except MachineError:
            break
        if after.cost >= best.cost:
            break
        best = after
        finding = replace(finding, size=finding.size + float(size), deviation=float(deviation))
    return finding, best
