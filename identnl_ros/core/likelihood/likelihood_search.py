# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The search of a likelihood fit: linearise, step, damp."""

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.errors import MachineError
from identnl_ros.core.likelihood.likelihood_point import (
    LikelihoodSettings,
    Outcome,
    Point,
)
from identnl_ros.core.likelihood.likelihood_record import (
    DELAY_ALLOWANCE,
    PreparedRecord,
)
from identnl_ros.core.likelihood.nuisance import (
    joint_step,
    RecordInformation,
    Step,
    with_many_rows,
)
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.sensitivity import VariedSimulation
import numpy as np
from numpy.typing import NDArray

HALVINGS = 3
# Linearisations of a rough search that move the initial states only.
STATES_FIRST = 1
FIRST_DAMPING = 1e-4
MOST_DAMPING = 1e8
# A rough search stops at steps of this many standard errors, or of this relative size.
ROUGH_STEP = 1.0
ROUGH_CHANGE = 1e-3
# Relative change of an unknown that is rounding.
ROUNDING = 1e-13


def search(
    model: Model,
    records: list[PreparedRecord],
    start: Point,
    settings: LikelihoodSettings,
    step_limit: float,
    rough: bool = False,
) -> Outcome:
    """
    Minimise the sum of squared residuals.

    Parameters
    ----------
    model : Model
    records : list of PreparedRecord
    start : Point
    settings : LikelihoodSettings
    step_limit : float
        Integration step times fastest eigenvalue.
    rough : bool
        Only come near, the initial states before the rest.

    Returns
    -------
    Outcome

    Raises
    ------
    MachineError
        If the machine cannot be simulated at the start.

    """
    point, damping = start, 0.0
    for iteration in range(1, settings.iterations + 1):
        linear = [
            _linearised(model, record, point, i, step_limit) for i, record in enumerate(records)
        ]
        cost = sum(float(np.sum(one.information.factor[:, -1] ** 2)) for one in linear)
        held = rough and iteration <= STATES_FIRST
        newton = joint_step(linear, common_held=held)
        change = _relative(newton, point)
        if rough and not held and (newton.size <= ROUGH_STEP or change < ROUGH_CHANGE):
            return Outcome(point, newton, False, 'rough search', iteration)
        small = not held and (newton.size <= settings.tolerance or change < ROUNDING)
        accepted = None
        while accepted is None:
            step = newton if damping == 0 else joint_step(linear, damping, held)
            for halving in range(1 if small else HALVINGS):
                trial = point.moved(step, 0.5**halving)
                trial_cost = _cost(model, records, trial, step_limit)
                if trial_cost < cost:
                    accepted = trial
                    break
            if accepted is not None:
                damping = damping / 10 if damping > FIRST_DAMPING else 0.0
            elif small:
                # At the minimum, to rounding: the cost no longer tells which is lower.
                return Outcome(point, newton, True, _success(newton), iteration)
            else:
                damping = max(10 * damping, FIRST_DAMPING)
                if damping > MOST_DAMPING:
                    reason = (
                        'not converged: no step lowers the residual, though the last one '
                        f'proposed was {newton.size:.2g} standard errors long'
                    )
                    return Outcome(point, newton, False, reason, iteration)
        point = accepted
        if small:
            return Outcome(point, newton, True, _success(newton), iteration)
    reason = (
        f'not converged: after {settings.iterations} iterations the last step was still '
        f'{newton.size:.2g} standard errors long'
    )
    return Outcome(point, newton, False, reason, settings.iterations)


def residuals_at(
    model: Model, records: list[PreparedRecord], point: Point, step_limit: float
) -> list[NDArray[np.float64]]:
    """
    Compare measurement and simulation.

    Parameters
    ----------
    model : Model
    records : list of PreparedRecord
    point : Point
    step_limit : float
        As in `search`.

    Returns
    -------
    list of ndarray, each shape (n_samples, n_motion_channels)
        Measured minus simulated, in standard deviations; 0 where not valid.

    Raises
    ------
    MachineError
        If the machine cannot be simulated there.

    """
    result = []
    for record, state in zip(records, point.states, strict=True):
        simulation = _simulation(model, record, point, state, step_limit, sensitive=False)
        numbers = point.common[len(model.estimated) :]
        parts = [
            prediction.readings
            for prediction in record.prediction.run(simulation, len(record.measured), numbers)
        ]
        result.append((record.measured - np.concatenate(parts)) * record.weights)
    return result


def _linearised(
    model: Model, record: PreparedRecord, point: Point, index: int, step_limit: float
) -> RecordInformation:
    state = point.states[index]
    simulation = _simulation(model, record, point, state, step_limit, sensitive=True)
    information = Information.empty(len(state) + len(point.common))
    numbers = point.common[len(model.estimated) :]
    for part in record.prediction.run(simulation, len(record.measured), numbers):
        place = slice(part.first, part.first + len(part.readings))
        weights = record.weights[place]
        regressor = part.derivatives
        regressor *= weights[:, :, np.newaxis]
        target = (record.measured[place] - part.readings) * weights
        information = with_many_rows(
            information, regressor.reshape(-1, regressor.shape[2]), target.reshape(-1)
        )
    return RecordInformation(information, len(state))


def _simulation(
    model: Model,
    record: PreparedRecord,
    point: Point,
    state: NDArray[np.float64],
    step_limit: float,
    sensitive: bool,
) -> VariedSimulation:
    half = len(state) // 2
    moved = point.model_of(model)
    if not np.all(moved.mass_diagonal() > 0):
        raise MachineError(f'machine {model.machine.name}: a mass is not positive')
    return VariedSimulation(
        moved,
        record.signals,
        1 / record.sample_rate,
        state[:half].copy(),
        state[half:].copy(),
        start=record.first / record.sample_rate,
        step_limit=step_limit,
        sensitive=sensitive,
        origin=record.origin,
    )


def _cost(model: Model, records: list[PreparedRecord], point: Point, step_limit: float) -> float:
    """Sum of squared residuals; infinite where the machine cannot be simulated."""
    numbers = point.common[len(model.estimated) :]
    for record in records:
        if record.prediction.largest_delay(numbers) > DELAY_ALLOWANCE - 1:
            return float('inf')
    try:
        residuals = residuals_at(model, records, point, step_limit)
    except MachineError:
        return float('inf')
    return float(sum(np.sum(one**2) for one in residuals))


def _relative(step: Step, point: Point) -> float:
    size = np.abs(point.common)
    ratio = np.divide(np.abs(step.common), size, out=np.zeros_like(size), where=size > 0)
    return float(ratio.max(initial=0.0))


def _success(step: Step) -> str:
    return f'converged: the last step was {step.size:.2g} standard errors long'
