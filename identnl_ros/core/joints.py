# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Joints: spring-damping elements between two bodies or a body and the ground.

A joint is described in its own frame (axis 1 = contact normal, 2 and 3 tangential); its
deformation is the motion of its body relative to its other body, positive in compression.
Every joint is a sum of scalar terms, each acting along one direction of the six-dimensional
deformation: ``wrench = sum(coefficient * factor * law(direction . deformation) * direction)``.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

from identnl_ros.core.errors import MachineError
from identnl_ros.core.laws import Law, LawKind
import numpy as np
from numpy.typing import NDArray

GROUND = 'ground'
NORMAL_AXES = (0, 4, 5)
TANGENTIAL_AXES = (1, 2, 3)


@dataclass(frozen=True)
class Coefficient:
    """
    A number of the machine that is known or to be estimated.

    Parameters
    ----------
    value : float
        SI; NaN when not known. For an estimated one: what the simulated stand uses.
    estimated : bool
        True: the identification treats it as unknown.

    """

    value: float = float('nan')
    estimated: bool = False

    @property
    def absent(self) -> bool:
        """Known to be zero: the term does not exist."""
        return not self.estimated and self.value == 0.0


@dataclass(frozen=True)
class JointTerm:
    """
    One scalar element of a joint.

    Parameters
    ----------
    key : str
        Parameter within the joint, e.g. ``normal_stiffness``.
    symbol : str
        Symbol of the literature, e.g. ``a_n``.
    unit : str
        SI unit of the parameter.
    coefficient : Coefficient
    direction : ndarray, shape (6,)
        In the joint's frame: three translations, three rotations.
    law : Law
    factor : float
        Geometry: force = coefficient * factor * law.

    """

    key: str
    symbol: str
    unit: str
    coefficient: Coefficient
    direction: NDArray[np.float64]
    law: Law
    factor: float = 1.0


class Joint(Protocol):
    """What the assembly of a machine needs to know of a joint."""

    @property
    def kind(self) -> str:
        """Kind of joint, as in the machine file."""
        ...

    @property
    def name(self) -> str:
        """Name, unique in the machine."""
        ...

    @property
    def body(self) -> str:
        """Body whose motion along the axes is positive deformation."""
        ...

    @property
    def other_body(self) -> str:
        """Body it moves against, or the ground."""
        ...

    @property
    def point(self) -> NDArray[np.float64]:
        """Where the joint acts, machine frame [m], shape (3,)."""
        ...

    @property
    def axes(self) -> NDArray[np.float64]:
        """Axes 1 to 3 of the joint as columns, machine frame, shape (3, 3)."""
        ...

    def terms(self) -> Iterator[JointTerm]:
        """Yield the scalar elements of the joint."""
        ...


