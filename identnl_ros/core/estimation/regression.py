# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Rows of the pointwise regression ``Phi(q, q', q'') x = Y``, (31)-(35) and (41)-(44).

Every instant gives one row per coordinate. Known parts of the equations of motion stand in Y,
unknown ones in Phi; all are linear in the unknown coefficients x.
"""

from dataclasses import dataclass, field, replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PointwiseRegression:
    """
    Regression rows of a model.

    Parameters
    ----------
    model : Model

    Raises
    ------
    DataError
        If a preload or an exponent is unknown: the equations are not linear in these.

    """

    model: Model
    known: Model = field(init=False, repr=False)
    """The model without what is unknown."""
    _derivatives: ForceDerivatives = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Refuse what is not linear; separate what is known."""
        model = self.model
        for parameter in (model.parameters[i] for i in model.estimated):
            if parameter.inner:
                raise DataError(
                    f'{parameter.name}: the pointwise estimator cannot find it, because forces '
                    'are not proportional to it; use the weak or the likelihood estimator, or '
                    'give it as known'
                )
        known = replace(
            model,
            terms=tuple(term for term in model.terms if self._is_known(term.parameter)),
            mass_vectors=tuple(one for one in model.mass_vectors if self._is_known(one[0])),
            loads=tuple(load for load in model.loads if self._is_known(load.parameter)),
        )
        object.__setattr__(self, 'known', known)
        object.__setattr__(self, '_derivatives', ForceDerivatives(model))

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
        time: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Evaluate regressor and target at a number of instants.

        Parameters
        ----------
        displacement, velocity, acceleration, force : ndarray, shape (n_samples, n_coordinates)
            As in `MotionBlock`.
        time : ndarray, shape (n_samples,), or None
            Since the begin of the stream [s]; needed where forces depend on it.

        Returns
        -------
        regressor : ndarray, shape (n_samples * n_coordinates, n_unknowns)
            Phi of (41).
        target : ndarray, shape (n_samples * n_coordinates,)
            Y of (41) [N, N m].

        Raises
        ------
        MachineError
            If the time is needed and not given.

        """
        known = self.known
        target = force - known.mass_diagonal() * acceleration + known.constant_load()
        times = self.model.times(time, len(displacement))
        target += known.periodic_load(times) - known.joint_force(
            displacement, velocity, time=times
        )
        regressor = self._derivatives.of_motion(displacement, velocity, acceleration, time=times)
        return regressor.reshape(-1, self.size), target.reshape(-1)

    def _is_known(self, parameter: int) -> bool:
        return not self.model.parameters[parameter].estimated
