# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Faults of force cells: the force that drives the machine is not the one measured."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence

from identnl_ros.core.discrepancy.circumstances import Course
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import AddedForce, Place, Reals
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_force import cell_weights


class ForceFault(AddedForce):
    """A fault of one force cell; where an exciter has several, it counts by the cell's weight."""

    def places(self, description: Description) -> Sequence[Place]:
        """List the force cells of the machine's exciters."""
        names = [one.name for one in description.machine.excitations]
        return [
            Place(sensor.name, words=f'force sensor {sensor.name}')
            for sensor in description.layout.sensors
            if sensor.kind is SensorKind.FORCE and sensor.excitation in names
        ]

    def force(
        self, course: Course, place: Place, inner: Mapping[str, float]
    ) -> tuple[Reals, Reals]:
        """Give the true force less the measured one, along the direction of the exciter."""
        exciter = course.description.sensor(place.part).excitation
        cells = [one for one in course.description.layout.sensors if one.excitation == exciter]
        weights = cell_weights(cells)
        share = weights[[one.name for one in cells].index(place.part)]
        names = [one.name for one in course.description.machine.excitations]
        i = names.index(exciter)
        lacking = self.lacking(course.time, course.force[:, i])
        return share * lacking, course.model.excitation_directions[i]

    @abstractmethod
    def lacking(self, time: Reals, measured: Reals) -> Reals:
        """
        Give what a measured force lacks.

        Parameters
        ----------
        time : ndarray, shape (n_samples,)
            [s].
        measured : ndarray, shape (n_samples,)
            [N].

        Returns
        -------
        ndarray, shape (n_samples,)
            True force less the measured one, per unit of the effect's size [N per unit].

        """
