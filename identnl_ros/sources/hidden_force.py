# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Forces that no effect of the library is: what a diagnosis should leave unexplained."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effects.unmeasured_periodic_force import (
    UnmeasuredPeriodicForce,
)
from identnl_ros.core.errors import DataError
from identnl_ros.core.mechanics.machine import ExcitationPoint
from identnl_ros.core.simulation.excitation import Impulses, multisine, Signal, Sweep
import numpy as np

# Frequencies of forces that nobody measures [Hz]; time of a blow and of a sweep [s].
BAND = (20.0, 250.0)
PERIOD = 3.7
BLOW, BETWEEN_BLOWS = 2e-3, 0.17
SWEEP = 0.9

# By name: the force over time, by its amplitude [N].
FORCES: Mapping[str, Callable[[float, np.random.Generator], Signal]] = {
    'random_force': lambda amplitude, generator: multisine(amplitude, BAND, PERIOD, generator),
    'impacts': lambda amplitude, generator: Impulses(amplitude, BLOW, BETWEEN_BLOWS),
    'rising_tone': lambda amplitude, generator: Sweep(amplitude, BAND, SWEEP),
}


@dataclass(frozen=True)
class HiddenForce:
    """
    A force on a body that nobody measures.

    Parameters
    ----------
    name : str
        Of `FORCES`.
    label : str
        Where: body and axis of the machine frame.
    point : ExcitationPoint
        Where it acts.
    signal : Signal

    """

    name: str
    label: str
    point: ExcitationPoint
    signal: Signal

    def truth(self, description: Description) -> Description:
        """
        Describe the stand as it is.

        Parameters
        ----------
        description : Description
            As others are told.

        Returns
        -------
        Description
            With one more excitation, for which `signal` is.

        """
        machine = description.machine
        return replace(
            description, machine=replace(machine, excitations=(*machine.excitations, self.point))
        )


def hidden_force(
    name: str,
    place: str,
    amplitude: float,
    description: Description,
    generator: np.random.Generator,
) -> HiddenForce:
    """
    Make a force that nobody measures.

    Parameters
    ----------
    name : str
        Of `FORCES`.
    place : str
        Body and axis of the machine frame, e.g. ``knee.axis_2``; empty: one is drawn.
    amplitude : float
        [N].
    description : Description
    generator : numpy.random.Generator
        Draws the place and the phases.

    Returns
    -------
    HiddenForce

    Raises
    ------
    DataError
        If there is no such place.

    """
    places = {
        one.label: (description.body(one.part), np.eye(3)[one.axis - 1])
        for one in UnmeasuredPeriodicForce().places(description)
        if one.axis < 4
    }
    label = place or sorted(places)[int(generator.integers(len(places)))]
    if label not in places:
        raise DataError(f'--hide {name} cannot be at "{place}"; expected one of '
                        f'{", ".join(list(places)[:8])}')  # fmt: skip
    body, axis = places[label]
    point = ExcitationPoint(f'hidden_{name}_at_{label}', body.name, body.centre_of_mass, axis)
    return HiddenForce(name, label, point, FORCES[name](amplitude, generator))
