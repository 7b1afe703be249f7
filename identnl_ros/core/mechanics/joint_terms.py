# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Scalar elements that joints are made of, and checks that joints share."""

from dataclasses import dataclass

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.laws import Law
import numpy as np
from numpy.typing import NDArray

PRELOAD = 'preload'
EXPONENT = 'exponent'
GAP = 'gap'
TRANSITION = 'transition_velocity'
FADING = 'stribeck_velocity'
LIMIT = 'limit'


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
    inner : tuple of str
        Inner parameters of the joint that the law follows, e.g. `PRELOAD`, `EXPONENT`, `GAP`.
    factor_slope : float
        Derivative of `factor` by the joint's exponent.

    """

    key: str
    symbol: str
    unit: str
    coefficient: Coefficient
    direction: NDArray[np.float64]
    law: Law
    factor: float = 1.0
    inner: tuple[str, ...] = ()
    factor_slope: float = 0.0


@dataclass(frozen=True)
class InnerParameter:
    """
    A number of a joint that enters its forces other than as their coefficient.

    Parameters
    ----------
    key : str
        Parameter within the joint, e.g. `PRELOAD`, `EXPONENT` or `GAP`.
    symbol : str
        Symbol of the literature, e.g. ``delta_0``.
    unit : str
        SI.
    coefficient : Coefficient

    """

    key: str
    symbol: str
    unit: str
    coefficient: Coefficient


def check_point(point: NDArray[np.float64], where: str) -> None:
    """
    Refuse what is no point.

    Parameters
    ----------
    point : ndarray
    where : str
        Begin of the error.

    Raises
    ------
    MachineError
        If it is not three finite numbers.

    """
    if point.shape != (3,) or not np.all(np.isfinite(point)):
        raise MachineError(f'{where}: point must be three finite numbers')


def unit_vector(vector: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """
    Normalise a direction.

    Parameters
    ----------
    vector : ndarray
    where : str
        Begin of the error.

    Returns
    -------
    ndarray, shape (3,)

    Raises
    ------
    MachineError
        If it is zero or not three finite numbers.

    """
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise MachineError(f'{where}: expected three finite numbers, found {vector.tolist()}')
    length = np.linalg.norm(vector)
    if length < 1e-12:
        raise MachineError(f'{where}: the vector is zero, expected a direction')
    return vector / length


def along_axis(axis: int) -> NDArray[np.float64]:
    """
    Direction of one component of a joint's deformation.

    Parameters
    ----------
    axis : int
        From 0: along axes 1 to 3, about axes 1 to 3.

    Returns
    -------
    ndarray, shape (6,)

    """
    direction = np.zeros(6)
    direction[axis] = 1.0
    return direction
