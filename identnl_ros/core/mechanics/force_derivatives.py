# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How the equations of motion depend on the unknowns."""

from dataclasses import dataclass

from identnl_ros.core.mechanics.hidden_states import hidden_motion
from identnl_ros.core.mechanics.inner_slopes import (
    exponent_slope,
    fading_slope,
    gap_slope,
    preload_slope,
    transition_slope,
)
from identnl_ros.core.mechanics.joint_terms import EXPONENT, FADING, GAP, TRANSITION
from identnl_ros.core.mechanics.model import InnerLink, Model, Term
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class ForceDerivatives:
    """
    Derivatives of the left-hand side of the equations of motion by the unknowns.

    Left-hand side: inertia and joint forces minus loads, (1) of Berczynski et al. (2010).
    It is linear in coefficients, whose derivatives do not depend on their values; not so in
    preloads, exponents and other numbers inside laws.

    Parameters
    ----------
    model : Model
        Its values are those at which the derivatives are taken.

    """

    model: Model

    def of_motion(
        self,
        displacement: Reals,
        velocity: Reals,
        acceleration: Reals,
        hidden: Reals | None = None,
        time: Reals | None = None,
    ) -> Reals:
        """
        Differentiate at a number of states.

        Parameters
        ----------
        displacement, velocity, acceleration : ndarray, shape (n_states, n_coordinates)
            Where there are hysteretic terms and `hidden` is not given: in time order, equally
            spaced.
        hidden : ndarray, shape (n_states, n_hidden), or None
            Hysteretic states; None: they follow the motion, from zero at its first sample.
        time : ndarray, shape (n_states,), or None
            Since the begin of the stream [s]; needed where forces depend on it.

        Returns
        -------
        ndarray, shape (n_states, n_coordinates, n_unknowns)
            [N or N m, per unit of the unknown].

        Raises
        ------
        MachineError
            If the time is needed and not given.

        """
        model = self.model
        time = model.times(time, len(displacement))
        column = {parameter: i for i, parameter in enumerate(model.estimated)}
        derivatives = np.zeros((*displacement.shape, len(column)))
        if hidden is None and model.hidden_columns:
            hidden = hidden_motion(model, displacement, velocity)
        for index, lines in self.along_lines(displacement, velocity, hidden, time).items():
            derivatives[:, :, index] = (
                np.column_stack(list(lines.values())) @ model.lines[list(lines)]
            )
        for parameter, diagonal in model.mass_vectors:
            if parameter in column:
                derivatives[:, :, column[parameter]] += diagonal * acceleration
        for load in model.loads:
            if load.wave is None and load.parameter in column:
                derivatives[:, :, column[load.parameter]] -= load.vector
        for load, wave in model.periodic_loads:
            if load.parameter in column:
                derivatives[:, :, column[load.parameter]] -= np.outer(wave.at(time), load.vector)
            if load.frequency is not None and load.frequency.parameter in column:
                slope = load.frequency.times * model.parameters[load.parameter].value
                derivatives[:, :, column[load.frequency.parameter]] -= np.outer(
                    slope * wave.frequency_slope(time), load.vector
                )
        return derivatives

    def along_lines(
        self,
        displacement: Reals,
        velocity: Reals,
        hidden: Reals | None,
        time: Reals | None = None,
    ) -> dict[int, dict[int, Reals]]:
        """
        Differentiate the forces of the joints along the lines on which they act.

        Parameters
        ----------
        displacement, velocity : ndarray, shape (n_states, n_coordinates)
        hidden : ndarray, shape (n_states, n_hidden), or None
            Hysteretic states; None where there are none.
        time : ndarray, shape (n_states,), or None
            Since the begin of the stream [s]; None where nothing depends on it.

        Returns
        -------
        dict of int to dict of int to ndarray, shape (n_states,)
            By unknown (its place among `Model.estimated`), then by row of `Model.lines`
            [N or N m, per unit of the unknown].

        """
        model = self.model
        time = model.times(time, len(displacement))
        column = {parameter: i for i, parameter in enumerate(model.estimated)}
        deformation = model.lines @ displacement.T
        rate = model.lines @ velocity.T
        found: dict[int, dict[int, Reals]] = {}

        def add(parameter: int, line: int, derivative: Reals) -> None:
            lines = found.setdefault(column[parameter], {})
            lines[line] = lines[line] + derivative if line in lines else derivative

        columns = model.hidden_columns
        for index, term in enumerate(model.terms):
            line = term.line
            if term.parameter in column:
                state = (
                    hidden[:, columns[index]] if hidden is not None and index in columns else None
                )
                force = term.law.force(deformation[line], rate[line], state, time)
                add(term.parameter, line, term.factor * force)
            for link in term.inner:
                if link.parameter in column:
                    slope = self._inner_slope(term, link, deformation[line], rate[line])
                    add(link.parameter, line, link.times * slope)
        return found

    def _inner_slope(self, term: Term, link: InnerLink, deformation: Reals, rate: Reals) -> Reals:
        """Differentiate the force of a term by a number in its law."""
        locked_in = self.model.machine.gravity is None
        coefficient = self.model.parameters[term.parameter].value
        if link.key == EXPONENT:
            by_factor = term.factor_slope * term.law.force(deformation, deformation)
            by_law = term.factor * exponent_slope(term.law, deformation, locked_in)
            return coefficient * (by_factor + by_law)
        if link.key == GAP:
            slope = gap_slope(term.law, deformation, locked_in)
        elif link.key == TRANSITION:
            slope = transition_slope(term.law, rate)
        elif link.key == FADING:
            slope = fading_slope(term.law, rate)
        else:
            slope = preload_slope(term.law, deformation, locked_in)
        return coefficient * term.factor * slope
