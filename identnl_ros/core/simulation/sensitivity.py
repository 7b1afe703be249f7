# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Simulated motion with its derivatives by the unknowns and by the initial state."""

from dataclasses import dataclass, field
from typing import Any

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.force_derivatives import ForceDerivatives
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.equations import equations_of, initial_hidden
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.inputs import inputs_of, on_grid
from identnl_ros.core.simulation.integrator import NODES, STAGES
from identnl_ros.core.simulation.line_slopes import line_slopes
from identnl_ros.core.simulation.sensitivity_kernels import stage_states, variations
from identnl_ros.core.simulation.simulation import fastest_rate, LARGEST_MOTION, REFINEMENTS
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
    hidden : ndarray, shape (n_instants, n_hidden)
        Hysteretic states.

    """

    motion: NDArray[np.float64]
    derivatives: NDArray[np.float64]
    hidden: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))


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
    hidden : ndarray, shape (n_hidden,)
        Initial hysteretic states; by default zero.
    origin : float
        Time since the begin of the stream at zero on the clock of the signals [s]; matters to
        periodic forces and to stiffness that drifts.

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
    hidden: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    origin: float = 0.0

    def __post_init__(self) -> None:
        """Prepare the arrays of the compiled kernels."""
        self._equations: tuple[Any, ...] = equations_of(self.model).arrays
        self._inputs = inputs_of(self.model, self.signals, self.origin)
        self._derivatives = ForceDerivatives(self.model)
        self._index = 0
        self.hidden = initial_hidden(self.model, self.hidden)
        n = len(self.model.coordinates)
        unknowns = len(self.model.estimated)
        self._variation = np.zeros((2 * n, unknowns + 2 * n))
        self._variation[:, unknowns:] = np.eye(2 * n)
        self._hidden_variation = np.zeros((len(self.hidden), unknowns + 2 * n))
        state = (np.zeros((1, n)) + one for one in (self.displacement, self.velocity))
        self.steps = max(self.steps, self._steps_for(0, *state))

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
            inputs = self._stage_inputs(count)
            *stages, hidden, displacement, velocity, inside = stage_states(
                self.displacement, self.velocity, self.hidden, step, inputs, *self._equations
            )
            self._require_bounded(stages[0])
            passed = (stage[:: self.steps, 0] for stage in stages[:2])
            needed = self._steps_for(count, *passed)
            if needed <= self.steps:
                break
            self.steps = needed
        motion = np.stack([stage[:: self.steps, 0] for stage in stages], axis=1)
        derivatives = (
            self._varied(stages, hidden, inputs[:, :, -1], step)
            if self.sensitive
            else np.empty((*motion.shape, 0))
        )
        self.displacement, self.velocity, self.hidden = displacement, velocity, inside
        self._index += count
        return MotionVariation(motion, derivatives, hidden[:: self.steps, 0])

    def _varied(
        self,
        stages: list[NDArray[np.float64]],
        hidden: NDArray[np.float64],
        time: NDArray[np.float64],
        step: float,
    ) -> NDArray[np.float64]:
        """Integrate the sensitivities along the motion, (n_instants, 3, n, n_columns)."""
        model = self.model
        n = len(model.coordinates)
        shape = stages[0].shape[:2]
        displacement, velocity, acceleration = (stage.reshape(-1, n) for stage in stages)
        flat_hidden = hidden.reshape(len(displacement), hidden.shape[2])
        times = time.ravel()
        forcing = self._derivatives.of_motion(
            displacement, velocity, acceleration, flat_hidden, times
        )
        found = line_slopes(model, displacement, velocity, flat_hidden, time=times)
        slopes = found.stiffness
        varying = np.ptp(slopes, axis=0) > 0
        constant = np.where(varying, 0.0, slopes[0])
        kept, self._variation, self._hidden_variation = variations(
            self._variation,
            step,
            self.steps,
            np.ascontiguousarray(slopes[:, varying]).reshape(*shape, -1),
            np.ascontiguousarray(model.lines[varying]),
            (model.lines.T * constant) @ model.lines,
            found.damping,
            found.rate.reshape(*shape, found.rate.shape[1]),
            found.rate_lines,
            1 / model.mass_diagonal(),
            np.ascontiguousarray(forcing.reshape(*shape, n, -1)),
            self._hidden_variation,
            found.hidden_slopes.reshape(*shape, hidden.shape[2], 2),
            found.hidden_lines,
            found.hidden_pull,
        )
        result: NDArray[np.float64] = kept.reshape(len(kept), 3, n, -1)
        return result

    def _stage_inputs(self, count: int) -> NDArray[np.float64]:
        step = self.interval / self.steps
        start = self.start + self._index * self.interval
        inputs = np.empty((count * self.steps, STAGES, len(self._inputs)))
        for stage, node in enumerate(NODES):
            inputs[:, stage] = on_grid(self._inputs, start + node * step, step, count * self.steps)
        return inputs

    def _steps_for(
        self, ahead: int, displacements: NDArray[np.float64], velocities: NDArray[np.float64]
    ) -> int:
        """Find the steps for states that were passed up to a number of samples ahead."""
        time = self.origin + self.start + (self._index + ahead) * self.interval
        fastest = fastest_rate(self.model, displacements, self.interval, velocities, time)
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
