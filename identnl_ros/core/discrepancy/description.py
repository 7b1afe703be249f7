# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What is believed of a stand: its machine and its sensors."""

from dataclasses import dataclass, replace

from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.mechanics.joints import Joint
from identnl_ros.core.mechanics.machine import Body, ConstantForce, Machine
from identnl_ros.core.mechanics.periodic_force import PeriodicForce
from identnl_ros.core.mechanics.slideway import Slideway


@dataclass(frozen=True)
class Description:
    """
    A machine and the layout of its sensors, either of which may be wrong or incomplete.

    Parameters
    ----------
    machine : Machine
    layout : Layout

    """

    machine: Machine
    layout: Layout

    def joint(self, name: str) -> Joint:
        """
        Find a joint.

        Parameters
        ----------
        name : str

        Returns
        -------
        Joint

        """
        return next(one for one in self.machine.joints if one.name == name)

    def slideway(self, name: str) -> Slideway:
        """
        Find a slideway.

        Parameters
        ----------
        name : str

        Returns
        -------
        Slideway

        """
        joint = self.joint(name)
        assert isinstance(joint, Slideway)
        return joint

    def body(self, name: str) -> Body:
        """
        Find a body.

        Parameters
        ----------
        name : str

        Returns
        -------
        Body

        """
        return next(one for one in self.machine.bodies if one.name == name)

    def sensor(self, name: str) -> Sensor:
        """
        Find a sensor.

        Parameters
        ----------
        name : str

        Returns
        -------
        Sensor

        """
        return next(one for one in self.layout.sensors if one.name == name)

    def with_joint(self, joint: Joint) -> 'Description':
        """
        Add a joint, or put it in the place of the one of the same name.

        Parameters
        ----------
        joint : Joint

        Returns
        -------
        Description

        """
        joints = self.machine.joints
        if any(one.name == joint.name for one in joints):
            joints = tuple(joint if one.name == joint.name else one for one in joints)
        else:
            joints = (*joints, joint)
        return replace(self, machine=replace(self.machine, joints=joints))

    def with_force(self, force: ConstantForce | PeriodicForce) -> 'Description':
        """
        Add a force.

        Parameters
        ----------
        force : ConstantForce or PeriodicForce

        Returns
        -------
        Description

        """
        forces = (*self.machine.forces, force)
        return replace(self, machine=replace(self.machine, forces=forces))

    def with_body(self, body: Body) -> 'Description':
        """
        Add a body, or put it in the place of the one of the same name.

        Parameters
        ----------
        body : Body

        Returns
        -------
        Description

        """
        bodies = self.machine.bodies
        if any(one.name == body.name for one in bodies):
            bodies = tuple(body if one.name == body.name else one for one in bodies)
        else:
            bodies = (*bodies, body)
        return replace(self, machine=replace(self.machine, bodies=bodies))

    def with_sensor(self, sensor: Sensor) -> 'Description':
        """
        Put a sensor in the place of the one of the same name.

        Parameters
        ----------
        sensor : Sensor

        Returns
        -------
        Description

        """
        sensors = tuple(sensor if one.name == sensor.name else one for one in self.layout.sensors)
        return replace(self, layout=replace(self.layout, sensors=sensors))
