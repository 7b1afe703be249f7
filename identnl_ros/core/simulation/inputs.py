# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the equations of motion take as functions of time: measured and periodic forces, time."""

from dataclasses import dataclass

from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import Harmonics, Signal
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Clock:
    """
    Time itself.

    Parameters
    ----------
    origin : float
        Shown at zero on the clock of the signals [s].

    """

    origin: float

    def on_grid(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        """Evaluate at equally spaced instants [s] (see `Signal`)."""
        return np.asarray(self.origin + start + step * np.arange(count), np.float64)


def inputs_of(
    model: Model, signals: tuple[Signal, ...], origin: float = 0.0
) -> tuple[Signal, ...]:
    """
    Complete the signals of the exciters.

    Parameters
    ----------
    model : Model
    signals : tuple of Signal
        One for every excitation point of the machine.
    origin : float
        Time since the begin of the stream at zero on the clock of the signals [s].

    Returns
    -------
    tuple of Signal
        Those of the exciters, those of the periodic forces in the order of
        `Model.periodic_loads`, each of amplitude one, and the time since the begin of the stream.

    """
    # A cosine is a sine that is ahead by a quarter of a period.
    periodic = tuple(
        Harmonics(
            np.ones(1),
            np.array([wave.frequency]),
            np.array([wave.phase + np.pi / 2 + 2 * np.pi * wave.frequency * origin]),
        )
        for _, wave in model.periodic_loads
    )
    return (*signals, *periodic, Clock(origin))


def input_directions(model: Model) -> NDArray[np.float64]:
    """
    Give the generalised forces of the inputs that are forces.

    Parameters
    ----------
    model : Model

    Returns
    -------
    ndarray, shape (n_excitations + n_periodic, n_coordinates)
        Per unit of all signals of `inputs_of` but the last, which is the time.

    """
    periodic = [
        model.parameters[load.parameter].value * load.vector for load, _ in model.periodic_loads
    ]
    return np.ascontiguousarray(np.vstack((model.excitation_directions, *periodic)))


def on_grid(
    inputs: tuple[Signal, ...], start: float, step: float, count: int
) -> NDArray[np.float64]:
    """
    Evaluate signals at equally spaced instants.

    Parameters
    ----------
    inputs : tuple of Signal
    start, step : float
        [s].
    count : int

    Returns
    -------
    ndarray, shape (count, n_inputs)

    """
    return np.column_stack([signal.on_grid(start, step, count) for signal in inputs])
