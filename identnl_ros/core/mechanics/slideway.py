# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Slideway joint: nonlinear contact, tangential stiffness and damping of a guideway."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.joint_terms import (
    along_axis,
    check_point,
    EXPONENT,
    InnerParameter,
    JointTerm,
    PRELOAD,
    unit_vector,
)
from identnl_ros.core.mechanics.laws import Law, LawKind
import numpy as np
from numpy.typing import NDArray

NORMAL_AXES = (0, 4, 5)
TANGENTIAL_AXES = (1, 2, 3)

# While an exponent is estimated, a_n is what makes the force at this deformation the same for
# every exponent [m].
REFERENCE_DEFORMATION = 1e-6


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
        a_n [N/m^m]. Where the exponent is estimated, its unit remains that of the start
        exponent m_0 and the pressure is ``a_n s^(m_0 - m) delta^m`` with s = 1 um: a_n alone
        sets the force at 1 um, and is the number of daN/um^m for every m. (SI's a_n would be
        the force at 1 m, far from any data, and change by a factor 10^6 with m by one.)
    tangential_stiffness : Coefficient
        a_t [N/m].
    normal_damping, tangential_damping : Coefficient
        h_n and h_t [N/m] where `damping_frequency` is given, else c_n and c_t [N s/m].
    damping_frequency : float or None
        Frequency at which hysteretic coefficients hold [Hz]; None: viscous coefficients.
    exponent : Coefficient
        m of the normal direction [-]; a plain number is a known one.
    preload : Coefficient
        Compression at rest delta_0 [m]; a plain number is a known one.
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
    exponent: Coefficient = field(default_factory=lambda: Coefficient(2.0))
    preload: Coefficient = field(default_factory=lambda: Coefficient(0.0))
    coupled: bool = False
    gauss_points: int = 4
    kind: ClassVar[str] = 'slideway'

    def __post_init__(self) -> None:
        """Check ranges; make the axes unit vectors."""
        where = f'joint {self.name}'
        check_point(self.point, where)
        normal, longitudinal = (
            unit_vector(vector, f'{where}: {name}')
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
        for name in ('length', 'width'):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise MachineError(
                    f'{where}: {name} is {getattr(self, name)}, expected a positive number'
                )
        for name in (EXPONENT, PRELOAD):
            if not isinstance(getattr(self, name), Coefficient):
                object.__setattr__(self, name, Coefficient(float(getattr(self, name))))
            coefficient: Coefficient = getattr(self, name)
            open_value = coefficient.estimated or coefficient.tie is not None
            if not (open_value and np.isnan(coefficient.value)):
                _check_inner(name, coefficient.value, where)
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

    @property
    def inner(self) -> tuple[InnerParameter, ...]:
        """Preload and exponent."""
        return (
            InnerParameter(PRELOAD, 'delta_0', 'm', self.preload),
            InnerParameter(EXPONENT, 'm', '1', self.exponent),
        )

    def starting_at(self, values: Mapping[str, float]) -> 'Slideway':
        """
        Copy with other start values of preload and exponent.

        Parameters
        ----------
        values : mapping of str to float
            By key, SI; what is not in it remains.

        Returns
        -------
        Slideway

        Raises
        ------
        MachineError
            If a preload is negative or an exponent not positive.

        """
        preload, exponent = (
            replace(one.coefficient, value=values.get(one.key, one.coefficient.value))
            for one in self.inner
        )
        return replace(self, preload=preload, exponent=exponent)

    def terms(self, inner: Mapping[str, float] | None = None) -> Iterator[JointTerm]:
        """
        Yield the scalar elements of the joint.

        Parameters
        ----------
        inner : mapping of str to float, optional
            Present values of preload [m] and exponent [-], by key; NaN: not known. By default
            those of the joint.

        Yields
        ------
        JointTerm

        Raises
        ------
        MachineError
            If the preload is negative or the exponent not positive.

        """
        present = {one.key: one.coefficient.value for one in self.inner} | dict(inner or {})
        for key, value in present.items():
            if not np.isnan(value):
                _check_inner(key, value, f'joint {self.name}')
        yield from self._normal_stiffness_terms(present[EXPONENT], present[PRELOAD])
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
                along_axis(axis),
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
                    along_axis(axis),
                    Law(LawKind.VISCOUS),
                    scale * moments[axis],
                )

    def _normal_stiffness_terms(self, m: float, preload: float) -> Iterator[JointTerm]:
        start = self.exponent.value
        unit = 'N/m' if start == 1 else f'N/m^{start:.12g}'
        head = ('normal_stiffness', 'a_n', unit, self.normal_stiffness)
        scale = REFERENCE_DEFORMATION ** (start - m)
        # Relative change of the scale with the exponent.
        growth = -np.log(REFERENCE_DEFORMATION)
        if not self.coupled:
            law = Law(LawKind.SIGNED_POWER, m, preload)
            yield JointTerm(
                *head,
                along_axis(0),
                law,
                scale,
                inner=(PRELOAD, EXPONENT),
                factor_slope=growth * scale,
            )
            for axis, side in ((4, self.width), (5, self.length)):
                factor = scale * 2 * (side / 2) ** (m + 2) / (side * (m + 2))  # (9b), (9c)
                yield JointTerm(
                    *head,
                    along_axis(axis),
                    Law(LawKind.SIGNED_POWER, m),
                    factor,
                    inner=(EXPONENT,),
                    factor_slope=factor * (growth + np.log(side / 2) - 1 / (m + 2)),
                )
            return
        nodes, weights = np.polynomial.legendre.leggauss(self.gauss_points)
        for y, weight_y in zip(nodes * self.length / 2, weights / 2, strict=True):
            for z, weight_z in zip(nodes * self.width / 2, weights / 2, strict=True):
                factor = scale * weight_y * weight_z
                yield JointTerm(
                    *head,
                    np.array([1.0, 0.0, 0.0, 0.0, z, -y]),
                    Law(LawKind.CONTACT, m, preload),
                    factor,
                    inner=(PRELOAD, EXPONENT),
                    factor_slope=growth * factor,
                )


def _check_inner(key: str, value: float, where: str) -> None:
    if key == PRELOAD and not (np.isfinite(value) and value >= 0):
        raise MachineError(f'{where}: preload is {value} m, expected 0 or a positive number')
    if key == EXPONENT and not (np.isfinite(value) and value > 0):
        raise MachineError(f'{where}: exponent is {value}, expected a positive number')