@dataclass(frozen=True)
class Slideway:
    """
    Slideway joint: nonlinear normal contact, linear tangential stiffness, damping.

    Contact laws (5)-(9) and damping (22)-(25) of Berczynski et al. (2010); the exponent of
    the normal direction after Levina and Reshetov is 2.

    Parameters
    ----------
    name, body, other_body : str
    point : ndarray, shape (3,)
        Centre of the contact area, machine frame [m].
    normal : ndarray, shape (3,)
        Direction in which motion of `body` against `other_body` compresses the joint.
    longitudinal : ndarray, shape (3,)
        Direction of `length`, in the contact plane (axis 2).
    length, width : float
        Contact area along axes 2 and 3 [m].
    normal_stiffness : Coefficient
        a_n [N/m^m].
    tangential_stiffness : Coefficient
        a_t [N/m].
    normal_damping, tangential_damping : Coefficient
        h_n and h_t [N/m] where `damping_frequency` is given, else c_n and c_t [N s/m].
    damping_frequency : float or None
        Frequency at which hysteretic coefficients hold [Hz]; None: viscous coefficients.
    exponent : float
        m of the normal direction [-].
    preload : float
        Compression at rest delta_0 [m].
    coupled : bool
        False: every deformation component acts alone (the paper's law). True: pressure is
        integrated over the area, so preload gives tilting stiffness and contact can open.
    gauss_points : int
        Points along each side of the area for the coupled law.

    Raises
    ------
    MachineError
        If directions, sizes, exponent or preload are out of range.

    """

    name: str
    body: str
    other_body: str
    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    longitudinal: NDArray[np.float64]
    length: float
    width: float
    normal_stiffness: Coefficient
    tangential_stiffness: Coefficient
    normal_damping: Coefficient
    tangential_damping: Coefficient
    damping_frequency: float | None = None
    exponent: float = 2.0
    preload: float = 0.0
    coupled: bool = False
    gauss_points: int = 4
    kind: ClassVar[str] = 'slideway'

    def __post_init__(self) -> None:
        """Check ranges; make the axes unit vectors."""
        where = f'joint {self.name}'
        _check_point(self.point, where)
        normal, longitudinal = (
            _unit_vector(vector, f'{where}: {name}')
            for name, vector in (('normal', self.normal), ('longitudinal', self.longitudinal))
        )
        cosine = float(normal @ longitudinal)
        if abs(cosine) > 1e-6:
            raise MachineError(
                f'{where}: normal and longitudinal must be perpendicular, '
                f'found an angle of {np.degrees(np.arccos(cosine)):.4g} degrees'
            )
        object.__setattr__(self, 'normal', normal)
        object.__setattr__(self, 'longitudinal', longitudinal)
        for name in ('length', 'width', 'exponent'):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise MachineError(
                    f'{where}: {name} is {getattr(self, name)}, expected a positive number'
                )
        if not (np.isfinite(self.preload) and self.preload >= 0):
            raise MachineError(
                f'{where}: preload is {self.preload} m, expected 0 or a positive number'
            )
        if self.damping_frequency is not None and not (
            np.isfinite(self.damping_frequency) and self.damping_frequency > 0
        ):
            raise MachineError(
                f'{where}: damping_frequency is {self.damping_frequency} Hz, '
                'expected a positive number'
            )
        if self.gauss_points < 1:
            raise MachineError(f'{where}: gauss_points is {self.gauss_points}, expected 1 or more')

    @property
    def axes(self) -> NDArray[np.float64]:
        """Axes 1 to 3 of the joint as columns, machine frame, shape (3, 3)."""
        return np.column_stack(
            (self.normal, self.longitudinal, np.cross(self.normal, self.longitudinal))
        )

    def terms(self) -> Iterator[JointTerm]:
        """Yield the scalar elements of the joint."""
        yield from self._normal_stiffness_terms()
        # Second moments of area per unit area, (8) and (24)-(25); axes 1 to 6.
        length, width = self.length, self.width
        moments = np.array(
            [1.0, 1.0, 1.0, (length**2 + width**2) / 12, width**2 / 12, length**2 / 12]
        )
        for axis in TANGENTIAL_AXES:
            yield JointTerm(
                'tangential_stiffness',
                'a_t',
                'N/m',
                self.tangential_stiffness,
                _axis(axis),
                Law(LawKind.LINEAR),
                moments[axis],
            )
        for side, letter, coefficient, axes in (
            ('normal', 'n', self.normal_damping, NORMAL_AXES),
            ('tangential', 't', self.tangential_damping, TANGENTIAL_AXES),
        ):
            if self.damping_frequency is None:
                key, symbol, unit, scale = f'{side}_damping', f'c_{letter}', 'N*s/m', 1.0
            else:
                # F_d = h / omega * rate, (22)
                key, symbol, unit = f'{side}_hysteretic_damping', f'h_{letter}', 'N/m'
                scale = 1.0 / (2 * np.pi * self.damping_frequency)
            for axis in axes:
                yield JointTerm(
                    key,
                    symbol,
                    unit,
                    coefficient,
                    _axis(axis),
                    Law(LawKind.VISCOUS),
                    scale * moments[axis],
                )

    def _normal_stiffness_terms(self) -> Iterator[JointTerm]:
        unit = 'N/m' if self.exponent == 1 else f'N/m^{self.exponent:.12g}'
        head = ('normal_stiffness', 'a_n', unit, self.normal_stiffness)
        m = self.exponent
        if not self.coupled:
            for axis, factor, preload in (
                (0, 1.0, self.preload),
                (4, 2 * (self.width / 2) ** (m + 2) / (self.width * (m + 2)), 0.0),  # (9b)
                (5, 2 * (self.length / 2) ** (m + 2) / (self.length * (m + 2)), 0.0),  # (9c)
            ):
                yield JointTerm(*head, _axis(axis), Law(LawKind.SIGNED_POWER, m, preload), factor)
            return
        nodes, weights = np.polynomial.legendre.leggauss(self.gauss_points)
        for y, weight_y in zip(nodes * self.length / 2, weights / 2, strict=True):
            for z, weight_z in zip(nodes * self.width / 2, weights / 2, strict=True):
                yield JointTerm(
                    *head,
                    np.array([1.0, 0.0, 0.0, 0.0, z, -y]),
                    Law(LawKind.CONTACT, m, self.preload),
                    weight_y * weight_z,
                )


