# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Motion of points of bodies and deformation of joints from the generalised coordinates."""

from dataclasses import dataclass

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.joints import GROUND, Joint
from identnl_ros.core.mechanics.machine import Body, DEGREES_OF_FREEDOM, Machine
from identnl_ros.core.mechanics.principal_axes import principal_axes
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


def axes_of(body: Body) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if body.inertia is None:
        return np.zeros(3), np.eye(3)
    return principal_axes(body.inertia)


def body_motion(
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
    _, axes = axes_of(body)
    lever = point - body.centre_of_mass
    full = np.zeros((6, 6))
    full[:3, :3] = axes
    full[3:, 3:] = axes
    x, y, z = lever
    # Rotation about an axis moves the point by the cross product of axis and lever.
    full[:3, 3:] = np.array(((0, z, -y), (-z, 0, x), (y, -x, 0))) @ axes
    for i, coordinate in enumerate(coordinates):
        if coordinate.body == body_name:
            motion[:, i] = full[:, DEGREES_OF_FREEDOM.index(coordinate.motion)]
    return motion


def relative_motion(
    machine: Machine,
    coordinates: tuple[Coordinate, ...],
    body: str,
    point: NDArray[np.float64],
    other: str,
    other_point: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Motion of one body's point relative to another's, machine frame, shape (6, n)."""
    return body_motion(machine, coordinates, body, point) - body_motion(
        machine, coordinates, other, other_point
    )


def joint_deformation(
    machine: Machine, coordinates: tuple[Coordinate, ...], joint: Joint
) -> NDArray[np.float64]:
    """B_kappa of (10): deformation of a joint in its own frame from q, shape (6, n)."""
    relative = relative_motion(
        machine, coordinates, joint.body, joint.point, joint.other_body, joint.point
    )
    to_joint = joint.axes.T
    return np.vstack((to_joint @ relative[:3], to_joint @ relative[3:]))
