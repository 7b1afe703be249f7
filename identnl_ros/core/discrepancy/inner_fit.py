# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Fit what an effect brings along that is no unknown of the machine.

Limits of hysteresis, which the machine's estimators take as known, and sizes of faults of sensors.
The derivative of the residual by such a number is one more column of the regression; a step of it
and steps of everything else take turns.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Hypothesis, Place
from identnl_ros.core.discrepancy.evidence import Evidence
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.selection import Finding, Selection
from identnl_ros.core.discrepancy.settled_model import settled, SettledModel, start_of
from identnl_ros.core.errors import MachineError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.elements import Element, ELEMENT_KINDS
import numpy as np

STEPS = 4
# Largest relative change in a step; relative difference for derivatives.
LARGEST_STEP = 0.4
DIFFERENCE = 0.02
# A step of this many standard deviations is the last.
SMALL_STEP = 0.3


@dataclass(frozen=True)
class _ChangedNumber(ChangedMachine):
    """One number inside an element, changed."""

    key: str
    name = 'changed_number'
    title = 'a number'
    size_name = 'number'

    def unit(self, place: Place) -> str:
        return '1'

    def places(self, description: Description) -> tuple[Place, ...]:
        return ()

    def unit_size(self, description: Description, place: Place) -> float:
        return DIFFERENCE * self._number(description, place)

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        element = description.joint(place.part)
        assert isinstance(element, Element)
        numbers = dict(element.numbers)
        numbers[self.key] = Coefficient(self._number(description, place) + size)
        return description.with_joint(replace(element, numbers=numbers))

    def _number(self, description: Description, place: Place) -> float:
        element = description.joint(place.part)
        assert isinstance(element, Element)
        return element.numbers[self.key].value


def fitted_numbers(
    start: SettledModel, record: MeasuredRecord, hypothesis: Hypothesis
) -> SettledModel:
    """
    Fit what an effect has of numbers that are not estimated otherwise.

    Parameters
    ----------
    start : SettledModel
        With the effect.
    record : MeasuredRecord
    hypothesis : Hypothesis
        Of the effect.

    Returns
    -------
    SettledModel
        As good as the start or better.

    """
    part = hypothesis.effect.part_name(hypothesis.place)
    joint = next((one for one in start.description.machine.joints if one.name == part), None)
    if not isinstance(joint, Element):
        return start
    best = start
    kept = [one.key for one in ELEMENT_KINDS[joint.kind].inner if not one.estimable]
    for key in kept:
        best = _fitted(best, record, Hypothesis(_ChangedNumber(key), Place(part)))
    return best


def fitted_fault(
    start: SettledModel, record: MeasuredRecord, finding: Finding
) -> tuple[Finding, SettledModel]:
    """
    Fit the size of a fault, of a sensor or of a force cell.

    Parameters
    ----------
    start : SettledModel
        With the fault taken into account.
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
                best.state, noise=comparison.deviation,
            )  # fmt: skip
        except MachineError:
            break
        if after.cost >= best.cost:
            break
        best = after
        finding = replace(finding, size=finding.size + float(size), deviation=float(deviation))
    return finding, best


def _fitted(start: SettledModel, record: MeasuredRecord, change: Hypothesis) -> SettledModel:
    best = start
    assert isinstance(change.effect, _ChangedNumber)
    for _ in range(STEPS):
        comparison = best.comparison
        selection = Selection(
            Evidence(comparison), comparison.scale, [change], np.random.default_rng(0)
        )
        (size,), (deviation,) = selection.sizes()
        if not np.isfinite(deviation) or abs(size) < SMALL_STEP * deviation:
            break
        largest = LARGEST_STEP * change.effect.unit_size(best.description, change.place)
        largest /= DIFFERENCE
        description = change.applied(best.description, float(np.clip(size, -largest, largest)))
        values = {one.name: one.value for one in best.model.parameters}
        try:
            after = settled(
                description, start_of(description, values), record, best.state,
                noise=comparison.deviation,
            )  # fmt: skip
        except MachineError:
            break
        if after.cost >= best.cost:
            break
        best = after
    return best
