# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A model as plain arrays for the compiled integrator."""

from dataclasses import dataclass

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.laws import LawKind, RATE_KINDS, SHARP_KINDS
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.inputs import input_directions
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Equations:
    """
    A model as plain arrays for the compiled integrator.

    Linear springs and dampers are summed into matrices; only nonlinear lines remain. Forces that
    follow the rate and hysteretic ones, which have a hidden state each, stand by themselves.

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
        Coefficient, exponent, preload or gap, rest force per unit of coefficient.
    input_directions : ndarray, shape (n_forces, n)
        Of exciters and periodic forces.
    rate_line, rate_kind : ndarray of int, shape (n_rate_terms,)
    rate_numbers : ndarray, shape (n_rate_terms, 3)
        Coefficient, transition velocity, Stribeck velocity.
    hidden_line : ndarray of int, shape (n_hidden,)
    hidden_numbers : ndarray, shape (n_hidden, 3)
        Coefficient, limit, exponent.

    """

    inverse_mass: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    load: NDArray[np.float64]
    lines: NDArray[np.float64]
    term_line: NDArray[np.int64]
    term_kind: NDArray[np.int64]
    term_numbers: NDArray[np.float64]
    input_directions: NDArray[np.float64]
    rate_line: NDArray[np.int64]
    rate_kind: NDArray[np.int64]
    rate_numbers: NDArray[np.float64]
    hidden_line: NDArray[np.int64]
    hidden_numbers: NDArray[np.float64]

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
            self.input_directions,
            self.rate_line,
            self.rate_kind,
            self.rate_numbers,
            self.hidden_line,
            self.hidden_numbers,
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
    terms, rates, hidden = _Table(4), _Table(3), _Table(3)
    for term in model.terms:
        law = term.law
        coefficient = model.parameters[term.parameter].value * term.factor
        if law.kind is LawKind.LINEAR:
            linear[term.line] += coefficient
        if law.kind in (LawKind.LINEAR, LawKind.VISCOUS):
            continue
        line = used.setdefault(term.line, len(used))
        if law.kind in RATE_KINDS:
            rates.add(line, law.kind, coefficient, law.transition, law.fading)
        elif law.kind is LawKind.HYSTERESIS:
            hidden.add(line, law.kind, coefficient, law.limit, law.exponent)
        else:
            place = law.gap if law.kind in SHARP_KINDS else law.preload
            terms.add(line, law.kind, coefficient, law.exponent, place, law.rest_force)
    return Equations(
        inverse_mass=1 / model.mass_diagonal(),
        stiffness=(model.lines.T * linear) @ model.lines,
        damping=model.damping_matrix(),
        load=model.constant_load(),
        lines=np.ascontiguousarray(model.lines[list(used)]).reshape(len(used), n),
        term_line=terms.lines,
        term_kind=terms.kinds,
        term_numbers=terms.numbers,
        rate_line=rates.lines,
        rate_kind=rates.kinds,
        rate_numbers=rates.numbers,
        hidden_line=hidden.lines,
        hidden_numbers=hidden.numbers,
        input_directions=input_directions(model),
    )


def initial_hidden(model: Model, given: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Complete the hysteretic states to begin with.

    Parameters
    ----------
    model : Model
    given : ndarray, shape (n_hidden,) or (0,)

    Returns
    -------
    ndarray, shape (n_hidden,)
        Zeros where none are given.

    Raises
    ------
    MachineError
        If there are not as many as the machine has.

    """
    count = len(model.hidden_columns)
    if len(given) not in (0, count):
        raise MachineError(
            f'machine {model.machine.name}: found {len(given)} hysteretic states, expected {count}'
        )
    return given if len(given) else np.zeros(count)


class _Table:
    """Terms of one sort, with a fixed count of numbers each."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._rows: list[tuple[int, int, tuple[float, ...]]] = []

    def add(self, line: int, kind: LawKind, *numbers: float) -> None:
        """Add a term."""
        self._rows.append((line, int(kind), numbers))

    @property
    def lines(self) -> NDArray[np.int64]:
        """Rows of `Equations.lines`."""
        return np.array([line for line, _, _ in self._rows], dtype=np.int64)

    @property
    def kinds(self) -> NDArray[np.int64]:
        """Kinds of the laws."""
        return np.array([kind for _, kind, _ in self._rows], dtype=np.int64)

    @property
    def numbers(self) -> NDArray[np.float64]:
        """Numbers of the laws, shape (n_terms, width)."""
        found = [numbers for _, _, numbers in self._rows]
        return np.array(found, dtype=np.float64).reshape(-1, self._width)
