# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Equations of motion of a machine, assembled from its description.

``M q'' + sum over terms of line * coefficient * factor * law(line . q, line . q') = P(t)``, (1)
of Berczynski et al. (2010), with q along and about each body's principal central axes. A line is
a direction in the space of q along which scalar elements act; the rows of B_kappa, (10), are
lines, and so are the rays of a pressure-integrated contact.

Preloads, exponents, gaps and velocities that are to be estimated are parameters too, inside laws
and factors: the equations are not linear in these inner parameters. A number that is tied to
another one is no parameter: what it stands for is a multiple of the other. A hysteretic term has
a state of its own, which follows the motion: a hidden state. Periodic forces and stiffness that
drifts depend on time, which counts from the begin of the stream.
"""

from dataclasses import dataclass, replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.hidden_states import hidden_motion, hysteretic_terms
from identnl_ros.core.mechanics.kinematics import body_motion, Coordinate
from identnl_ros.core.mechanics.laws import Law, LawKind
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.mechanics.periodic_force import Wave
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Parameter:
    """
    One coefficient of the machine.

    Parameters
    ----------
    name : str
        Part and key, e.g. ``slideway_6.normal_stiffness``.
    symbol : str
        Of the literature.
    unit : str
        SI.
    value : float
        NaN when only the identification can tell.
    estimated : bool
        Unknown of the identification.
    inner : bool
        A preload, an exponent, a gap, ...: forces are not proportional to it.

    """

    name: str
    symbol: str
    unit: str
    value: float
    estimated: bool
    inner: bool = False


@dataclass(frozen=True)
class Tied:
    """
    A number that follows a parameter: ``number = times * value of parameter``.

    Parameters
    ----------
    name, symbol, unit : str
        As in `Parameter`.
    parameter : int
        Index into `Model.parameters`.
    times : float

    """

    name: str
    symbol: str
    unit: str
    parameter: int
    times: float


@dataclass(frozen=True)
class InnerLink:
    """
    Number of a law that follows an inner parameter: ``number = times * value of parameter``.

    Parameters
    ----------
    key : str
        ``preload``, ``exponent``, ``gap`` or the like.
    parameter : int
        Index into `Model.parameters`.
    times : float

    """

    key: str
    parameter: int
    times: float


@dataclass(frozen=True)
class Term:
    """
    One scalar element: ``force = value of parameter * factor * law``, along a line.

    Parameters
    ----------
    line : int
        Row of `Model.lines`.
    law : Law
    factor : float
    parameter : int
        Index into `Model.parameters`.
    inner : tuple of InnerLink
        Parameters that law and factor follow.
    factor_slope : float
        Derivative of `factor` by the exponent of the law.

    """

    line: int
    law: Law
    factor: float
    parameter: int
    inner: tuple[InnerLink, ...] = ()
    factor_slope: float = 0.0


@dataclass(frozen=True)
class Load:
    """
    A generalised force that does not depend on motion: ``value of parameter * vector * wave``.

    Parameters
    ----------
    vector : ndarray, shape (n_coordinates,)
        Per unit of the parameter.
    parameter : int
        Index into `Model.parameters`.
    wave : Wave or None
        None: the force is constant.
    frequency : InnerLink or None
        Parameter that the frequency of the wave follows.

    """

    vector: NDArray[np.float64]
    parameter: int
    wave: Wave | None = None
    frequency: InnerLink | None = None


@dataclass(frozen=True)
class Model:
    """
    Assembled equations of motion.

    Parameters
    ----------
    machine : Machine
        As described: its values remain those of the description.
    coordinates : tuple of Coordinate
    parameters : tuple of Parameter
        All coefficients, known and estimated, in the order of the machine file; of
        numbers inside laws the estimated ones only.
    lines : ndarray, shape (n_lines, n_coordinates)
        Deformation along each line = ``lines @ q`` [m] or [rad].
    line_joints : tuple of str
        Joint that each line belongs to.
    terms : tuple of Term
    rotary_inertia : ndarray, shape (n_coordinates,)
        Diagonal of the mass matrix without the masses [kg m^2].
    mass_vectors : tuple of (int, ndarray)
        Parameter index of a body's mass and the diagonal it fills.
    loads : tuple of Load
        Weights, constant and periodic forces.
    excitation_directions : ndarray, shape (n_excitations, n_coordinates)
        Generalised force per newton of each exciter.
    tied : tuple of Tied
        Numbers that follow one of the parameters.

    """

    machine: Machine
    coordinates: tuple[Coordinate, ...]
    parameters: tuple[Parameter, ...]
    lines: NDArray[np.float64]
    line_joints: tuple[str, ...]
    terms: tuple[Term, ...]
    rotary_inertia: NDArray[np.float64]
    mass_vectors: tuple[tuple[int, NDArray[np.float64]], ...]
    loads: tuple[Load, ...]
    excitation_directions: NDArray[np.float64]
    tied: tuple[Tied, ...] = ()

    @property
    def estimated(self) -> tuple[int, ...]:
        """Indices of the parameters to be identified."""
        return tuple(i for i, parameter in enumerate(self.parameters) if parameter.estimated)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates in order."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    @property
    def values(self) -> NDArray[np.float64]:
        """Values of all parameters, NaN where not known, shape (n_parameters,)."""
        return np.array([parameter.value for parameter in self.parameters])

    def with_values(self, values: NDArray[np.float64]) -> 'Model':
        """
        Copy with other parameter values; laws, forces at rest and tied numbers follow.

        Parameters
        ----------
        values : ndarray, shape (n_parameters,)
            SI.

        Returns
        -------
        Model

        Raises
        ------
        MachineError
            If a preload, an exponent or another number inside a law is out of range.

        """
        inner = [parameter.inner for parameter in self.parameters]
        model = self
        if not np.array_equal(self.values[inner], np.asarray(values)[inner], equal_nan=True):
            # Assembly makes models: it cannot be imported before them.
            from identnl_ros.core.mechanics.assembly import assemble

            model = assemble(
                self.machine,
                {
                    parameter.name: float(value)
                    for parameter, value in zip(self.parameters, values, strict=True)
                    if parameter.inner
                },
            )
        return replace(
            model,
            parameters=tuple(
                replace(parameter, value=float(value))
                for parameter, value in zip(model.parameters, values, strict=True)
            ),
        )

    def with_unknowns(self, unknown_values: NDArray[np.float64]) -> 'Model':
        """
        Copy with other values of the unknowns.

        Parameters
        ----------
        unknown_values : ndarray, shape (n_unknowns,)
            In the order of `estimated`, SI.

        Returns
        -------
        Model

        Raises
        ------
        MachineError
            If a preload, an exponent or another number inside a law is out of range.

        """
        values = self.values
        values[list(self.estimated)] = unknown_values
        return self.with_values(values)

    def mass_diagonal(self) -> NDArray[np.float64]:
        """
        Diagonal of the mass matrix, which principal axes make diagonal.

        Returns
        -------
        ndarray, shape (n_coordinates,)
            [kg, kg m^2].

        """
        diagonal = self.rotary_inertia.copy()
        for parameter, vector in self.mass_vectors:
            diagonal += self.parameters[parameter].value * vector
        return diagonal

    @property
    def hidden_columns(self) -> dict[int, int]:
        """Column of the hidden state of every hysteretic term, by index of the term."""
        return {term: column for column, term in enumerate(hysteretic_terms(self.terms))}

    @property
    def time_dependent(self) -> bool:
        """Whether forces depend on time: periodic ones, or those of a stiffness that drifts."""
        return bool(self.periodic_loads) or any(
            term.law.kind is LawKind.DRIFTING for term in self.terms
        )

    @property
    def periodic_loads(self) -> tuple[tuple[Load, Wave], ...]:
        """Loads that have a wave."""
        return tuple((load, load.wave) for load in self.loads if load.wave is not None)

    def times(self, time: NDArray[np.float64] | None, count: int) -> NDArray[np.float64]:
        """
        Require the time where forces depend on it.

        Parameters
        ----------
        time : ndarray, shape (n_states,), or None
            Since the begin of the stream [s].
        count : int
            Number of states.

        Returns
        -------
        ndarray, shape (n_states,)
            Zeros where nothing depends on it and it is not given.

        Raises
        ------
        MachineError
            If it matters and is not given.

        """
        if time is not None:
            return time
        if self.time_dependent:
            raise MachineError(
                f'machine {self.machine.name}: a periodic force or a drifting stiffness depends '
                'on time, which is not known here; take that part out of the machine file'
            )
        return np.zeros(count)

    def joint_force(
        self,
        displacement: NDArray[np.float64],
        velocity: NDArray[np.float64],
        hidden: NDArray[np.float64] | None = None,
        time: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """
        Evaluate the generalised force of all joints on the bodies' left-hand side.

        Parameters
        ----------
        displacement, velocity : ndarray, shape (n_samples, n_coordinates)
            Where there are hysteretic terms and `hidden` is not given: in time order, equally
            spaced.
        hidden : ndarray, shape (n_samples, n_hidden), or None
            Hysteretic states; None: they follow the motion, from zero at its first sample.
        time : ndarray, shape (n_samples,), or None
            Since the begin of the stream [s]; needed where stiffness drifts.

        Returns
        -------
        ndarray, shape (n_samples, n_coordinates)
            [N, N m].

        Raises
        ------
        MachineError
            If the time is needed and not given.

        """
        time = self.times(time, len(displacement))
        deformation = displacement @ self.lines.T
        rate = velocity @ self.lines.T
        forces = np.zeros_like(deformation)
        columns = self.hidden_columns
        if hidden is None and columns:
            hidden = hidden_motion(self, displacement, velocity)
        for index, term in enumerate(self.terms):
            value = self.parameters[term.parameter].value * term.factor
            line = term.line
            state = hidden[:, columns[index]] if hidden is not None and index in columns else None
            force = term.law.force(deformation[:, line], rate[:, line], state, time)
            forces[:, line] += value * force
        return forces @ self.lines

    def constant_load(self) -> NDArray[np.float64]:
        """
        Sum of weights and constant forces.

        Returns
        -------
        ndarray, shape (n_coordinates,)
            [N, N m].

        """
        total = np.zeros(len(self.coordinates))
        for load in self.loads:
            if load.wave is None:
                total += self.parameters[load.parameter].value * load.vector
        return total

    def periodic_load(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Sum of the periodic forces.

        Parameters
        ----------
        time : ndarray, shape (n_states,)
            Since the begin of the stream [s].

        Returns
        -------
        ndarray, shape (n_states, n_coordinates)
            [N, N m].

        """
        total = np.zeros((len(time), len(self.coordinates)))
        for load, wave in self.periodic_loads:
            total += np.outer(wave.at(time), self.parameters[load.parameter].value * load.vector)
        return total

    def tangent_stiffness(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Differentiate the joint forces by the displacement at one state of rest.

        Hysteretic springs are elastic there; stiffness that drifts is that of the begin, zero.

        Parameters
        ----------
        displacement : ndarray, shape (n_coordinates,)

        Returns
        -------
        ndarray, shape (n_coordinates, n_coordinates)

        """
        deformation = self.lines @ displacement
        slopes = np.zeros(len(self.lines))
        for term in self.terms:
            value = self.parameters[term.parameter].value * term.factor
            slope = term.law.stiffness(deformation[term.line])
            # A power below one is infinitely steep at a point, where it has no stiffness to add.
            slopes[term.line] += value * slope if np.isfinite(slope) else 0.0
        return (self.lines.T * slopes) @ self.lines

    def damping_matrix(self) -> NDArray[np.float64]:
        """
        Differentiate the forces of viscous dampers by the velocity: the same at all states.

        Friction and quadratic damping, whose slope is not constant, are not in it.

        Returns
        -------
        ndarray, shape (n_coordinates, n_coordinates)

        """
        slopes = np.zeros(len(self.lines))
        for term in self.terms:
            value = self.parameters[term.parameter].value * term.factor
            slopes[term.line] += value * term.law.damping
        return (self.lines.T * slopes) @ self.lines

    def require_values(self) -> None:
        """
        Refuse to go on where a number of the machine is not known.

        Raises
        ------
        MachineError
            If a parameter has no value.

        """
        for parameter in self.parameters:
            if np.isnan(parameter.value):
                example = '1' if parameter.unit == '1' else f'1 {parameter.unit}'
                raise MachineError(
                    f'{parameter.name}: no value to simulate with; give the machine file one, '
                    f'e.g. "{{estimate: {example}}}"'
                )

    def motion_of_point(
        self, body: str, point: NDArray[np.float64], direction: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """
        Row that gives the motion of a body's point along a direction from q.

        Parameters
        ----------
        body : str
            A body, or the ground, which does not move.
        point, direction : ndarray, shape (3,)
            Machine frame [m].

        Returns
        -------
        ndarray, shape (n_coordinates,)

        Raises
        ------
        MachineError
            If there is no such body.

        """
        motion = body_motion(self.machine, self.coordinates, body, point)[:3]
        row: NDArray[np.float64] = direction @ motion
        return row
