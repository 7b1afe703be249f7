# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What may be wrong in machine or layout, each a single number: alternatives to "all is as stated".

What each would do to the simulated motion or to the readings is one more column of the linearised
fit. Whether the residual has a share of it is the score, or Lagrange multiplier, test (Rao 1948,
Proceedings of the Cambridge Philosophical Society 44, 50-57).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from identnl_ros.core.measurement.stencils import stencil
from identnl_ros.core.mechanics.kinematics import Coordinate
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

KINDS = ('displacement', 'velocity', 'acceleration')
# Errors of ordinary size: of a gain, a mass or an inertia; of a delay [s].
ORDINARY_SHARE = 0.01
ORDINARY_DELAY = 25e-6
HALF_WIDTH = 8


@dataclass(frozen=True)
class Course:
    """
    A stretch of the simulation, with the instant that follows it.

    Parameters
    ----------
    model : Model
    motion : ndarray, shape (n_samples + 1, 3, n_coordinates)
        Displacement, velocity, acceleration.
    force : ndarray, shape (n_samples + 1, n_excitations)
        Measured force [N].
    force_slope : ndarray, shape (n_samples + 1, n_excitations)
        [N/s].
    interval : float
        Between samples [s].

    """

    model: Model
    motion: Reals
    force: Reals
    force_slope: Reals
    interval: float

    @cached_property
    def rates(self) -> Reals:
        """Derivative of the motion by time, shape (n_samples + 1, 3, n_coordinates)."""
        jerk = slope(self.motion[:, 2], self.interval)
        return np.stack((self.motion[:, 1], self.motion[:, 2], jerk), axis=1)


@dataclass(frozen=True)
class Alternative:
    """
    A number that may be another one than stated.

    Parameters
    ----------
    index : int
        Of what it concerns: a parameter, an excitation, a kind of motion.

    """

    index: int

    def force(self, course: Course) -> Reals | None:
        """
        Give the force by which a unit of it disturbs the simulated motion.

        Parameters
        ----------
        course : Course

        Returns
        -------
        ndarray, shape (n_samples + 1, n_coordinates), or None
            [N, N m per unit]; None: it concerns the readings.

        """
        return None

    def reading(self, course: Course) -> tuple[int, Reals] | None:
        """
        Give what a unit of it adds to the readings.

        Parameters
        ----------
        course : Course

        Returns
        -------
        kind : int
            0 displacement, 1 velocity, 2 acceleration.
        added : ndarray, shape (n_samples + 1, n_coordinates)
            Per unit. None instead of both: it concerns the simulation.

        """
        return None

    def ordinary(self, model: Model) -> float:
        """
        Give an error of ordinary size.

        Parameters
        ----------
        model : Model

        Returns
        -------
        float
            SI; NaN where nothing tells it.

        """
        return ORDINARY_SHARE

    def in_words(self, model: Model, size: float, deviation: float | None = None) -> str:
        """
        Say what it would be.

        Parameters
        ----------
        model : Model
        size : float
            SI.
        deviation : float or None
            Standard deviation of the size; None: the size is an example.

        Returns
        -------
        str
            E.g. ``a force that reads 1 % too much``.

        """
        raise NotImplementedError


class OtherMass(Alternative):
    """The mass of a body, which is taken as known; `index` is its parameter."""

    def force(self, course: Course) -> Reals:
        """Inertia of a kilogram more, and its weight, as those of an unknown mass."""
        model = course.model
        found = np.zeros_like(course.motion[:, 2])
        for index, vector in model.mass_vectors:
            if index == self.index:
                found -= vector * course.motion[:, 2]
        for load in model.loads:
            if load.parameter == self.index and load.wave is None:
                found += load.vector
        return found

    def ordinary(self, model: Model) -> float:
        """Give a share of the mass."""
        return ORDINARY_SHARE * model.parameters[self.index].value

    def in_words(self, model: Model, size: float, deviation: float | None = None) -> str:
        """Say which mass."""
        parameter = model.parameters[self.index]
        value = f'{parameter.value:.6g} kg'
        if deviation is None:
            return f'a {parameter.name} that is {100 * size / parameter.value:.3g} % off'
        total = rounded(parameter.value + size, deviation, 1.0)
        return f'a {parameter.name} of {total} kg instead of {value}'


