# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A machine of rigid finite elements: bodies, joints, exciters, forces that nobody measures."""

from dataclasses import dataclass, field

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.joints import Coefficient, GROUND, Joint
from identnl_ros.core.mechanics.periodic_force import PeriodicForce
import numpy as np
from numpy.typing import NDArray

STANDARD_GRAVITY = (0.0, 0.0, -9.80665)  # machine frame, z upwards [m/s^2]

DEGREES_OF_FREEDOM = (
    'translation_1',
    'translation_2',
    'translation_3',
    'rotation_1',
    'rotation_2',
    'rotation_3',
)


@dataclass(frozen=True)
class Body:
    """
    Rigid finite element.

    Parameters
    ----------
    name : str
    mass : Coefficient
        [kg].
    centre_of_mass : ndarray, shape (3,)
        Machine frame [m].
    inertia : ndarray, shape (3, 3), or None
        About the centre of mass, axes of the machine frame [kg m^2]; None only where the
        body cannot rotate.
    degrees_of_freedom : tuple of str
        Of `DEGREES_OF_FREEDOM`: motions along and about the principal central axes that the
        body is free to make.

    Raises
    ------
    MachineError
        If the mass is not positive, the inertia is not that of a body, or a degree of
        freedom is unknown.

    """

    name: str
    mass: Coefficient
    centre_of_mass: NDArray[np.float64]
    inertia: NDArray[np.float64] | None = None
    degrees_of_freedom: tuple[str, ...] = DEGREES_OF_FREEDOM

    def __post_init__(self) -> None:
        """Check that such a body can exist."""
        where = f'body {self.name}'
        if self.name == GROUND:
            raise MachineError(f'{where}: "{GROUND}" is the inertial frame; choose another name')
        if self.mass.value <= 0 or np.isinf(self.mass.value):
            raise MachineError(f'{where}: mass is {self.mass.value} kg, expected more than 0')
        if self.centre_of_mass.shape != (3,) or not np.all(np.isfinite(self.centre_of_mass)):
            raise MachineError(f'{where}: centre_of_mass must be three finite numbers')
        for name in self.degrees_of_freedom:
            if name not in DEGREES_OF_FREEDOM:
                raise MachineError(
                    f'{where}: degree of freedom "{name}" is unknown, '
                    f'expected some of {", ".join(DEGREES_OF_FREEDOM)}'
                )
        if not self.degrees_of_freedom or len(set(self.degrees_of_freedom)) != len(
            self.degrees_of_freedom
        ):
            raise MachineError(
                f'{where}: degrees_of_freedom must name at least one motion, each once'
            )
        ordered = tuple(name for name in DEGREES_OF_FREEDOM if name in self.degrees_of_freedom)
        object.__setattr__(self, 'degrees_of_freedom', ordered)
        if self.inertia is not None:
            _check_inertia(self.inertia, where)
        elif any(name.startswith('rotation') for name in ordered):
            raise MachineError(
                f'{where}: inertia is missing; give the 3 x 3 tensor at the centre of mass, '
                'or free only translations'
            )


@dataclass(frozen=True)
class ExcitationPoint:
    """
    Where and along what an exciter acts, and what it does by default.

    Parameters
    ----------
    name : str
    body : str
        The body on which a positive force acts along `direction`.
    point : ndarray, shape (3,)
        Machine frame [m].
    direction : ndarray, shape (3,)
        Machine frame; normalised here.
    reaction_body : str
        The body that bears the opposite force; the ground by default.
    reaction_point : ndarray, shape (3,), or None
        Machine frame [m]; None: the same as `point`.
    amplitude : float
        Amplitude of a sine, or peak of an impulse; a multisine or a sweep has the same
        root mean square as a sine of this amplitude [N].
    frequency : float
        Of a sine [Hz].
    band : tuple of float
        Lowest and highest frequency of a multisine or a sweep [Hz].

    Raises
    ------
    MachineError
        If a vector is not three finite numbers or a number is out of range.

    """

    name: str
    body: str
    point: NDArray[np.float64]
    direction: NDArray[np.float64]
    reaction_body: str = GROUND
    reaction_point: NDArray[np.float64] | None = None
    amplitude: float = 1.0
    frequency: float = 10.0
    band: tuple[float, float] = (1.0, 100.0)

    def __post_init__(self) -> None:
        """Check ranges, normalise the direction."""
        where = f'excitation {self.name}'
        for name in ('point', 'direction', 'reaction_point'):
            vector = getattr(self, name)
            if vector is not None and (vector.shape != (3,) or not np.all(np.isfinite(vector))):
                raise MachineError(f'{where}: {name} must be three finite numbers')
        length = float(np.linalg.norm(self.direction))
        if length < 1e-12:
            raise MachineError(f'{where}: direction is zero, expected a vector of any length')
        object.__setattr__(self, 'direction', self.direction / length)
        if not (self.amplitude > 0 and self.frequency > 0):
            raise MachineError(f'{where}: amplitude and frequency must be positive')
        if not 0 < self.band[0] <= self.band[1]:
            raise MachineError(
                f'{where}: band is {list(self.band)} Hz, '
                'expected two positive numbers, the lower one first'
            )


