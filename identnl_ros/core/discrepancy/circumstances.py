# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What effects are told of a record: how far joints move, what sensors should read, the motion."""

from collections.abc import Mapping
from dataclasses import dataclass

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class Scale:
    """
    How far and how fast joints move in the data, and what stands out of the residual.

    Parameters
    ----------
    deformation, rate : mapping of (str, int) to float
        Largest value along (or about) each axis of each joint [m, rad and per s].
    frequencies : tuple of float
        Of lines that stand out of the spectrum of the residual [Hz].

    """

    deformation: Mapping[tuple[str, int], float]
    rate: Mapping[tuple[str, int], float]
    frequencies: tuple[float, ...] = ()


@dataclass(frozen=True)
class Signals:
    """
    Motion as the sensors of a layout should read it, for effects of sensors.

    Parameters
    ----------
    time : ndarray, shape (n_samples,)
        Since the begin of the stream [s].
    readings, rates : mapping of str to ndarray, shape (n_samples,)
        What each sensor should read, and its derivative by time [SI unit, and per s].
    triads : mapping of str to ndarray, shape (n_samples, 3)
        What it would read along the axes of the machine frame.
    kinds : mapping of str to SensorKind
    directions : mapping of str to ndarray, shape (3,)
        As in the layout.

    """

    time: Reals
    readings: Mapping[str, Reals]
    rates: Mapping[str, Reals]
    triads: Mapping[str, Reals]
    kinds: Mapping[str, SensorKind]
    directions: Mapping[str, Reals]


@dataclass(frozen=True)
class Course:
    """
    Everything that is known along a record, for effects of `AddedForce`.

    Parameters
    ----------
    description : Description
    model : Model
        Assembled from its machine, with the values that fit best.
    time : ndarray, shape (n_samples,)
        Since the begin of the stream [s], equally spaced.
    displacement, velocity, acceleration : ndarray, shape (n_samples, n_coordinates)
        The nominal motion.
    force : ndarray, shape (n_samples, n_excitations)
        As measured [N].

    """

    description: Description
    model: Model
    time: Reals
    displacement: Reals
    velocity: Reals
    acceleration: Reals
    force: Reals
