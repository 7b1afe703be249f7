# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Numbers inside an element that the machine's estimators take as known: limits of hysteresis.

The derivative of the residual by such a number is one more column of the regression, found from
two descriptions that differ in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import ChangedMachine, Hypothesis, Place
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.elements import Element, ELEMENT_KINDS
import numpy as np

# Largest relative change in a step; relative difference for derivatives.
LARGEST_STEP = 0.4
DIFFERENCE = 0.02


@dataclass(frozen=True)
class ChangedNumber(ChangedMachine):
    """
    One number inside an element, changed.

    Parameters
    ----------
    key : str
        Of the number.

    """

    key: str
    name = 'changed_number'
    title = 'a number'
    size_name = 'number'

    def unit(self, place: Place) -> str:
        """Give no unit: it is never told."""
        return '1'

    def places(self, description: Description) -> tuple[Place, ...]:
        """List nothing: it is not looked for by itself."""
        return ()

    def unit_size(self, description: Description, place: Place) -> float:
        """Give a small part of the number."""
        return DIFFERENCE * self._number(description, place)

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Add to the number."""
        element = description.joint(place.part)
        assert isinstance(element, Element)
        numbers = dict(element.numbers)
        numbers[self.key] = Coefficient(self._number(description, place) + size)
        return description.with_joint(replace(element, numbers=numbers))

    def _number(self, description: Description, place: Place) -> float:
        element = description.joint(place.part)
        assert isinstance(element, Element)
        return element.numbers[self.key].value


def numbers_to_fit(hypothesis: Hypothesis, description: Description) -> tuple[Hypothesis, ...]:
    """
    List what an effect has of numbers that are not estimated otherwise.

    Parameters
    ----------
    hypothesis : Hypothesis
        Of the effect.
    description : Description
        That has it.

    Returns
    -------
    tuple of Hypothesis
        A change of each.

    """
    part = hypothesis.effect.part_name(hypothesis.place)
    joint = next((one for one in description.machine.joints if one.name == part), None)
    if not isinstance(joint, Element):
        return ()
    return tuple(
        Hypothesis(ChangedNumber(one.key), Place(part))
        for one in ELEMENT_KINDS[joint.kind].inner
        if not one.estimable
    )


def number_of(change: Hypothesis, description: Description) -> float:
    """
    Read a number.

    Parameters
    ----------
    change : Hypothesis
        Of a `ChangedNumber`.
    description : Description

    Returns
    -------
    float

    """
    assert isinstance(change.effect, ChangedNumber)
    element = description.joint(change.place.part)
    assert isinstance(element, Element)
    return element.numbers[change.effect.key].value


def changed(change: Hypothesis, description: Description, step: float) -> Description:
    """
    Change a number, as far as its law allows and not too much at once.

    Parameters
    ----------
    change : Hypothesis
        Of a `ChangedNumber`.
    description : Description
    step : float

    Returns
    -------
    Description

    """
    assert isinstance(change.effect, ChangedNumber)
    element = description.joint(change.place.part)
    assert isinstance(element, Element)
    value = number_of(change, description)
    lowest = next(
        one.lowest for one in ELEMENT_KINDS[element.kind].inner if one.key == change.effect.key
    )
    largest = LARGEST_STEP * value
    wanted = value + float(np.clip(step, -largest, largest))
    return change.applied(description, max(wanted, lowest) - value)
