# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""From aligned readings of all sensors to the motion of the bodies and the force on them."""

from collections.abc import Collection
from dataclasses import dataclass, replace

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.added_reading import front_mass_reading, gravity_reading
from identnl_ros.core.measurement.alignment import Aligner, convolve, HALF_WIDTH
from identnl_ros.core.measurement.degraded_observation import Accuracy, DegradedObservation
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.observation import Observation, observe_force, observe_motion
from identnl_ros.core.measurement.stencils import stencil
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class MappedMotion:
    """
    Motion and force at some instants, and how accurate they are.

    Parameters
    ----------
    displacement, velocity, acceleration, force : ndarray, shape (n_samples, n_coordinates)
        NaN: not known at this sample.
    accuracies : tuple of 4 Accuracy
        Of displacement, velocity, acceleration and force, as far as they are measured.

    """

    displacement: Reals
    velocity: Reals
    acceleration: Reals
    force: Reals
    accuracies: tuple[Accuracy, Accuracy, Accuracy, Accuracy]


class MotionMap:
    """
    Least squares at every instant, and derivatives of the displacement for what is not measured.

    Parameters
    ----------
    model : Model
    layout : Layout
    sample_rate : float
        [Hz].

    Raises
    ------
    LayoutError
        If the sensors do not fit the machine or do not see every coordinate.

    """

    def __init__(self, model: Model, layout: Layout, sample_rate: float) -> None:
        self._model = model
        self._layout = layout
        self._rate = sample_rate
        aligners = [Aligner(sensor.delay * sample_rate) for sensor in layout.sensors]
        self._correlations = {
            orders: np.array([aligner.correlation(*orders) for aligner in aligners])
            for orders in ((0, 0), (1, 1), (2, 2), (0, 2))
        }
        displacement = observe_motion(model, layout, SensorKind.DISPLACEMENT)
        if displacement.unseen:
            raise LayoutError(
                f'layout: the displacement sensors cannot see '
                f'{", ".join(displacement.unseen)}; add or move sensors '
                '(displacement is needed, with its constant part)'
            )
        self._displacement = DegradedObservation(displacement)
        self._rates = tuple(
            _Rate(model, layout, kind, stencil(order, 0.0, HALF_WIDTH) * sample_rate**order)
            for order, kind in ((1, SensorKind.VELOCITY), (2, SensorKind.ACCELERATION))
        )
        self._force = DegradedObservation(observe_force(model, layout))
        self._gravity = gravity_reading(model, layout.sensors, layout.gravity)
        self._front_mass = front_mass_reading(model, layout.sensors)
        _, masses = self._front_mass.among(len(layout.sensors))
        force = self._force.full
        # Generalised force that the masses in front take, per unit of acceleration.
        self._front_inertia = force.matrix @ masses[list(force.channels)]

    @property
    def derived(self) -> tuple[bool, bool]:
        """Whether velocity, acceleration are, at least partly, derivatives of the displacement."""
        velocity, acceleration = self._rates
        return velocity.derived, acceleration.derived

    @property
    def margin(self) -> int:
        """Samples around an instant that its derivatives need."""
        return HALF_WIDTH if any(self.derived) else 0

    def restart(self) -> None:
        """Expect another stream."""
        self.use_without(())
        for one in (self._displacement, *(rate.observation for rate in self._rates), self._force):
            one.restart()

    def use_without(self, lost: Collection[int]) -> bool:
        """
        Go on without sensors that give no readings for long.

        Parameters
        ----------
        lost : collection of int
            Channels.

        Returns
        -------
        bool
            Other quantities are derivatives of the displacement than before: instants before
            and after do not follow each other.

        """
        self._displacement.use_without(lost)
        self._force.use_without(lost)
        return any([rate.use_without(lost) for rate in self._rates])

    def motion(self, aligned: Reals, first_index: int) -> MappedMotion:
        """
        Map aligned readings.

        Parameters
        ----------
        aligned : ndarray, shape (n_samples + 2 * margin, n_channels)
        first_index : int
            Index of the first instant wanted, that is `margin` behind the first reading.

        Returns
        -------
        MappedMotion

        """
        if not len(aligned):
            nothing = np.empty((0, len(self._model.coordinates)))
            return MappedMotion(nothing, nothing, nothing, nothing, self.usual)
        count = len(aligned) - 2 * self.margin
        inner = slice(self.margin, self.margin + count)
        wide = _read(self._displacement, aligned, first_index - self.margin)
        readings = self._gravity.taken_out(aligned[inner], wide[inner])
        velocity, acceleration = (
            rate.completed(_read(rate.observation, readings, first_index), wide)
            for rate in self._rates
        )
        readings = self._front_mass.taken_out(readings, acceleration)
        forces = _read(self._force, readings, first_index)
        displacement, force = (
            one.accuracy(first_index, count) for one in (self._displacement, self._force)
        )
        first, second = (rate.observation.accuracy(first_index, count) for rate in self._rates)
        return MappedMotion(
            wide[inner],
            velocity,
            acceleration,
            forces,
            (displacement, first, second, force),
        )

    @property
    def usual(self) -> tuple[Accuracy, Accuracy, Accuracy, Accuracy]:
        """How accurate displacement, velocity, acceleration and force are with all sensors."""
        first, second = (Accuracy(rate.observation.full) for rate in self._rates)
        return Accuracy(self._displacement.full), first, second, Accuracy(self._force.full)

    def covariances(
        self, noise: Reals, accuracies: tuple[Accuracy, Accuracy, Accuracy, Accuracy]
    ) -> tuple[Reals, Reals, Reals, Reals, Reals]:
        """
        Propagate the noise of the sensors.

        Parameters
        ----------
        noise : ndarray, shape (n_channels,)
            Standard deviation of one sample.
        accuracies : tuple of 4 Accuracy

        Returns
        -------
        tuple of 5 ndarray, shape (n_coordinates, n_coordinates)
            Of displacement, velocity, acceleration, force, and the covariance of displacement
            (rows) with acceleration (columns).

        """

        def variance(first: int, second: int) -> Reals:
            return np.asarray(noise**2 * self._correlations[first, second])

        displacement, *measured, force = accuracies
        rates = []
        for order, (rate, one) in enumerate(zip(self._rates, measured, strict=True), start=1):
            covariance = one.covariance(variance(0, 0))
            if rate.derived:
                derived = displacement.covariance(
                    variance(order, order) * self._rate ** (2 * order)
                )
                covariance = covariance + rate.share @ derived @ rate.share.T
            rates.append(covariance)
        with_acceleration = displacement.covariance(variance(0, 2) * self._rate**2)
        return (
            displacement.covariance(variance(0, 0)),
            rates[0],
            rates[1],
            force.covariance(variance(0, 0))
            + self._front_inertia @ rates[1] @ self._front_inertia.T,
            with_acceleration @ self._rates[1].share.T,
        )


