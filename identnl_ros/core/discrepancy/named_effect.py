# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""An effect that was missing, with its size and inner parameters as fitted in the end."""

from dataclasses import dataclass

from identnl_ros.core.discrepancy.changed_number import ChangedNumber, number_of
from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.selection import Finding
from identnl_ros.core.discrepancy.settled_model import SettledModel


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
    inner: tuple[InnerValue, ...] = ()

    @property
    def hypothesis(self) -> Hypothesis:
        """Effect, place and inner parameters."""
        return self.finding.hypothesis


def named_effect(finding: Finding, before: SettledModel, after: SettledModel) -> NamedEffect:
    """
    Read size and inner parameters off the last fit, where they are parameters of the machine.

    Parameters
    ----------
    finding : Finding
    before, after : SettledModel
        Without any effect named, with all.

    Returns
    -------
    NamedEffect

    """
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
    numbers = dict(effect.fitted_inner(place, hypothesis.inner, values))
    for change, deviation in zip(after.liberties.numbers, after.number_deviations, strict=True):
        if change.place.part == prefix and isinstance(change.effect, ChangedNumber):
            key = change.effect.key
            numbers[key] = number_of(change, after.description)
            fitted[f'{prefix}.{key}'] = numbers[key], float(deviation)
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