@dataclass(frozen=True)
class ConstantForce:
    """
    A force that does not change: a hose, a counterweight, an assembly force.

    Parameters
    ----------
    name : str
    body : str
    point, direction : ndarray, shape (3,)
        Machine frame [m]; the direction is normalised here.
    force : Coefficient
        [N].
    reaction_body : str
        The body that bears the opposite force at the same point; the ground by default.

    Raises
    ------
    MachineError
        If a vector is not three finite numbers or the direction is zero.

    """

    name: str
    body: str
    point: NDArray[np.float64]
    direction: NDArray[np.float64]
    force: Coefficient
    reaction_body: str = GROUND

    def __post_init__(self) -> None:
        """Check and normalise the vectors."""
        for name in ('point', 'direction'):
            vector = getattr(self, name)
            if vector.shape != (3,) or not np.all(np.isfinite(vector)):
                raise MachineError(f'force {self.name}: {name} must be three finite numbers')
        length = float(np.linalg.norm(self.direction))
        if length < 1e-12:
            raise MachineError(f'force {self.name}: direction is zero')
        object.__setattr__(self, 'direction', self.direction / length)


@dataclass(frozen=True)
class Machine:
    """
    A machine: what its equations of motion are made of.

    Parameters
    ----------
    name : str
    bodies : tuple of Body
    joints : tuple of Joint
    excitations : tuple of ExcitationPoint
    forces : tuple of ConstantForce or PeriodicForce
    gravity : ndarray, shape (3,), or None
        None: displacements count from the state of rest, where weight and preload balance,
        and joint forces are taken minus their value at rest. A vector [m/s^2]: displacements
        count from the unloaded machine, and the equilibrium under weight, preload and
        constant forces is computed.

    Raises
    ------
    MachineError
        If names repeat, or a joint or a force hangs on a body that does not exist.

    """

    name: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    excitations: tuple[ExcitationPoint, ...] = ()
    forces: tuple[ConstantForce | PeriodicForce, ...] = ()
    gravity: NDArray[np.float64] | None = field(default=None)

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        if not self.bodies:
            raise MachineError('machine: no bodies; list at least one under the key bodies')
        bodies = {body.name for body in self.bodies}
        ends = (
            *(('joint', one.name, one.body, one.other_body) for one in self.joints),
            *(('excitation', one.name, one.body, one.reaction_body) for one in self.excitations),
            *(('force', one.name, one.body, one.reaction_body) for one in self.forces),
        )
        seen: set[str] = set()
        for name in (*(body.name for body in self.bodies), *(end[1] for end in ends)):
            if name in seen:
                raise MachineError(f'machine: two parts are called {name}; names must differ')
            seen.add(name)
        for label, name, *attached in ends:
            for end in attached:
                if end not in bodies and end != GROUND:
                    raise MachineError(
                        f'{label} {name}: attached to "{end}", which is no body; '
                        f'expected one of {", ".join(sorted(bodies))} or {GROUND}'
                    )
            if attached[0] == attached[1]:
                raise MachineError(f'{label} {name}: both ends are on "{attached[0]}"')
        if self.gravity is not None and (
            self.gravity.shape != (3,) or not np.all(np.isfinite(self.gravity))
        ):
            raise MachineError('machine: gravity must be three finite numbers')


def _check_inertia(inertia: NDArray[np.float64], where: str) -> None:
    if inertia.shape != (3, 3) or not np.all(np.isfinite(inertia)):
        raise MachineError(f'{where}: inertia must be 3 x 3 finite numbers')
    largest = float(np.abs(inertia).max())
    if not np.allclose(inertia, inertia.T, rtol=0, atol=1e-9 * largest):
        raise MachineError(f'{where}: inertia is not symmetric; check the products of inertia')
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0:
        raise MachineError(
            f'{where}: inertia is not positive definite, its principal moments are '
            f'{", ".join(f"{moment:.6g}" for moment in moments)} kg m^2; '
            'check the signs of the products of inertia'
        )
    if moments[0] + moments[1] < moments[2] * (1 - 1e-9):
        raise MachineError(
            f'{where}: no body has the principal moments of inertia '
            f'{", ".join(f"{moment:.6g}" for moment in moments)} kg m^2: '
            'the largest cannot exceed the sum of the others'
        )
