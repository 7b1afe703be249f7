# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Joints of one element along one axis: friction, backlash, hysteresis, drift and the like."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.joint_terms import (
    along_axis,
    check_point,
    EXPONENT,
    FADING,
    GAP,
    InnerParameter,
    JointTerm,
    LIMIT,
    TRANSITION,
)
from identnl_ros.core.mechanics.laws import Law, LawKind
import numpy as np
from numpy.typing import NDArray

ALONG, ABOUT = 0, 1


@dataclass(frozen=True)
class Number:
    """
    One number of a kind of element.

    Parameters
    ----------
    key, symbol : str
    units : tuple of str
        Along an axis, about an axis; SI.
    lowest : float
        Smallest allowed value.
    above : bool
        The smallest value itself is not allowed.
    default : float or None
        None: it must be given.
    estimable : bool
        It may be estimated.

    """

    key: str
    symbol: str
    units: tuple[str, str]
    lowest: float = 0.0
    above: bool = True
    default: float | None = None
    estimable: bool = True


@dataclass(frozen=True)
class ElementKind:
    """
    A kind of element.

    Parameters
    ----------
    law : LawKind
    coefficient : Number
        What the force is proportional to.
    inner : tuple of Number
        Numbers inside its law.

    """

    law: LawKind
    coefficient: Number
    inner: tuple[Number, ...] = ()


_FORCE = ('N', 'N*m')
_STIFFNESS = ('N/m', 'N*m')
_LENGTH = ('m', 'rad')
_VELOCITY = ('m/s', 'rad/s')
_TRANSITION = Number(TRANSITION, 'v_t', _VELOCITY)

ELEMENT_KINDS = {
    'coulomb_friction': ElementKind(
        LawKind.COULOMB, Number('force', 'F_c', _FORCE), (_TRANSITION,)
    ),
    'stribeck_friction': ElementKind(
        LawKind.STRIBECK,
        Number('force', 'F_s', _FORCE),
        (_TRANSITION, Number(FADING, 'v_s', _VELOCITY)),
    ),
    'quadratic_damping': ElementKind(
        LawKind.QUADRATIC_DAMPING, Number('damping', 'c_2', ('N*s^2/m^2', 'N*m*s^2'))
    ),
    'backlash': ElementKind(
        LawKind.BACKLASH,
        Number('stiffness', 'k_b', _STIFFNESS),
        (Number(GAP, 'g', _LENGTH),),
    ),
    'bilinear_stiffness': ElementKind(
        LawKind.BILINEAR,
        Number('stiffness', 'k_1', _STIFFNESS),
        (Number(GAP, 'g', _LENGTH, lowest=-np.inf, default=0.0),),
    ),
    'drifting_stiffness': ElementKind(
        LawKind.DRIFTING, Number('stiffness_rate', 'k_t', ('N/m/s', 'N*m/s'))
    ),
    'hysteresis': ElementKind(
        LawKind.HYSTERESIS,
        Number('stiffness', 'k_h', _STIFFNESS),
        (
            Number(LIMIT, 'z_0', _LENGTH, estimable=False),
            Number(EXPONENT, 'n', ('1', '1'), 1.0, above=False, default=2.0, estimable=False),
        ),
    ),
}
# Number of a law that each inner parameter sets.
_IN_LAW = {
    GAP: 'gap',
    TRANSITION: 'transition',
    FADING: 'fading',
    LIMIT: 'limit',
    EXPONENT: 'exponent',
}


