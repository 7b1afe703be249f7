# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Time integration of the nonlinear equations of motion, compiled.

Fixed steps of the eighth-order method of Dormand and Prince (Hairer, Norsett and Wanner,
Solving Ordinary Differential Equations I, section II.5), several per sample where the machine
has fast modes. Fixed steps make a run reproducible bit for bit.
"""

from dataclasses import dataclass, field

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.mechanics.modes import stiffest_state_matrix
from identnl_ros.core.mechanics.sharpness import sharpest_rate
from identnl_ros.core.simulation.equations import equations_of as equations_of, initial_hidden
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.inputs import inputs_of, on_grid
from identnl_ros.core.simulation.integrator import (
    accelerations,
    branch,
    integrate,
    NODES,
    STAGES,
)
import numpy as np
from numpy.typing import NDArray

# Largest step times the fastest eigenvalue at rest: the local error is then about 1e-12.
STEP_LIMIT = 0.3
# Times that the steps are made smaller, fourfold where the integration broke down.
REFINEMENTS = 7
LARGEST_MOTION = 1e6  # [m] or [rad]


# Displacement, velocity, acceleration.
Motion = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def steps_per_sample(
    model: Model,
    displacements: NDArray[np.float64],
    interval: float,
    velocities: NDArray[np.float64] | None = None,
    time: float = 0.0,
) -> int:
    """
    Choose how many integration steps fit the machine's fastest motion.

    Parameters
    ----------
    model : Model
    displacements : ndarray, shape (n_states, n_coordinates)
        States that the machine passes through.
    interval : float
        Between samples [s].
    velocities : ndarray, shape (n_states, n_coordinates), or None
        Of the same states, at samples in time order; None: the machine rests.
    time : float
        Of the last state, since the begin of the stream [s].

    Returns
    -------
    int

    """
    fastest = fastest_rate(model, displacements, interval, velocities, time)
    return max(1, int(np.ceil(interval * fastest / STEP_LIMIT)))


def fastest_rate(
    model: Model,
    displacements: NDArray[np.float64],
    interval: float,
    velocities: NDArray[np.float64] | None = None,
    time: float = 0.0,
) -> float:
    """
    Find the fastest motion that integration steps have to resolve.

    Parameters
    ----------
    model, displacements, interval, velocities, time
        As in `steps_per_sample`.

    Returns
    -------
    float
        [rad/s].

    """
    if velocities is not None:
        finite = np.isfinite(velocities).all(axis=1)
        displacements, velocities = displacements[finite], velocities[finite]
    matrix = stiffest_state_matrix(model, displacements, velocities, time)
    fastest = float(np.abs(np.linalg.eigvals(matrix)).max())
    if velocities is None:
        return fastest
    return max(fastest, sharpest_rate(model, displacements, velocities, interval))


@dataclass
class Simulation:
    """
    One run of a machine under given forces, advanced piece by piece from the begin of a stream.

    Parameters
    ----------
    model : Model
    signals : tuple of Signal
        One for every excitation point of the machine.
    interval : float
        Between outputs [s].
    displacement, velocity : ndarray, shape (n_coordinates,)
        Initial state, at time zero.
    steps : int
        Integration steps per output, to begin with; raised where the machine hardens.
    hidden : ndarray, shape (n_hidden,)
        Hysteretic states at time zero; by default zero.

    """

    model: Model
    signals: tuple[Signal, ...]
    interval: float
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    steps: int
    hidden: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Prepare the arrays of the compiled integrator."""
        self._equations = equations_of(self.model)
        self._inputs = inputs_of(self.model, self.signals)
        self.hidden = initial_hidden(self.model, self.hidden)
        self._index = 0

    def advance(self, count: int, fractions: tuple[float, ...] = (0.0,)) -> Motion:
        """
        Integrate over a number of intervals.

        Parameters
        ----------
        count : int
            Number of output instants; the first is the current one.
        fractions : tuple of float
            Outputs are taken this fraction of an interval after every instant, each from 0
            to less than 1.

        Returns
        -------
        displacement, velocity, acceleration : ndarray, shape (n_fractions, count, n)

        Raises
        ------
        MachineError
            If the motion grows beyond all bounds.

        """
        start = self._index * self.interval
        for _ in range(REFINEMENTS):
            displacement, velocity, hidden, *final = self._integrated(start, count)
            bounded = self._bounded(displacement, final[0])
            # A joint that hardens under way makes faster motions than at rest: smaller steps,
            # then. With far too large ones the integration itself breaks down.
            passed = displacement[: max(bounded, 1)]
            rates = velocity[: max(bounded, 1)]
            end = start + count * self.interval
            needed = steps_per_sample(self.model, passed, self.interval, rates, end)
            if needed <= self.steps:
                break
            self.steps = needed if bounded > count else min(needed, 4 * self.steps)
        if bounded <= count:
            time = start + self.interval * bounded
            raise MachineError(
                f'machine {self.model.machine.name}: the motion grows without bound at about '
                f'{time:.4g} s; check for negative stiffness or damping, or too large a force'
            )
        self.displacement, self.velocity, self.hidden = final
        self._index += count
        states = displacement, velocity, hidden
        outputs = [self._output(states, start, fraction) for fraction in fractions]
        displacements, velocities, accelerated = zip(*outputs, strict=True)
        return np.stack(displacements), np.stack(velocities), np.stack(accelerated)

    def _integrated(self, start: float, count: int) -> tuple[NDArray[np.float64], ...]:
        """Integrate from the present state."""
        step = self.interval / self.steps
        result: tuple[NDArray[np.float64], ...] = integrate(
            self.displacement, self.velocity, self.hidden, step, self.steps,
            self._stage_inputs(start, step, count * self.steps), *self._equations.arrays,
        )  # fmt: skip
        return result

    @staticmethod
    def _bounded(displacement: NDArray[np.float64], last: NDArray[np.float64]) -> int:
        """Count the states before the motion grows beyond all bounds."""
        states = np.vstack((displacement, last))
        finite = np.isfinite(states).all(axis=1)
        # So large a motion overflows next, and no machine makes it.
        finite &= np.abs(np.where(np.isfinite(states), states, 0.0)).max(axis=1) < LARGEST_MOTION
        return len(states) if finite.all() else int(np.argmin(finite))

    def _output(
        self,
        states: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        start: float,
        fraction: float,
    ) -> Motion:
        """Find the motion a fraction of an interval after each of some states."""
        displacement, velocity, hidden = states
        count = len(displacement)
        if fraction > 0:
            # Short runs of their own from every output instant: exact to the method's order.
            step = fraction * self.interval / self.steps
            inputs = np.empty((count, self.steps, STAGES, len(self._inputs)))
            for part in range(self.steps):
                for stage, node in enumerate(NODES):
                    inputs[:, part, stage] = on_grid(
                        self._inputs, start + (part + node) * step, self.interval, count
                    )
            displacement, velocity, hidden = branch(
                displacement, velocity, hidden, step, inputs, *self._equations.arrays
            )
        inputs = on_grid(self._inputs, start + fraction * self.interval, self.interval, count)
        acceleration = accelerations(
            displacement, velocity, hidden, inputs, *self._equations.arrays
        )
        return displacement, velocity, acceleration

    def _stage_inputs(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        inputs = np.empty((count, STAGES, len(self._inputs)))
        for stage, node in enumerate(NODES):
            inputs[:, stage] = on_grid(self._inputs, start + node * step, step, count)
        return inputs