@dataclass(frozen=True)
class SpringDamper:
    """
    Springs and dampers along chosen axes: vibration pad, screw, general six-spring joint.

    Parameters
    ----------
    name, body, other_body : str
    point : ndarray, shape (3,)
        Where the joint acts, machine frame [m].
    axes : ndarray, shape (3, 3)
        Axes 1 to 3 as columns, machine frame, right-handed and orthonormal.
    stiffness, damping, quadratic_stiffness, cubic_stiffness : tuple of Coefficient
        Along axes 1, 2, 3 and about axes 1, 2, 3, as many as the joint has, at most six.
        Units: N/m, N s/m, N/m^2, N/m^3; about an axis N m per rad, rad/s, rad^2, rad^3.
    kind : str
        ``pad``, ``screw`` or ``six_spring``.

    Raises
    ------
    MachineError
        If the axes are not a right-handed frame or there are more than six of anything.

    """

    name: str
    body: str
    other_body: str
    point: NDArray[np.float64]
    axes: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    stiffness: tuple[Coefficient, ...] = ()
    damping: tuple[Coefficient, ...] = ()
    quadratic_stiffness: tuple[Coefficient, ...] = ()
    cubic_stiffness: tuple[Coefficient, ...] = ()
    kind: str = 'six_spring'

    def __post_init__(self) -> None:
        """Check the point, the frame and the number of axes."""
        _check_point(self.point, f'joint {self.name}')
        if not np.allclose(self.axes.T @ self.axes, np.eye(3), atol=1e-6) or (
            np.linalg.det(self.axes) < 0
        ):
            raise MachineError(
                f'joint {self.name}: its axes (axis_1, axis_2) are not perpendicular unit '
                'vectors of a right-handed frame'
            )
        for name in ('stiffness', 'damping', 'quadratic_stiffness', 'cubic_stiffness'):
            if len(getattr(self, name)) > 6:
                raise MachineError(
                    f'joint {self.name}: {name} has {len(getattr(self, name))} numbers, '
                    'expected at most six (along axes 1 to 3, about axes 1 to 3)'
                )

    def terms(self) -> Iterator[JointTerm]:
        """Yield the scalar elements of the joint."""
        for key, symbol, power, law in (
            ('stiffness', 'k', 1, Law(LawKind.LINEAR)),
            ('quadratic_stiffness', 'k_2', 2, Law(LawKind.POLYNOMIAL, 2.0)),
            ('cubic_stiffness', 'k_3', 3, Law(LawKind.POLYNOMIAL, 3.0)),
            ('damping', 'c', 0, Law(LawKind.VISCOUS)),
        ):
            coefficients = getattr(self, key)
            for axis, coefficient in enumerate(coefficients):
                if coefficient.absent:
                    continue
                yield JointTerm(
                    key if len(coefficients) == 1 else f'{key}_{axis + 1}',
                    symbol,
                    _spring_unit(axis, power),
                    coefficient,
                    _axis(axis),
                    law,
                )


def _spring_unit(axis: int, power: int) -> str:
    """Name the unit of a spring of a power of the deformation; power 0: of a damper."""
    if power == 0:
        return 'N*s/m' if axis < 3 else 'N*m*s'
    if axis >= 3:
        return 'N*m'
    return 'N/m' if power == 1 else f'N/m^{power}'


def frame_about(axis: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """
    Right-handed frame whose axis 1 is given, the others chosen.

    Parameters
    ----------
    axis : ndarray, shape (3,)
        Any length but zero.
    where : str
        Named in the error.

    Returns
    -------
    ndarray, shape (3, 3)
        Axes as columns.

    Raises
    ------
    MachineError
        If the axis is zero or not finite.

    """
    first = _unit_vector(axis, where)
    helper = np.eye(3)[int(np.argmin(np.abs(first)))]
    second = np.cross(helper, first)
    second /= np.linalg.norm(second)
    return np.column_stack((first, second, np.cross(first, second)))


def _check_point(point: NDArray[np.float64], where: str) -> None:
    if point.shape != (3,) or not np.all(np.isfinite(point)):
        raise MachineError(f'{where}: point must be three finite numbers')


def _unit_vector(vector: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise MachineError(f'{where}: expected three finite numbers, found {vector.tolist()}')
    length = np.linalg.norm(vector)
    if length < 1e-12:
        raise MachineError(f'{where}: the vector is zero, expected a direction')
    return vector / length


def _axis(axis: int) -> NDArray[np.float64]:
    direction = np.zeros(6)
    direction[axis] = 1.0
    return direction
