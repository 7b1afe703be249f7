# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What may be missing in a model: the interface of an effect, and the kinds of it.

An effect is a class that says where it can live, what shapes it can have there, and how a
description of a stand looks that has it. Everything else follows from that: the simulation that
hides it, the regressor that looks for it, the machine file that has it.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from identnl_ros.core.discrepancy.circumstances import Course, Scale, Signals
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.joints import Joint
from identnl_ros.core.mechanics.machine import ConstantForce
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """
    Where an effect acts.

    Parameters
    ----------
    part : str
        Joint, body or sensor; of two sensors, the first.
    axis : int
        From 1: axis of a joint or of the machine frame; 0: the part as a whole.
    other : str
        Second sensor.
    words : str
        For people.
    unit : str
        SI unit of the readings of a sensor.

    """

    part: str
    axis: int = 0
    other: str = ''
    words: str = ''
    unit: str = ''

    @property
    def label(self) -> str:
        """As in files, e.g. ``slideway_8.axis_2``."""
        label = f'{self.part}+{self.other}' if self.other else self.part
        return f'{label}.axis_{self.axis}' if self.axis else label


class Effect(ABC):
    """Something that a description of a stand may lack."""

    name: ClassVar[str]
    """Identifier in files and options."""
    title: ClassVar[str]
    """For people, e.g. ``Coulomb friction``."""
    size_name: ClassVar[str]
    """What its size is called in the machine or layout file."""
    sign: ClassVar[int] = 0
    """1: only a positive size is physical; 0: either."""

    @abstractmethod
    def unit(self, place: Place) -> str:
        """
        Give the SI unit of its size.

        Parameters
        ----------
        place : Place

        Returns
        -------
        str

        """

    @abstractmethod
    def places(self, description: Description) -> Sequence[Place]:
        """
        List where it can live.

        Parameters
        ----------
        description : Description

        Returns
        -------
        sequence of Place

        """

    def variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """
        List the inner parameters to try.

        Parameters
        ----------
        description : Description
        place : Place
        scale : Scale

        Returns
        -------
        sequence of mapping of str to float
            SI; empty mappings where it has no inner parameter.

        """
        return ({},)

    def finer_variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """
        List inner parameters to try where the effect has been found, before it is fitted.

        Parameters
        ----------
        description : Description
        place : Place
        scale : Scale

        Returns
        -------
        sequence of mapping of str to float
            Empty where a fit finds its way from any of `variants`.

        """
        return ()

    def inner_unit(self, name: str, place: Place) -> str:
        """
        Give the SI unit of an inner parameter.

        Parameters
        ----------
        name : str
        place : Place

        Returns
        -------
        str

        """
        raise KeyError(name)

    def fitted_inner(
        self, place: Place, inner: Mapping[str, float], values: Mapping[str, float]
    ) -> Mapping[str, float]:
        """
        Read its inner parameters off a machine that has it.

        Parameters
        ----------
        place : Place
        inner : mapping of str to float
            As tried: what the machine has no parameter for remains.
        values : mapping of str to float
            Of the machine's parameters, by name [SI].

        Returns
        -------
        mapping of str to float
            By the names in `inner`.

        """
        part = self.part_name(place)
        return {name: values.get(f'{part}.{name}', tried) for name, tried in inner.items()}

    def fitted_size(
        self, place: Place, fitted: Mapping[str, tuple[float, float]]
    ) -> tuple[float, float] | None:
        """
        Read its size off a machine that has it.

        Parameters
        ----------
        place : Place
        fitted : mapping of str to (float, float)
            Estimates and their standard deviations, by name [SI].

        Returns
        -------
        (float, float) or None
            None: the machine has no parameter for it.

        """
        wanted = f'{self.part_name(place)}.{self.size_name}'
        return next((one for name, one in fitted.items() if name.startswith(wanted)), None)

    @abstractmethod
    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """
        Describe the stand that has it.

        Parameters
        ----------
        description : Description
        place : Place
        inner : mapping of str to float
        size : float
            SI.

        Returns
        -------
        Description
            Where its size is a coefficient of the machine, that is to be estimated.

        """

    def admits(self, size: float, deviation: float) -> bool:
        """
        Tell whether it can have a size.

        Parameters
        ----------
        size, deviation : float
            Estimate and its standard deviation.

        Returns
        -------
        bool

        """
        return self.sign == 0 or size > 0

    def hidden_in(self, description: Description, place: Place) -> bool:
        """
        Tell whether the description has unknowns that stand for the same.

        Parameters
        ----------
        description : Description
        place : Place

        Returns
        -------
        bool

        """
        return False

    def part_name(self, place: Place) -> str:
        """
        Name the part of the machine that it adds.

        Parameters
        ----------
        place : Place

        Returns
        -------
        str

        """
        return f'{self.name}_at_{place.part}' + (f'_{place.axis}' if place.axis else '')


class AddedPart(Effect):
    """An effect that is a further joint or force, proportional to one coefficient."""

    @abstractmethod
    def part(
        self,
        description: Description,
        place: Place,
        inner: Mapping[str, float],
        coefficient: Coefficient,
        name: str,
    ) -> Joint | ConstantForce:
        """
        Make the part.

        Parameters
        ----------
        description : Description
        place : Place
        inner : mapping of str to float
        coefficient : Coefficient
            Its size.
        name : str

        Returns
        -------
        Joint or ConstantForce

        """

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Add the part, its size to be estimated."""
        part = self.part(
            description, place, inner, Coefficient(size, estimated=True), self.part_name(place)
        )
        if isinstance(part, ConstantForce):
            return description.with_force(part)
        return description.with_joint(part)


class ChangedMachine(Effect):
    """An effect that changes numbers of the machine, whose forces change in proportion."""

    @abstractmethod
    def unit_size(self, description: Description, place: Place) -> float:
        """
        Give a size that is small and in which the forces are still linear.

        Parameters
        ----------
        description : Description
        place : Place

        Returns
        -------
        float

        """


class AddedForce(Effect):
    """An effect whose force along a motion is a series of numbers times a fixed direction."""

    @abstractmethod
    def force(
        self, course: Course, place: Place, inner: Mapping[str, float]
    ) -> tuple[Reals, Reals]:
        """
        Give the generalised force that it adds, per unit of its size.

        Parameters
        ----------
        course : Course
        place : Place
        inner : mapping of str to float

        Returns
        -------
        series : ndarray, shape (n_samples,)
        direction : ndarray, shape (n_coordinates,)
            The force on the right-hand side of the equations of motion is ``series`` times
            ``direction`` [N, N m per unit].

        """


class SensorFault(Effect):
    """An effect of the measurement: what a sensor reads is not what the layout says."""

    @abstractmethod
    def deviation(self, signals: Signals, place: Place) -> Mapping[str, Reals]:
        """
        Give what it adds to readings.

        Parameters
        ----------
        signals : Signals
        place : Place

        Returns
        -------
        mapping of str to ndarray, shape (n_samples,)
            Per unit of its size, of the sensors concerned [SI unit].

        """


@dataclass(frozen=True)
class Hypothesis:
    """
    An effect at a place with its inner parameters.

    Parameters
    ----------
    effect : Effect
    place : Place
    inner : mapping of str to float

    """

    effect: Effect
    place: Place
    inner: Mapping[str, float] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, str]:
        """What is told apart from others: effect and place."""
        return self.effect.name, self.place.label

    def applied(self, description: Description, size: float) -> Description:
        """
        Describe the stand that has it.

        Parameters
        ----------
        description : Description
        size : float

        Returns
        -------
        Description

        """
        return self.effect.applied(description, self.place, self.inner, size)
