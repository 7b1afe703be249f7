# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A harmonic force on a body that nobody measures: an unbalance, a pump, the mains."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from identnl_ros.core.discrepancy.circumstances import Course, Scale
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import AddedForce, Place, Reals
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.kinematics import body_motion, Coordinate
from identnl_ros.core.mechanics.machine import Body
from identnl_ros.core.mechanics.periodic_force import FREQUENCY, PeriodicForce, Wave
import numpy as np

PHASE = 'phase'
# So close that one of them explains 93 % of a wave of any phase.
PHASES = tuple(np.arange(6) * np.pi / 6)
FINER_PHASES = tuple(np.arange(48) * np.pi / 48)
# A body does not move where its displacement per unit of every coordinate is this small.
STILL = 1e-9


class UnmeasuredPeriodicForce(AddedForce):
    """A force ``cos(2 pi frequency t + phase)`` along or about an axis of the machine frame."""

    name = 'periodic_force'
    title = 'a periodic force'
    size_name = 'amplitude'
    units: ClassVar[tuple[str, str]] = ('N', 'N m')
    inner_units: ClassVar[Mapping[str, str]] = {FREQUENCY: 'Hz', PHASE: 'rad'}

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return self.units[place.axis > 3]

    def inner_unit(self, name: str, place: Place) -> str:
        """Give the SI unit of an inner parameter."""
        return self.inner_units[name]

    def places(self, description: Description) -> Sequence[Place]:
        """List the axes of the machine frame along and about which bodies move."""
        return [
            Place(body.name, axis, words=_words(body, axis))
            for body in description.machine.bodies
            for axis in range(1, 7)
            if np.abs(_motion(description, body)[axis - 1]).max() > STILL
        ]

    def variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """List the frequencies found in the residual, each with several phases."""
        return _waves(scale, PHASES)

    def finer_variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """List more phases."""
        return _waves(scale, FINER_PHASES)

    def force(
        self, course: Course, place: Place, inner: Mapping[str, float]
    ) -> tuple[Reals, Reals]:
        """Give the wave, and the force or moment on the body."""
        wave = Wave(inner[FREQUENCY], inner[PHASE])
        description = course.description
        direction = _motion(description, description.body(place.part))[place.axis - 1]
        return wave.at(course.time), direction

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Add the force, its amplitudes and its frequency to be estimated."""
        body = description.body(place.part)
        return description.with_force(
            PeriodicForce(
                self.part_name(place),
                body.name,
                body.centre_of_mass,
                np.eye(3)[(place.axis - 1) % 3],
                Coefficient(size * np.cos(inner[PHASE]), estimated=True),
                Coefficient(-size * np.sin(inner[PHASE]), estimated=True),
                # Without a force there is no frequency to estimate.
                Coefficient(inner[FREQUENCY], estimated=size != 0),
                moment=place.axis > 3,
            )
        )

    def fitted_size(
        self, place: Place, fitted: Mapping[str, tuple[float, float]]
    ) -> tuple[float, float] | None:
        """Find the amplitude from its two parts."""
        part = self.part_name(place)
        cosine, sine = fitted[f'{part}.cosine'], fitted[f'{part}.sine']
        amplitude = np.hypot(cosine[0], sine[0])
        # To first order, their covariance left out: it is small over whole periods.
        deviation = np.hypot(cosine[0] * cosine[1], sine[0] * sine[1]) / amplitude
        return float(amplitude), float(deviation)

    def hidden_in(self, description: Description, place: Place) -> bool:
        """Tell whether there is one already: its amplitudes and its frequency are unknown."""
        return any(one.name == self.part_name(place) for one in description.machine.forces)


def _waves(scale: Scale, phases: Sequence[float]) -> Sequence[Mapping[str, float]]:
    return tuple(
        {FREQUENCY: frequency, PHASE: float(phase)}
        for frequency in scale.frequencies
        for phase in phases
    )


def _motion(description: Description, body: Body) -> Reals:
    """Motion of a body's centre of mass along and about the axes from q, shape (6, n)."""
    machine = description.machine
    coordinates = tuple(
        Coordinate(one.name, motion) for one in machine.bodies for motion in one.degrees_of_freedom
    )
    return body_motion(machine, coordinates, body.name, body.centre_of_mass)


def _words(body: Body, axis: int) -> str:
    return f'{body.name}, {"along" if axis < 4 else "about"} {"xyz"[(axis - 1) % 3]}'
