# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Rows of the pointwise regression ``Phi(q, q', q'') x = Y``, (31)-(35) and (41)-(44).

Every instant gives one row per coordinate. Known parts of the equations of motion stand in Y,
unknown ones in Phi; all are linear in the unknown coefficients x.
"""

from dataclasses import dataclass

from identnl_ros.core.model import Model
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PointwiseRegression:
    """
    Regression rows of a model.

    Parameters
    ----------
    model : Model

    """

    model: Model

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.model.estimated)

    def rows(
        self,
        displacement: NDArray[np.float64],
        velocity: NDArray[np.float64],
        acceleration: NDArray[np.float64],
        force: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Evaluate regressor and target at a number of instants.

        Parameters
        ----------
        displacement, velocity, acceleration, force : ndarray, shape (n_samples, n_coordinates)
            As in `MotionBlock`.

        Returns
        -------
        regressor : ndarray, shape (n_samples * n_coordinates, n_unknowns)
            Phi of (41).
        target : ndarray, shape (n_samples * n_coordinates,)
            Y of (41) [N, N m].

        """
        model = self.model
        n_samples, n_coordinates = displacement.shape
        column = {parameter: i for i, parameter in enumerate(model.estimated)}
        deformation = displacement @ model.lines.T
        rate = velocity @ model.lines.T
        known = np.zeros_like(deformation)
        unknown: dict[int, dict[int, NDArray[np.float64]]] = {}
        for term in model.terms:
            line = term.line
            force_on_line = term.factor * term.law.force(deformation[:, line], rate[:, line])
            if term.parameter not in column:
                known[:, line] += model.parameters[term.parameter].value * force_on_line
                continue
            lines = unknown.setdefault(column[term.parameter], {})
            lines[line] = lines[line] + force_on_line if line in lines else force_on_line
        target = force - model.rotary_inertia * acceleration - known @ model.lines
        regressor = np.zeros((n_samples, n_coordinates, self.size))
        for index, lines in unknown.items():
            regressor[:, :, index] = (
                np.column_stack(list(lines.values())) @ model.lines[list(lines)]
            )
        for parameter, diagonal in model.mass_vectors:
            if parameter in column:
                regressor[:, :, column[parameter]] += diagonal * acceleration
            else:
                target -= model.parameters[parameter].value * diagonal * acceleration
        for load in model.loads:
            if load.parameter in column:
                regressor[:, :, column[load.parameter]] -= load.vector
            else:
                target += model.parameters[load.parameter].value * load.vector
        return regressor.reshape(-1, self.size), target.reshape(-1)
