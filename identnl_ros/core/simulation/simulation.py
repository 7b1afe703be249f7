# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Time integration of the nonlinear equations of motion, compiled.

Fixed steps of the eighth-order method of Dormand and Prince (Hairer, Norsett and Wanner,
Solving Ordinary Differential Equations I, section II.5), several per sample where the machine
has fast modes. Fixed steps make a run reproducible bit for bit.
"""

from dataclasses import dataclass

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.laws import LawKind
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.mechanics.modes import stiffest_state_matrix
from identnl_ros.core.simulation.excitation import Signal
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


@dataclass(frozen=True)
class Equations:
    """
    A model as plain arrays for the compiled integrator.

    Linear springs and dampers are summed into matrices; only nonlinear lines remain.

    Parameters
    ----------
    inverse_mass : ndarray, shape (n,)
    stiffness, damping : ndarray, shape (n, n)
    load : ndarray, shape (n,)
        Constant generalised force.
    lines : ndarray, shape (n_lines, n)
        Lines that carry nonlinear terms.
    term_line, term_kind : ndarray of int, shape (n_terms,)
    term_numbers : ndarray, shape (n_terms, 4)
        Coefficient, exponent, preload, rest force per unit of coefficient.
    excitation_directions : ndarray, shape (n_excitations, n)

    """

    inverse_mass: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    load: NDArray[np.float64]
    lines: NDArray[np.float64]
    term_line: NDArray[np.int64]
    term_kind: NDArray[np.int64]
    term_numbers: NDArray[np.float64]
    excitation_directions: NDArray[np.float64]

    @property
    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """Arguments of the compiled functions, in order."""
        return (
            self.inverse_mass,
            self.stiffness,
            self.damping,
            self.load,
            self.lines,
            self.term_line,
            self.term_kind,
            self.term_numbers,
            self.excitation_directions,
        )


def equations_of(model: Model) -> Equations:
    """
    Flatten a model for the compiled integrator.

    Parameters
    ----------
    model : Model

    Returns
    -------
    Equations

    Raises
    ------
    MachineError
        If a number is not known.

    """
    model.require_values()
    n = len(model.coordinates)
    linear = np.zeros(len(model.lines))
    used: dict[int, int] = {}
    term_line, term_kind, term_numbers = [], [], []
    for term in model.terms:
        coefficient = model.parameters[term.parameter].value * term.factor
        if term.law.kind is LawKind.LINEAR:
            linear[term.line] += coefficient
        elif term.law.kind is not LawKind.VISCOUS:
            term_line.append(used.setdefault(term.line, len(used)))
            term_kind.append(int(term.law.kind))
            term_numbers.append(
                (coefficient, term.law.exponent, term.law.preload, term.law.rest_force)
            )
    return Equations(
        inverse_mass=1 / model.mass_diagonal(),
        stiffness=(model.lines.T * linear) @ model.lines,
        damping=model.damping_matrix(),
        load=model.constant_load(),
        lines=np.ascontiguousarray(model.lines[list(used)]).reshape(len(used), n),
        term_line=np.array(term_line, dtype=np.int64),
        term_kind=np.array(term_kind, dtype=np.int64),
        term_numbers=np.array(term_numbers, dtype=np.float64).reshape(-1, 4),
        excitation_directions=np.ascontiguousarray(model.excitation_directions),
    )


def steps_per_sample(model: Model, displacements: NDArray[np.float64], interval: float) -> int:
    """
    Choose how many integration steps fit the machine's fastest motion.

    Parameters
    ----------
    model : Model
    displacements : ndarray, shape (n_states, n_coordinates)
        States that the machine passes through.
    interval : float
        Between samples [s].

    Returns
    -------
    int

    """
    fastest = float(np.abs(np.linalg.eigvals(stiffest_state_matrix(model, displacements))).max())
    return max(1, int(np.ceil(interval * fastest / STEP_LIMIT)))


@dataclass
class Simulation:
    """
    One run of a machine under given forces, advanced piece by piece.

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

    """

    model: Model
    signals: tuple[Signal, ...]
    interval: float
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    steps: int

    def __post_init__(self) -> None:
        """Prepare the arrays of the compiled integrator."""
        self._equations = equations_of(self.model)
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
            displacement, velocity, *final = self._integrated(start, count)
            bounded = self._bounded(displacement, final[0])
            # A joint that hardens under way makes faster motions than at rest: smaller steps,
            # then. With far too large ones the integration itself breaks down.
            passed = displacement[: max(bounded, 1)]
            needed = steps_per_sample(self.model, passed, self.interval)
            if needed <= self.steps:
                break
            self.steps = needed if bounded > count else min(needed, 4 * self.steps)
        if bounded <= count:
            time = start + self.interval * bounded
            raise MachineError(
                f'machine {self.model.machine.name}: the motion grows without bound at about '
                f'{time:.4g} s; check for negative stiffness or damping, or too large a force'
            )
        self.displacement, self.velocity = final
        self._index += count
        outputs = [self._output(displacement, velocity, start, fraction) for fraction in fractions]
        displacements, velocities, accelerated = zip(*outputs, strict=True)
        return np.stack(displacements), np.stack(velocities), np.stack(accelerated)

    def _integrated(self, start: float, count: int) -> tuple[NDArray[np.float64], ...]:
        """Integrate from the present state."""
        step = self.interval / self.steps
        result: tuple[NDArray[np.float64], ...] = integrate(
            self.displacement, self.velocity, step, self.steps,
            self._stage_forces(start, step, count * self.steps), *self._equations.arrays,
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
        displacement: NDArray[np.float64],
        velocity: NDArray[np.float64],
        start: float,
        fraction: float,
    ) -> Motion:
        """Find the motion a fraction of an interval after each of some states."""
        count = len(displacement)
        if fraction > 0:
            # Short runs of their own from every output instant: exact to the method's order.
            step = fraction * self.interval / self.steps
            forces = np.empty((count, self.steps, STAGES, len(self.signals)))
            for part in range(self.steps):
                for stage, node in enumerate(NODES):
                    forces[:, part, stage] = self._forces(
                        start + (part + node) * step, self.interval, count
                    )
            displacement, velocity = branch(
                displacement, velocity, step, forces, *self._equations.arrays
            )
        force = self._forces(start + fraction * self.interval, self.interval, count)
        acceleration = accelerations(displacement, velocity, force, *self._equations.arrays)
        return displacement, velocity, acceleration

    def _stage_forces(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        forces = np.empty((count, STAGES, len(self.signals)))
        for stage, node in enumerate(NODES):
            forces[:, stage] = self._forces(start + node * step, step, count)
        return forces

    def _forces(self, start: float, step: float, count: int) -> NDArray[np.float64]:
        forces = np.empty((count, len(self.signals)))
        for column, signal in enumerate(self.signals):
            forces[:, column] = signal.on_grid(start, step, count)
        return forces
