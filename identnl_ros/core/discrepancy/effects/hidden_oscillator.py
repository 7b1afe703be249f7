# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A flexible mode: a small mass on a spring and a damper, whose own motion no sensor sees."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from identnl_ros.core.discrepancy.circumstances import Course, Scale
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import AddedForce, Place, Reals
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.joints import SpringDamper
from identnl_ros.core.mechanics.kinematics import axes_of
from identnl_ros.core.mechanics.machine import Body
import numpy as np
from scipy.signal import cont2discrete, lfilter

FREQUENCY = 'frequency'
DAMPING_RATIO = 'damping_ratio'

# Excited band of a machine whose file tells none [Hz].
BAND = (5.0, 500.0)
# Frequencies are tried from this much below the excited band to this much above it.
BEYOND = 2**0.5
FREQUENCIES = 16
# So large that a mode between two frequencies of the grid is seen.
DAMPING_RATIOS = (0.06,)
# Ratio of frequencies, and damping ratios, where one is looked for more closely.
FINE_STEP = 1.04
FINE_DAMPING_RATIOS = (0.005, 0.02, 0.07)


class HiddenOscillator(AddedForce):
    """A mass on a spring and a damper along an axis of the machine frame, at a body's centre."""

    name = 'hidden_oscillator'
    title = 'a flexible mode'
    size_name = 'mass'
    sign = 1
    inner_units: ClassVar[Mapping[str, str]] = {FREQUENCY: 'Hz', DAMPING_RATIO: '1'}

    def unit(self, place: Place) -> str:
        """Give the SI unit of its size."""
        return 'kg'

    def inner_unit(self, name: str, place: Place) -> str:
        """Give the SI unit of an inner parameter."""
        return self.inner_units[name]

    def places(self, description: Description) -> Sequence[Place]:
        """List the axes of the machine frame along which bodies move, oscillators left out."""
        return [
            Place(body.name, axis, words=f'{body.name}, along {"xyz"[axis - 1]}')
            for body in description.machine.bodies
            if not body.name.startswith(f'{self.name}_at_')
            for axis in (1, 2, 3)
            if _moves(body, axis)
        ]

    def variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """List frequencies in and about the excited band."""
        return _grid(np.geomspace(*_range(description), FREQUENCIES), DAMPING_RATIOS)

    def finer_variants(
        self, description: Description, place: Place, scale: Scale
    ) -> Sequence[Mapping[str, float]]:
        """List frequencies so close that a fit finds a lightly damped resonance from one."""
        lowest, highest = _range(description)
        count = int(np.ceil(np.log(highest / lowest) / np.log(FINE_STEP))) + 1
        return _grid(np.geomspace(lowest, highest, count), FINE_DAMPING_RATIOS)

    def force(
        self, course: Course, place: Place, inner: Mapping[str, float]
    ) -> tuple[Reals, Reals]:
        """Give the force of spring and damper per mass; the oscillator rests at the begin."""
        axis = np.eye(3)[place.axis - 1]
        machine = course.description.machine
        centre = course.description.body(place.part).centre_of_mass
        direction = course.model.motion_of_point(place.part, centre, axis)
        series = _reaction(
            course.acceleration @ direction,
            float(course.time[1] - course.time[0]),
            inner[FREQUENCY],
            inner[DAMPING_RATIO],
        )
        if machine.gravity is not None:
            series = series + axis @ machine.gravity
        return series, direction

    def applied(
        self, description: Description, place: Place, inner: Mapping[str, float], size: float
    ) -> Description:
        """Add a body and its spring and damper, all to be estimated."""
        host = description.body(place.part)
        name = self.part_name(place)
        rate = 2 * np.pi * inner[FREQUENCY]
        mass = Body(
            name, Coefficient(size, estimated=True), host.centre_of_mass, None,
            (f'translation_{place.axis}',),
        )  # fmt: skip
        none = (Coefficient(0.0),) * (place.axis - 1)
        spring = SpringDamper(
            self._spring_name(place), name, host.name, host.centre_of_mass,
            stiffness=(*none, Coefficient(size * rate**2, estimated=True)),
            damping=(*none, Coefficient(2 * inner[DAMPING_RATIO] * size * rate, estimated=True)),
        )  # fmt: skip
        return description.with_body(mass).with_joint(spring)

    def fitted_inner(
        self, place: Place, inner: Mapping[str, float], values: Mapping[str, float]
    ) -> Mapping[str, float]:
        """Find frequency and damping ratio from mass, stiffness and damping."""
        spring = self._spring_name(place)
        mass = values[f'{self.part_name(place)}.mass']
        # A list of one number has no indices.
        end = '' if place.axis == 1 else f'_{place.axis}'
        stiffness, damping = (values[f'{spring}.{key}{end}'] for key in ('stiffness', 'damping'))
        if stiffness <= 0:
            return inner  # nothing that oscillates
        rate = np.sqrt(stiffness / mass)
        ratio = damping / (2 * mass * rate)
        return {FREQUENCY: float(rate / (2 * np.pi)), DAMPING_RATIO: float(ratio)}

    def _spring_name(self, place: Place) -> str:
        return f'{self.part_name(place)}_spring'

    def hidden_in(self, description: Description, place: Place) -> bool:
        """Tell whether there is one already: its mass, spring and damper are unknown."""
        return any(body.name == self.part_name(place) for body in description.machine.bodies)


def _range(description: Description) -> tuple[float, float]:
    """Find the lowest and the highest frequency to try [Hz]."""
    bands = [one.band for one in description.machine.excitations] or [BAND]
    lowest, highest = min(band[0] for band in bands), max(band[1] for band in bands)
    return lowest / BEYOND, highest * BEYOND


def _grid(frequencies: Reals, damping_ratios: Sequence[float]) -> Sequence[Mapping[str, float]]:
    return tuple(
        {FREQUENCY: float(frequency), DAMPING_RATIO: ratio}
        for frequency in frequencies
        for ratio in damping_ratios
    )


def _moves(body: Body, axis: int) -> bool:
    _, axes = axes_of(body)
    shares = [
        abs(axes[axis - 1, i])
        for i in range(3)
        if f'translation_{i + 1}' in body.degrees_of_freedom
    ]
    return max(shares, default=0.0) > 1e-6


def _reaction(
    acceleration: Reals, interval: float, frequency: float, damping_ratio: float
) -> Reals:
    """
    Filter the acceleration of the foot of an oscillator.

    ``y'' + 2 zeta omega y' + omega^2 y = -a``; the force on the foot per mass is
    ``2 zeta omega y' + omega^2 y``. Exact where the acceleration is straight between samples.
    """
    rate = 2 * np.pi * frequency
    numerator = np.array([2 * damping_ratio * rate, rate**2])
    denominator = np.array([1.0, *numerator])
    discrete = cont2discrete((numerator, denominator), interval, 'foh')
    return np.asarray(lfilter(discrete[0].ravel(), discrete[1], -acceleration))