@dataclass(frozen=True)
class Element:
    """
    One element along or about one axis of a joint.

    Parameters
    ----------
    name, body, other_body : str
    point : ndarray, shape (3,)
        Where it acts, machine frame [m].
    axes : ndarray, shape (3, 3)
        Axes 1 to 3 of its frame as columns, machine frame.
    kind : str
        Of `ELEMENT_KINDS`.
    axis : int
        1 to 3: along that axis, 4 to 6: about axis 1 to 3.
    coefficient : Coefficient
        What the force is proportional to.
    numbers : mapping of str to Coefficient
        Numbers inside the law, by key; those with a default may be left out.

    Raises
    ------
    MachineError
        If there is no such kind or axis, or a number is missing or out of range.

    """

    name: str
    body: str
    other_body: str
    point: NDArray[np.float64]
    axes: NDArray[np.float64]
    kind: str
    axis: int
    coefficient: Coefficient
    numbers: Mapping[str, Coefficient] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the ranges; fill in defaults."""
        where = f'joint {self.name}'
        check_point(self.point, where)
        if self.kind not in ELEMENT_KINDS:
            raise MachineError(
                f'{where}: "{self.kind}" is no kind of element, '
                f'expected one of {", ".join(ELEMENT_KINDS)}'
            )
        if self.axis not in range(1, 7):
            raise MachineError(f'{where}: axis is {self.axis}, expected a whole number 1 to 6')
        expected = ELEMENT_KINDS[self.kind].inner
        unknown = self.numbers.keys() - {number.key for number in expected}
        if unknown:
            raise MachineError(f'{where}: {self.kind} has no {", ".join(sorted(unknown))}')
        numbers = {number.key: self._given(number, where) for number in expected}
        object.__setattr__(self, 'numbers', numbers)

    def _given(self, number: Number, where: str) -> Coefficient:
        """Return a number inside the law, checked, or its default."""
        if number.key not in self.numbers:
            if number.default is None:
                raise MachineError(f'{where}: {number.key} is missing')
            return Coefficient(number.default)
        given = self.numbers[number.key]
        open_value = given.estimated or given.tie is not None
        if open_value and not number.estimable:
            raise MachineError(f'{where}: {number.key} must be known')
        if not (open_value and np.isnan(given.value)):
            _check(number, given.value, where)
        return given

    @property
    def _angular(self) -> int:
        return ABOUT if self.axis > 3 else ALONG

    @property
    def inner(self) -> tuple[InnerParameter, ...]:
        """Numbers inside the law."""
        return tuple(
            InnerParameter(
                number.key,
                number.symbol,
                number.units[self._angular],
                self.numbers[number.key],
            )
            for number in ELEMENT_KINDS[self.kind].inner
        )

    def starting_at(self, values: Mapping[str, float]) -> 'Element':
        """
        Copy with other start values of the numbers inside the law.

        Parameters
        ----------
        values : mapping of str to float
            By key, SI; what is not in it remains.

        Returns
        -------
        Element

        Raises
        ------
        MachineError
            If one is out of range.

        """
        numbers = {
            key: replace(one, value=values.get(key, one.value))
            for key, one in self.numbers.items()
        }
        return replace(self, numbers=numbers)

    def terms(self, inner: Mapping[str, float] | None = None) -> Iterator[JointTerm]:
        """
        Yield the scalar element.

        Parameters
        ----------
        inner : mapping of str to float, optional
            Present values of the numbers inside the law, by key, SI; NaN: not known. By default
            those of the joint.

        Yields
        ------
        JointTerm

        Raises
        ------
        MachineError
            If a number is out of range.

        """
        kind = ELEMENT_KINDS[self.kind]
        present = {key: one.value for key, one in self.numbers.items()} | dict(inner or {})
        for number in kind.inner:
            if not np.isnan(present[number.key]):
                _check(number, present[number.key], f'joint {self.name}')
        yield JointTerm(
            kind.coefficient.key,
            kind.coefficient.symbol,
            kind.coefficient.units[self._angular],
            self.coefficient,
            along_axis(self.axis - 1),
            Law(kind.law, **{_IN_LAW[key]: value for key, value in present.items()}),
            inner=tuple(present),
        )


def _check(number: Number, value: float, where: str) -> None:
    inside = value > number.lowest if number.above else value >= number.lowest
    if np.isfinite(value) and inside:
        return
    expected = 'a finite number'
    if np.isfinite(number.lowest):
        expected = f'{"more than" if number.above else "at least"} {number.lowest:g}'
    raise MachineError(f'{where}: {number.key} is {value}, expected {expected}')
