# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Forces that nobody measures and that repeat: an unbalance, a pump, the mains."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.joint_terms import check_point, InnerParameter, unit_vector
from identnl_ros.core.mechanics.joints import GROUND
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

COSINE = 'cosine'
SINE = 'sine'
FREQUENCY = 'frequency'


@dataclass(frozen=True)
class Wave:
    """
    A cosine of time, ``cos(2 pi frequency t + phase)``.

    Parameters
    ----------
    frequency : float
        [Hz].
    phase : float
        [rad].

    """

    frequency: float
    phase: float

    def at(self, time: Reals) -> Reals:
        """
        Evaluate.

        Parameters
        ----------
        time : ndarray
            Since the begin of the stream [s].

        Returns
        -------
        ndarray, same shape

        """
        return np.cos(2 * np.pi * self.frequency * time + self.phase)

    def frequency_slope(self, time: Reals) -> Reals:
        """
        Differentiate by the frequency.

        Parameters
        ----------
        time : ndarray
            Since the begin of the stream [s].

        Returns
        -------
        ndarray, same shape
            [1/Hz].

        """
        angle = 2 * np.pi * time
        return -angle * np.sin(self.frequency * angle + self.phase)


@dataclass(frozen=True)
class PeriodicForce:
    """
    A harmonic force or moment.

    ``cosine * cos(2 pi frequency t) + sine * sin(2 pi frequency t)``; time t counts from the
    begin of the stream, that is from the sample of index 0.

    Parameters
    ----------
    name : str
    body : str
    point, direction : ndarray, shape (3,)
        Machine frame [m]; the direction is normalised here.
    cosine, sine : Coefficient
        Amplitudes [N], of a moment [N m].
    frequency : Coefficient
        [Hz].
    reaction_body : str
        The body that bears the opposite force at the same point; the ground by default.
    moment : bool
        A moment about the direction; the point does not matter then.

    Raises
    ------
    MachineError
        If a vector is not three finite numbers, the direction is zero or the frequency is not
        positive.

    """

    name: str
    body: str
    point: Reals
    direction: Reals
    cosine: Coefficient
    sine: Coefficient
    frequency: Coefficient
    reaction_body: str = GROUND
    moment: bool = False

    def __post_init__(self) -> None:
        """Check the vectors and the frequency, normalise the direction."""
        where = f'force {self.name}'
        check_point(self.point, where)
        object.__setattr__(self, 'direction', unit_vector(self.direction, f'{where}: direction'))
        self._check(self.frequency.value)

    @property
    def unit(self) -> str:
        """SI unit of the amplitudes."""
        return 'N*m' if self.moment else 'N'

    @property
    def inner(self) -> tuple[InnerParameter, ...]:
        """The frequency: the force is not proportional to it."""
        return (InnerParameter(FREQUENCY, 'f', 'Hz', self.frequency),)

    def starting_at(self, values: Mapping[str, float]) -> 'PeriodicForce':
        """
        Copy with another start value of the frequency.

        Parameters
        ----------
        values : mapping of str to float
            By key, SI; without it the frequency remains.

        Returns
        -------
        PeriodicForce

        Raises
        ------
        MachineError
            If it is not positive.

        """
        value = values.get(FREQUENCY, self.frequency.value)
        return replace(self, frequency=replace(self.frequency, value=value))

    def waves(self, inner: Mapping[str, float]) -> Iterator[tuple[str, Wave]]:
        """
        Yield the two parts of the force.

        Parameters
        ----------
        inner : mapping of str to float
            Present value of the frequency, by key [Hz].

        Yields
        ------
        key : str
            Of its amplitude.
        wave : Wave

        Raises
        ------
        MachineError
            If the frequency is not positive.

        """
        frequency = inner[FREQUENCY]
        self._check(frequency)
        yield COSINE, Wave(frequency, 0.0)
        yield SINE, Wave(frequency, -np.pi / 2)

    def _check(self, frequency: float) -> None:
        # A frequency that is tied to another one has no number yet.
        if not (np.isnan(frequency) or 0 < frequency < np.inf):
            raise MachineError(
                f'force {self.name}: {FREQUENCY} is {frequency} Hz, expected more than 0'
            )