@dataclass(frozen=True)
class OtherInertia(Alternative):
    """
    All moments of inertia of a body.

    Parameters
    ----------
    index : int
        Of its first coordinate.
    body : str

    """

    body: str

    def force(self, course: Course) -> Reals:
        """Moments of inertia of a body that are twice as large."""
        model = course.model
        own = [coordinate.body == self.body for coordinate in model.coordinates]
        return np.asarray(-model.rotary_inertia * own * course.motion[:, 2])

    def in_words(self, model: Model, size: float, deviation: float | None = None) -> str:
        """Say which body."""
        return f'an inertia of {self.body} that is {_percent(size, deviation)} {_more(size)}'


class ForceGain(Alternative):
    """Reading of a force cell over the force; `index` is the excitation."""

    def force(self, course: Course) -> Reals:
        """Of the force that has acted, twice as much is read."""
        return _along(course.model, self.index, -course.force[:, self.index])

    def in_words(self, model: Model, size: float, deviation: float | None = None) -> str:
        """Say which force."""
        much = 'much' if size > 0 else 'little'
        return f'{_cell(model, self.index)} that reads {_percent(size, deviation)} too {much}'


class ForceDelay(Alternative):
    """Delay of a force cell; `index` is the excitation."""

    def force(self, course: Course) -> Reals:
        """Of a force that is read a second late, to first order."""
        return _along(course.model, self.index, course.force_slope[:, self.index])

    def ordinary(self, model: Model) -> float:
        """Give a delay."""
        return ORDINARY_DELAY

    def in_words(self, model: Model, size: float, deviation: float | None = None) -> str:
        """Say which force."""
        return f'{_cell(model, self.index)} that is {_late(size, deviation)}'


class FrontMass(Alternative):
    """Mass between a force cell and the body; `index` is the excitation."""

    def force(self, course: Course) -> Reals:
        """Of the force that is read, a kilogram has taken its part."""
        model = course.model
        body = model.machine.excitations[self.index].body
        own = np.array([coordinate.body == body for coordinate in model.coordinates])
        acceleration = course.motion[:, 2] @ (own * model.excitation_directions[self.index])
        return _along(model, self.index, -acceleration)

    def ordinary(self, model: Model) -> float:
        """Give a share of the mass of the body on which the force acts."""
        name = f'{model.machine.excitations[self.index].body}.mass'
        masses = [one.value for one in model.parameters if one.name == name]
        return ORDINARY_SHARE * masses[0] if masses else float('nan')

    def in_words(self, model: Model, size: float, deviation: float | None = None) -> str:
        """Say of which force."""
        mass = rounded(abs(size), deviation, 1.0)
        cell = f'the cell of {model.machine.excitations[self.index].name}'
        return f'{mass} kg {"more" if size > 0 else "less"} in front of {cell}'


class KindGain(Alternative):
    """Gain of all sensors of a kind; `index` is the kind."""

    def reading(self, course: Course) -> tuple[int, Reals]:
        """Of the motion, twice as much is read."""
        return self.index, course.motion[:, self.index]

    def in_words(self, model: Model, size: float, deviation: float | None = None) -> str:
        """Say which kind."""
        much = 'much' if size > 0 else 'little'
        return f'{KINDS[self.index]} that reads {_percent(size, deviation)} too {much}'


class KindDelay(Alternative):
    """Delay of all sensors of a kind; `index` is the kind."""

    def reading(self, course: Course) -> tuple[int, Reals]:
        """Of a motion that is read a second late, to first order."""
        return self.index, -course.rates[:, self.index]

    def ordinary(self, model: Model) -> float:
        """Give a delay."""
        return ORDINARY_DELAY

    def in_words(self, model: Model, size: float, deviation: float | None = None) -> str:
        """Say which kind."""
        return f'{KINDS[self.index]} that is {_late(size, deviation)}'


