# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Settings, points and outcome of the search of a likelihood fit."""

from dataclasses import dataclass

from identnl_ros.core.likelihood.likelihood_record import PreparedRecord
from identnl_ros.core.likelihood.nuisance import Step
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LikelihoodSettings:
    """
    How to search.

    Parameters
    ----------
    iterations : int
        Linearisations at most.
    tolerance : float
        The search ends with a step of this many standard errors (root mean square over the
        unknowns); what is left then is the square of it, or a thousandth [-].
    step_limit : float or None
        Integration step times fastest eigenvalue; None: 0.6, and 0.3 for data without noise.
    pieces : bool
        Begin with short pieces of the records, for a start far from the solution.
    keep_residuals : bool
        Return the residuals of all samples.

    """

    iterations: int = 30
    tolerance: float = 0.1
    step_limit: float | None = None
    pieces: bool = True
    keep_residuals: bool = False


@dataclass(frozen=True)
class Point:
    """
    Values of all unknowns.

    Parameters
    ----------
    common : ndarray, shape (n_unknowns + n_sensor_unknowns,)
    states : tuple of ndarray, each shape (2 * n_coordinates,)
        Initial displacement and velocity of each record.

    """

    common: NDArray[np.float64]
    states: tuple[NDArray[np.float64], ...]

    def model_of(self, model: Model) -> Model:
        """
        Give the model its values at this point.

        Parameters
        ----------
        model : Model

        Returns
        -------
        Model

        """
        values = model.values
        values[list(model.estimated)] = self.common[: len(model.estimated)]
        return model.with_values(values)

    def moved(self, step: Step, fraction: float) -> 'Point':
        """
        Go a fraction of a step.

        Parameters
        ----------
        step : Step
        fraction : float

        Returns
        -------
        Point

        """
        return Point(
            self.common + fraction * step.common,
            tuple(
                state + fraction * own for state, own in zip(self.states, step.own, strict=True)
            ),
        )


@dataclass(frozen=True)
class Outcome:
    """
    Where a search ended.

    Parameters
    ----------
    point : Point
    step : Step
        Undamped, from the last linearisation.
    converged : bool
    reason : str
    iterations : int

    """

    point: Point
    step: Step
    converged: bool
    reason: str
    iterations: int


def start_of(model: Model, records: list[PreparedRecord], sensor_unknowns: int) -> Point:
    """
    Begin at the values of the model and the states found from the first samples.

    Parameters
    ----------
    model : Model
    records : list of PreparedRecord
    sensor_unknowns : int
        Start at zero.

    Returns
    -------
    Point

    """
    return Point(
        np.concatenate((model.values[list(model.estimated)], np.zeros(sensor_unknowns))),
        tuple(
            np.concatenate((record.initial_displacement, record.initial_velocity))
            for record in records
        ),
    )
