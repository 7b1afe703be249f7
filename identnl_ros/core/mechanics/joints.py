# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Joints: spring-damping elements between two bodies or a body and the ground.

A joint is described in its own frame (axis 1 = contact normal, 2 and 3 tangential); its
deformation is the motion of its body relative to its other body, positive in compression.
Every joint is a sum of scalar terms, each acting along one direction of the six-dimensional
deformation: ``wrench = sum(coefficient * factor * law(direction . deformation) * direction)``.
Preload and exponent of a slideway, the gap of backlash and the like are inside laws and factors:
inner parameters.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol, Self

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.coefficients import Coefficient as Coefficient
from identnl_ros.core.mechanics.elements import Element as Element
from identnl_ros.core.mechanics.joint_terms import (
    along_axis,
    check_point,
    InnerParameter,
    JointTerm,
    unit_vector,
)
from identnl_ros.core.mechanics.laws import Law, LawKind
from identnl_ros.core.mechanics.slideway import Slideway as Slideway
import numpy as np
from numpy.typing import NDArray

GROUND = 'ground'


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

    @property
    def inner(self) -> tuple[InnerParameter, ...]:
        """Numbers inside the joint's laws."""
        ...

    def starting_at(self, values: Mapping[str, float]) -> Self:
        """Copy with other start values of inner parameters, by key."""
        ...

    def terms(self, inner: Mapping[str, float] | None = None) -> Iterator[JointTerm]:
        """Yield the scalar elements of the joint, at other inner values where given."""
        ...


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
        check_point(self.point, f'joint {self.name}')
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

    @property
    def inner(self) -> tuple[InnerParameter, ...]:
        """No numbers inside the laws: all forces are proportional to their coefficients."""
        return ()

    def starting_at(self, values: Mapping[str, float]) -> 'SpringDamper':
        """Return the joint itself: it has no inner parameters."""
        return self

    def terms(self, inner: Mapping[str, float] | None = None) -> Iterator[JointTerm]:
        """Yield the scalar elements of the joint; it has no inner values."""
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
                    along_axis(axis),
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
    first = unit_vector(axis, where)
    helper = np.eye(3)[int(np.argmin(np.abs(first)))]
    second = np.cross(helper, first)
    second /= np.linalg.norm(second)
    return np.column_stack((first, second, np.cross(first, second)))