def alternatives_of(model: Model) -> tuple[Alternative, ...]:
    """
    List what is tested: always the same for the same unknowns.

    Parameters
    ----------
    model : Model

    Returns
    -------
    tuple of Alternative
        What is unknown anyway is not among them.

    """
    known = {
        index: OtherMass(index)
        for index, vector in model.mass_vectors
        if not model.parameters[index].estimated and vector.any()
    }
    turning: dict[str, Coordinate] = {
        one.body: one
        for one, inertia in zip(model.coordinates, model.rotary_inertia, strict=True)
        if inertia > 0
    }
    inertias = [OtherInertia(model.coordinates.index(one), name) for name, one in turning.items()]
    forces = [
        kind(index)
        for index in range(len(model.excitation_directions))
        for kind in (ForceGain, ForceDelay, FrontMass)
    ]
    sensors = [kind(index) for index in range(len(KINDS)) for kind in (KindGain, KindDelay)]
    return (*known.values(), *inertias, *forces, *sensors)


def disturbances(alternatives: Sequence[Alternative], course: Course) -> Reals:
    """
    Give the forces by which alternatives disturb the simulated motion.

    Parameters
    ----------
    alternatives : sequence of Alternative
    course : Course

    Returns
    -------
    ndarray, shape (n_samples + 1, n_coordinates, n_alternatives)
        [N, N m per unit of each]; zero for those that concern the readings.

    """
    table = np.zeros((len(course.motion), course.motion.shape[2], len(alternatives)))
    for column, one in enumerate(alternatives):
        force = one.force(course)
        if force is not None:
            table[:, :, column] = force
    return table


def add_readings(
    derivatives: Reals, alternatives: Sequence[Alternative], course: Course, first: int
) -> None:
    """
    Fill in what alternatives add to the readings.

    Parameters
    ----------
    derivatives : ndarray, shape (n_samples, 3, n_coordinates, n_columns)
        Of the motion that is read; changed.
    alternatives : sequence of Alternative
    course : Course
    first : int
        Column of the first of them.

    """
    for column, one in enumerate(alternatives, first):
        reading = one.reading(course)
        if reading is not None:
            kind, added = reading
            derivatives[:, kind, :, column] = added[:-1]


def slope(samples: Reals, interval: float) -> Reals:
    """
    Differentiate samples; less exactly close to the ends.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n)
    interval : float
        Between samples [s].

    Returns
    -------
    ndarray, the same shape

    """
    found = np.gradient(samples, interval, axis=0)
    weights = stencil(1, 0.0, HALF_WIDTH)
    if len(samples) >= len(weights):
        windows = np.lib.stride_tricks.sliding_window_view(samples, len(weights), axis=0)
        found[HALF_WIDTH:-HALF_WIDTH] = windows @ weights / interval
    return np.asarray(found)


def rounded(value: float, deviation: float | None, unit: float) -> str:
    """
    Write a number with its standard deviation.

    Parameters
    ----------
    value : float
        SI.
    deviation : float or None
        SI; None: not told.
    unit : float
        In which to write [SI].

    Returns
    -------
    str
        E.g. ``50.198 +- 0.014``.

    """
    if deviation is None or not deviation > 0:
        return f'{value / unit:.3g}'
    digits = max(0, 1 - int(np.floor(np.log10(deviation / unit))))
    return f'{value / unit:.{digits}f} +- {deviation / unit:.{digits}f}'


def _along(model: Model, excitation: int, force: Reals) -> Reals:
    return np.outer(force, model.excitation_directions[excitation])


def _cell(model: Model, excitation: int) -> str:
    several = len(model.machine.excitations) > 1
    return f'a force of {model.machine.excitations[excitation].name}' if several else 'a force'


def _percent(size: float, deviation: float | None) -> str:
    return f'{rounded(abs(size), deviation, 0.01)} %'


def _late(size: float, deviation: float | None) -> str:
    return f'{rounded(abs(size), deviation, 1e-6)} us {"late" if size > 0 else "early"}'


def _more(size: float) -> str:
    return 'greater' if size > 0 else 'smaller'
