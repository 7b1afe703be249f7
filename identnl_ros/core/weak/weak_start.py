# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Weak-form least squares: estimates from the measured motion alone, to start better ones from.

The equations of motion, multiplied by test functions and integrated, need no derivative of the
displacement, and noise is averaged over the length of a test function (Messenger and Bortz 2021;
Bortz, Messenger and Dukic 2023, Bulletin of Mathematical Biology 85, 110). Windows are weighted
with the covariance that sensor noise gives them at the mean stiffness of the record.
"""

from collections.abc import Sequence
from dataclasses import replace

from identnl_ros.core.algebra.information import Information, Solution
from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.regression import PointwiseRegression
from identnl_ros.core.measurement.motion_record import MotionRecord
from identnl_ros.core.measurement.motion_weights import MotionWeights
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.weak.weighting_function import WeightingFunction
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

ROUNDS = 3
# States at which the mean stiffness is taken.
STATES = 64
# Error of the integrals over a window, relative to the forces in it.
INEXACT = 1e-4
# An estimate below this fraction of its like is no start for a simulation.
SMALLEST_SHARE = 0.02
# Symbols of what may have either sign: amplitudes of periodic forces, rates of stiffness.
EITHER_SIGN = {'F_cos', 'F_sin', 'k_t'}

Windows = tuple[Reals, Reals]


def weak_form_start(
    model: Model,
    records: Sequence[MotionRecord],
    weights: MotionWeights,
    function: WeightingFunction,
) -> Model:
    """
    Estimate all coefficients from the measured motion.

    Parameters
    ----------
    model : Model
        Preloads and exponents keep the values they have here.
    records : sequence of MotionRecord
    weights : MotionWeights
    function : WeightingFunction

    Returns
    -------
    Model
        With the estimates; those that the data do not determine, or that come out negative, are
        small and positive.

    Raises
    ------
    DataError
        If nothing moves.

    """
    linear = replace(
        model,
        parameters=tuple(
            replace(one, estimated=one.estimated and not one.inner) for one in model.parameters
        ),
    )
    if not linear.estimated:
        return model
    records = [record.bridged() for record in records]
    windows = [_windows(linear, record, weights, function) for record in records]
    regressor = np.concatenate([one[0] for one in windows])
    target = np.concatenate([one[1] for one in windows])
    values = linear.values
    unknowns = list(linear.estimated)
    values[unknowns] = 0.0
    present = linear.with_values(values)
    displacement = np.concatenate([record.displacement for record in records])
    displacement = displacement[np.isfinite(displacement).all(axis=1)]
    displacement = displacement[:: max(1, len(displacement) // STATES)]
    for _ in range(ROUNDS):
        solution = _weighted(present, regressor, target, displacement, weights, function)
        values[unknowns] = _positive(linear, solution)
        present = linear.with_values(values)
    return model.with_values(present.values)


def _windows(
    model: Model, record: MotionRecord, weights: MotionWeights, function: WeightingFunction
) -> Windows:
    """Integrate the rows of the regression: (n_windows, n, n_unknowns), (n_windows, n)."""
    regression = PointwiseRegression(model)
    n = record.displacement.shape[1]
    nothing = np.zeros_like(record.displacement)
    force = record.force @ model.excitation_directions
    measured = {kind for kind, _ in weights.matrices}

    # What acts at rest is the same at all instants, but for periodic forces.
    resting = len(record) if model.time_dependent else 1

    def parts(
        order: int, displacement: Reals, velocity: Reals, acceleration: Reals, force: Reals
    ) -> Windows:
        """Integrate against a derivative of the test function what is linear in the rest."""
        regressor, target = regression.rows(
            displacement, velocity, acceleration, force, record.time
        )
        still = nothing[:resting]
        still_regressor, still_target = regression.rows(
            still, still, still, still, record.time[:resting]
        )
        shape = len(displacement), n, -1
        # Constant parts belong to the elastic forces alone.
        if order or displacement is nothing:
            regressor = regressor.reshape(shape) - still_regressor.reshape(resting, n, -1)
            target = target.reshape(shape[:2]) - still_target.reshape(resting, n)
        sign = -1.0 if order == 1 else 1.0
        of = sign * (function.derivative(order) if order else function.values)
        return (
            function.windows(regressor.reshape(shape), of),
            function.windows(target.reshape(shape[:2]), of),
        )

    displacement = record.displacement
    summed = [parts(0, displacement, nothing, nothing, force)]
    if 1 in measured:
        summed.append(parts(0, nothing, record.velocity, nothing, nothing))
    else:
        summed.append(parts(1, nothing, displacement, nothing, nothing))
    if 2 in measured:
        summed.append(parts(0, nothing, nothing, record.acceleration, nothing))
    else:
        summed.append(parts(2, nothing, nothing, displacement, nothing))
    regressor, target = (np.sum([one[i] for one in summed], axis=0) for i in range(2))
    valid = np.isfinite(target).all(axis=1)
    return regressor[valid], target[valid]


def _weighted(
    model: Model,
    regressor: Reals,
    target: Reals,
    displacement: Reals,
    weights: MotionWeights,
    function: WeightingFunction,
) -> Solution:
    """Solve with the covariance of the windows at the mean stiffness of the record."""
    stiffness = np.mean([model.tangent_stiffness(one) for one in displacement], axis=0)
    gains: dict[int, Reals] = {0: stiffness, 1: model.damping_matrix(), 2: np.diag(
        model.mass_diagonal()
    )}  # fmt: skip
    covariances = {
        kind: one for (kind, _), one in zip(weights.matrices, weights.covariances, strict=True)
    }
    covariance = np.zeros_like(stiffness)
    for kind, gain in gains.items():
        # What is not measured is the displacement, summed by parts.
        order = 0 if kind in covariances else kind
        kernel = function.derivative(order) if order else function.values
        noise = covariances.get(kind, covariances[0])
        covariance += kernel @ kernel * (gain @ noise @ gain.T)
    # Quadrature is not exact either; and where nothing is known yet, nothing has a size.
    forces = (target**2).mean(axis=0)
    covariance += np.diag(INEXACT**2 * np.maximum(forces, INEXACT**2 * forces.max()))
    scale = np.sqrt(np.diag(covariance))
    if not np.all(scale > 0):
        raise DataError('nothing moves, or no force acts')
    whitening = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(scale, scale))) / scale
    size = regressor.shape[2]
    return (
        Information.empty(size)
        .with_rows((whitening @ regressor).reshape(-1, size), (target @ whitening.T).reshape(-1))
        .solve()
    )


def _positive(model: Model, solution: Solution) -> Reals:
    """Replace what cannot be simulated by a small share of its like in other joints."""
    symbols = np.array([model.parameters[i].symbol for i in model.estimated])
    values = solution.values.copy()
    sizes = np.abs(values)
    for symbol in set(symbols) - EITHER_SIGN:
        like = symbols == symbol
        floor = SMALLEST_SHARE * float(np.median(sizes[like]))
        values[like] = np.maximum(values[like], floor)
    return values
