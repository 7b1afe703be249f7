# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How the equations of motion depend on the unknowns."""

from dataclasses import dataclass

from identnl_ros.core.model import Model
from identnl_ros.core.regression import PointwiseRegression
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ForceDerivatives:
    """
    Derivatives of the left-hand side of the equations of motion by the unknowns.

    Left-hand side: inertia and joint forces minus constant loads, (1) of Berczynski et al. (2010).

    Parameters
    ----------
    model : Model
        Its values are those at which the derivatives are taken.

    """

    model: Model

    def of_motion(
        self,
        displacement: NDArray[np.float64],
        velocity: NDArray[np.float64],
        acceleration: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """
        Differentiate at a number of states.

        Parameters
        ----------
        displacement, velocity, acceleration : ndarray, shape (n_states, n_coordinates)

        Returns
        -------
        ndarray, shape (n_states, n_coordinates, n_unknowns)
            [N or N m, per unit of the unknown].

        """
        regressor, _ = PointwiseRegression(self.model).rows(
            displacement, velocity, acceleration, np.zeros_like(displacement)
        )
        return regressor.reshape(*displacement.shape, -1)
