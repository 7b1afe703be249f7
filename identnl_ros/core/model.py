# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Equations of motion of a machine, assembled from its description.

``M q'' + sum over terms of line * coefficient * factor * law(line . q, line . q') = P(t)``, (1)
of Berczynski et al. (2010), with q along and about each body's principal central axes. A line is
a direction in the space of q along which scalar elements act; the rows of B_kappa, (10), are
lines, and so are the rays of a pressure-integrated contact.
"""

from dataclasses import dataclass, replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.joints import Coefficient, GROUND, Joint
from identnl_ros.core.laws import Law
from identnl_ros.core.machine import Body, DEGREES_OF_FREEDOM, Machine
from identnl_ros.core.principal_axes import principal_axes
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Coordinate:
    """One generalised coordinate: a motion of a body along or about a principal axis."""

    body: str
    motion: str

    @property
    def name(self) -> str:
        """Name of the column, e.g. ``knee.rotation_3``."""
        return f'{self.body}.{self.motion}'

    @property
    def in_words(self) -> str:
        """For messages, e.g. ``rotation 3 of knee``."""
        return f'{self.motion.replace("_", " ")} of {self.body}'


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

    """

    name: str
    symbol: str
    unit: str
    value: float
    estimated: bool


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

    """

    line: int
    law: Law
    factor: float
    parameter: int


@dataclass(frozen=True)
class Load:
    """
    A constant generalised force: ``value of parameter * vector``.

    Parameters
    ----------
    vector : ndarray, shape (n_coordinates,)
        Per unit of the parameter.
    parameter : int
        Index into `Model.parameters`.

    """

    vector: NDArray[np.float64]
    parameter: int


@dataclass(frozen=True)
class Model:
    """
    Assembled equations of motion.

    Parameters
    ----------
    machine : Machine
    coordinates : tuple of Coordinate
    parameters : tuple of Parameter
        All coefficients, known and estimated, in the order of the machine file.
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
        Weights and constant forces.
    excitation_directions : ndarray, shape (n_excitations, n_coordinates)
        Generalised force per newton of each exciter.

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
        Copy with other parameter values.

        Parameters
        ----------
        values : ndarray, shape (n_parameters,)
            SI.

        Returns
        -------
        Model

        """
        return replace(
            self,
            parameters=tuple(
                replace(parameter, value=float(value))
                for parameter, value in zip(self.parameters, values, strict=True)
            ),
        )

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

    def joint_force(
        self, displacement: NDArray[np.float64], velocity: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """
        Evaluate the generalised force of all joints on the bodies' left-hand side.

        Parameters
        ----------
        displacement, velocity : ndarray, shape (n_samples, n_coordinates)

        Returns
        -------
        ndarray, shape (n_samples, n_coordinates)
            [N, N m].

        """
        deformation = displacement @ self.lines.T
        rate = velocity @ self.lines.T
        forces = np.zeros_like(deformation)
        for term in self.terms:
            value = self.parameters[term.parameter].value * term.factor
            line = term.line
            forces[:, line] += value * term.law.force(deformation[:, line], rate[:, line])
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
            total += self.parameters[load.parameter].value * load.vector
        return total

    def tangent_stiffness(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Differentiate the joint forces by the displacement at one state.

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
            slopes[term.line] += value * term.law.stiffness(deformation[term.line])
        return (self.lines.T * slopes) @ self.lines

    def damping_matrix(self) -> NDArray[np.float64]:
        """
        Differentiate the joint forces by the velocity.

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
                raise MachineError(
                    f'{parameter.name}: no value to simulate with; give the machine file one, '
                    f'e.g. "{{estimate: 1 {parameter.unit}}}"'
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
        return direction @ _body_motion(self.machine, self.coordinates, body, point)[:3]


def assemble(machine: Machine) -> Model:
    """
    Assemble the equations of motion of a machine.

    Parameters
    ----------
    machine : Machine

    Returns
    -------
    Model

    """
    coordinates = tuple(
        Coordinate(body.name, motion)
        for body in machine.bodies
        for motion in body.degrees_of_freedom
    )
    table = _ParameterTable()
    rotary_inertia = np.zeros(len(coordinates))
    mass_vectors = []
    loads = []
    for body in machine.bodies:
        moments, _ = _axes_of(body)
        mass_vector = np.zeros(len(coordinates))
        for i, coordinate in enumerate(coordinates):
            if coordinate.body != body.name:
                continue
            axis = DEGREES_OF_FREEDOM.index(coordinate.motion)
            if axis < 3:
                mass_vector[i] = 1.0
            else:
                rotary_inertia[i] = moments[axis - 3]
        index = table.index(f'{body.name}.mass', 'm', 'kg', body.mass)
        mass_vectors.append((index, mass_vector))
        if machine.gravity is not None:
            motion = _body_motion(machine, coordinates, body.name, body.centre_of_mass)[:3]
            loads.append(Load(machine.gravity @ motion, index))
    for force in machine.forces:
        index = table.index(f'{force.name}.force', 'F', 'N', force.force)
        vector = _pair(
            machine, coordinates, force.body, force.point, force.reaction_body, force.point
        )[:3]
        loads.append(Load(force.direction @ vector, index))
    lines, line_joints, terms = _joint_lines(machine, coordinates, table)
    excitation_directions = np.zeros((len(machine.excitations), len(coordinates)))
    for row, exciter in zip(excitation_directions, machine.excitations, strict=True):
        reaction = exciter.point if exciter.reaction_point is None else exciter.reaction_point
        row[:] = (
            exciter.direction
            @ _pair(
                machine, coordinates, exciter.body, exciter.point, exciter.reaction_body, reaction
            )[:3]
        )
    return Model(
        machine,
        coordinates,
        tuple(table.parameters),
        lines,
        line_joints,
        terms,
        rotary_inertia,
        tuple(mass_vectors),
        tuple(loads),
        excitation_directions,
    )


class _ParameterTable:
    """Parameters in order of first use, each once."""

    def __init__(self) -> None:
        self.parameters: list[Parameter] = []
        self._indices: dict[str, int] = {}

    def index(self, name: str, symbol: str, unit: str, coefficient: Coefficient) -> int:
        if name not in self._indices:
            self._indices[name] = len(self.parameters)
            self.parameters.append(
                Parameter(name, symbol, unit, coefficient.value, coefficient.estimated)
            )
        return self._indices[name]


def _joint_lines(
    machine: Machine, coordinates: tuple[Coordinate, ...], table: _ParameterTable
) -> tuple[NDArray[np.float64], tuple[str, ...], tuple[Term, ...]]:
    lines: list[NDArray[np.float64]] = []
    line_joints: list[str] = []
    terms: list[Term] = []
    for joint in machine.joints:
        deformation = _deformation(machine, coordinates, joint)
        known_lines: dict[bytes, int] = {}
        for term in joint.terms():
            parameter = table.index(
                f'{joint.name}.{term.key}', term.symbol, term.unit, term.coefficient
            )
            direction = term.direction.tobytes()
            if direction not in known_lines:
                known_lines[direction] = len(lines)
                lines.append(term.direction @ deformation)
                line_joints.append(joint.name)
            law = term.law
            if machine.gravity is None:
                # At rest the locked-in forces balance: only the change acts.
                law = replace(law, rest_force=float(law.force(np.zeros(1), np.zeros(1))[0]))
            terms.append(Term(known_lines[direction], law, term.factor, parameter))
    stacked = np.array(lines).reshape(len(lines), len(coordinates))
    return stacked, tuple(line_joints), tuple(terms)


def _axes_of(body: Body) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if body.inertia is None:
        return np.zeros(3), np.eye(3)
    return principal_axes(body.inertia)


def _body_motion(
    machine: Machine,
    coordinates: tuple[Coordinate, ...],
    body_name: str,
    point: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Displacement and rotation of a body's point in the machine frame from q: S, shape (6, n)."""
    motion = np.zeros((6, len(coordinates)))
    if body_name == GROUND:
        return motion
    body = next((body for body in machine.bodies if body.name == body_name), None)
    if body is None:
        raise MachineError(
            f'"{body_name}" is no body of machine {machine.name}; '
            f'expected one of {", ".join(body.name for body in machine.bodies)}'
        )
    _, axes = _axes_of(body)
    lever = point - body.centre_of_mass
    full = np.zeros((6, 6))
    full[:3, :3] = axes
    full[3:, 3:] = axes
    for axis in range(3):
        full[:3, 3 + axis] = np.cross(axes[:, axis], lever)
    for i, coordinate in enumerate(coordinates):
        if coordinate.body == body_name:
            motion[:, i] = full[:, DEGREES_OF_FREEDOM.index(coordinate.motion)]
    return motion


def _pair(
    machine: Machine,
    coordinates: tuple[Coordinate, ...],
    body: str,
    point: NDArray[np.float64],
    other: str,
    other_point: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Motion of one body's point relative to another's, machine frame, shape (6, n)."""
    return _body_motion(machine, coordinates, body, point) - _body_motion(
        machine, coordinates, other, other_point
    )


def _deformation(
    machine: Machine, coordinates: tuple[Coordinate, ...], joint: Joint
) -> NDArray[np.float64]:
    """B_kappa of (10): deformation of a joint in its own frame from q, shape (6, n)."""
    relative = _pair(machine, coordinates, joint.body, joint.point, joint.other_body, joint.point)
    to_joint = joint.axes.T
    return np.vstack((to_joint @ relative[:3], to_joint @ relative[3:]))