class _Rate:
    """Velocity or acceleration: measured where sensors see it, else differentiated."""

    def __init__(self, model: Model, layout: Layout, kind: SensorKind, weights: Reals) -> None:
        self._model = model
        self._layout = layout
        self._kind = kind
        self._weights = weights
        self._complete = observe_motion(model, layout, kind)
        self._observe(self._complete)

    def _observe(self, observed: Observation) -> None:
        self.observation = DegradedObservation(observed)
        share = np.eye(len(observed.seen)) - observed.seen
        self.share = share if observed.unseen else np.zeros_like(share)
        self.derived = bool(observed.unseen)

    def use_without(self, lost: Collection[int]) -> bool:
        observed = self._complete
        if not set(lost).isdisjoint(observed.channels):
            observed = _observed_without(self._model, self._layout, self._kind, lost)
        if round(np.trace(self._complete.seen - observed.seen)) == 0:
            observed = self._complete
        changes = observed.channels != self.observation.full.channels
        if changes:
            self._observe(observed)
        self.observation.use_without(lost)
        return changes

    def completed(self, measured: Reals, displacement: Reals) -> Reals:
        if not self.derived:
            return measured
        return measured + convolve(displacement, self._weights, len(measured)) @ self.share.T


def _observed_without(
    model: Model, layout: Layout, kind: SensorKind, lost: Collection[int]
) -> Observation:
    """Observe with the other sensors of a kind, as if the layout did not have those lost."""
    kept = [
        i for i, sensor in enumerate(layout.sensors) if i not in lost or sensor.kind is not kind
    ]
    observed = observe_motion(
        model, replace(layout, sensors=tuple(layout.sensors[i] for i in kept)), kind
    )
    return replace(observed, channels=tuple(kept[i] for i in observed.channels))


def _read(observation: DegradedObservation, aligned: Reals, first_index: int) -> Reals:
    readings = aligned[:, list(observation.full.channels)]
    return observation.coordinates(readings, first_index)
