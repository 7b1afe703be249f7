# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Simulated motion with its derivatives by the unknowns and by the initial state."""

from dataclasses import dataclass
from typing import Any

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.mechanics.modes import stiffest_state_matrix
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.integrator import NODES, STAGES
from identnl_ros.core.simulation.sensitivity_kernels import stage_states, variations
from identnl_ros.core.simulation.simulation import (
    equations_of,
    LARGEST_MOTION,
    REFINEMENTS,
)
import numpy as np
from numpy.typing import NDArray

# Largest step times the fastest eigenvalue. At twice as much, errors of the acceleration (8e-6)
# biased estimates by half a standard error where sensors are ten times quieter than usual.
STEP_LIMIT = 0.6
CHUNK = 256  # samples
LARGEST_STEPS = 1024  # per sample: faster motion is no measurement's


@dataclass(frozen=True)
class MotionVariation:
    """
    Motion at equally spaced instants and its derivatives.

    Parameters
    ----------
    motion : ndarray, shape (n_instants, 3, n_coordinates)
        Displacement, velocity, acceleration [m, rad and per s, per s^2].
    derivatives : ndarray, shape (n_instants, 3, n_coordinates, n_columns)
        By the unknowns in the order of `Model.estimated`, the initial displacement and the
        initial velocity, per unit of each; without columns where not asked for.

    """

    motion: NDArray[np.float64]
    derivatives: NDArray[np.float64]


@dataclass
class VariedSimulation:
    """
    One run of a machine with sensitivities, advanced piece by piece.

    Parameters
    ----------
    model : Model
        All values known.
    signals : tuple of Signal
        One for every excitation point of the machine.
    interval : float
        Between outputs [s].
    displacement, velocity : ndarray, shape (n_coordinates,)
        Initial state.
    start : float
        Time of the initial state on the clock of the signals [s].
    step_limit : float
        Largest integration step times the fastest eigenvalue [-].
    steps : int
        Integration steps per output, at least; raised where the machine needs more.
    sensitive : bool
        False: the motion alone.

    Raises
    ------
    MachineError
        If a value of the machine is not known.

    """

    model: Model
    signals: tuple[Signal, ...]
    interval: float
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    start: float = 0.0
    step_limit: float = STEP_LIMIT
    steps: int = 1
    sensitive: bool = True

    def __post_init__(self) -> None:
        """Prepare the arrays of the compiled kernels."""
        self._equations: tuple[Any, ...] = equations_of(self.model).arrays
        self._derivatives = ForceDerivatives(self.model)
        self._index = 0
        n = len(self.model.coordinates)
        unknowns = len(self.model.estimated)
        self._variation = np.zeros((2 * n, unknowns + 2 * n))
        self._variation[:, unknowns:] = np.eye(2 * n)
        rest = np.zeros((1, n)) + self.displacement
        self.steps = max(self.steps, self._steps_for(rest))

    def advance(self, count: int) -> MotionVariation:
        """
        Integrate over a number of intervals.

        Parameters
        ----------
        count : int
            Number of output instants; the first is the current one.

        Returns
        -------
        MotionVariation

        Raises
        ------
        MachineError
            If the motion grows beyond all bounds.

        """
        for _ in range(REFINEMENTS):
            step = self.interval / self.steps
            *stages, displacement, velocity = stage_states(
                self.displacement, self.velocity, step, self._stage_forces(count),
                *self._equations,
            )  # fmt: skip
            self._require_bounded(stages[0])
            needed = self._steps_for(stages[0][:: self.steps, 0])
            if needed <= self.steps:
                break
            self.steps = needed
        motion = np.stack([stage[:: self.steps, 0] for stage in stages], axis=1)
        derivatives = (
            self._varied(stages, step) if self.sensitive else np.empty((*motion.shape, 0))
        )
        self.displacement, self.velocity = displacement, velocity
        self._index += count
        return MotionVariation(motion, derivatives)

    def _varied(self, stages: list[NDArray[np.float64]], step: float) -> NDArray[np.float64]:
        """Integrate the sensitivities along the motion, (n_instants, 3, n, n_columns)."""
        model = self.model
        n = len(model.coordinates)
        shape = stages[0].shape[:2]
        flat = [stage.reshape(-1, n) for stage in stages]
        forcing = self._derivatives.of_motion(*flat).reshape(*shape, n, -1)
        slopes, damping = line_slopes(model, flat[0], flat[1])
        varying = np.ptp(slopes, axis=0) > 0
        constant = np.where(varying, 0.0, slopes[0])
        kept, self._variation = variations(
            self._variation,
            step,
            self.steps,
            np.ascontiguousarray(slopes[:, varying]).reshape(*shape, -1),
            np.ascontiguousarray(model.lines[varying]),
            (model.lines.T * constant) @ model.lines,
            damping,
            1 / model.mass_diagonal(),
            np.ascontiguousarray(forcing),
        )
        result: NDArray[np.float64] = kept.reshape(len(kept), 3, n, -1)
        return result

    def _stage_forces(self, count: int) -> NDArray[np.float64]:
        step = self.interval / self.steps
        start = self.start + self._index * self.interval
        forces = np.empty((count * self.steps, STAGES, len(self.signals)))
        for stage, node in enumerate(NODES):
            for column, signal in enumerate(self.signals):
                forces[:, stage, column] = signal.on_grid(
                    start + node * step, step, count * self.steps
                )
        return forces

    def _steps_for(self, displacements: NDArray[np.float64]) -> int:
        matrix = stiffest_state_matrix(self.model, displacements)
        fastest = float(np.abs(np.linalg.eigvals(matrix)).max())
        steps = self.interval * fastest / self.step_limit
        if steps > LARGEST_STEPS:
            raise MachineError(
                f'machine {self.model.machine.name}: {fastest:.3g} rad/s is too fast to be '
                f'followed at intervals of {self.interval:.3g} s'
            )
        return max(1, int(np.ceil(steps)))

    def _require_bounded(self, displacements: NDArray[np.float64]) -> None:
        finite = np.asarray(np.isfinite(displacements).all(axis=(1, 2)))
        finite[finite] = np.abs(displacements[finite]).max(axis=(1, 2)) < LARGEST_MOTION
        if not finite.all():
            step = self.interval / self.steps
            time = self.start + self._index * self.interval + step * int(np.argmin(finite))
            raise MachineError(
                f'machine {self.model.machine.name}: the motion grows without bound at about '
                f'{time:.4g} s; check for negative stiffness or damping, or too large a force'
            )


def line_slopes(
    model: Model, displacement: NDArray[np.float64], velocity: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Differentiate the joint forces by the state, at many states.

    Parameters
    ----------
    model : Model
    displacement, velocity : ndarray, shape (n_states, n_coordinates)

    Returns
    -------
    stiffness : ndarray, shape (n_states, n_lines)
        Slope of every line's force by its deformation [N/m or N m/rad].
    damping : ndarray, shape (n_coordinates, n_coordinates)
        Derivative of the generalised force by the velocity, the same at all states.

    """
    deformation = displacement @ model.lines.T
    slopes = np.zeros_like(deformation)
    for term in model.terms:
        value = model.parameters[term.parameter].value * term.factor
        slope = term.law.stiffness(deformation[:, term.line])
        # A power below one is infinitely steep at a point, where it has no stiffness to add.
        slopes[:, term.line] += value * np.where(np.isfinite(slope), slope, 0.0)
    return slopes, model.damping_matrix()
