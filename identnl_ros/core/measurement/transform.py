# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensor blocks to body motion, streaming: the paper's step II."""

from dataclasses import dataclass, field

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.added_reading import front_mass_reading, gravity_reading
from identnl_ros.core.measurement.blocks import MotionBlock, SampleBlock, stamp_after
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.noise import NoiseEstimate
from identnl_ros.core.measurement.observation import Observation, observe_force, observe_motion
from identnl_ros.core.measurement.stencils import stencil
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

# Differences over 17 samples: exact to 3e-9 up to a tenth of the sample rate.
HALF_WIDTH = 8


@dataclass
class TransformCounts:
    """What happened to the blocks so far."""

    blocks: int = 0
    samples_without_reading: dict[str, int] = field(default_factory=dict)


class MotionTransform:
    """
    Map sample blocks to displacement, velocity, acceleration and force of the bodies.

    Known sensor delays are taken out by interpolation. Velocity and acceleration come from the
    sensors of these kinds; what those cannot see is the first or second derivative of the
    displacement. Samples near the ends of an uninterrupted run for which there is no
    interpolation or derivative are not given out.

    What accelerometers read of gravity is taken out, the tilt of their bodies as the displacement
    tells it; what force cells read of a mass in front, with the acceleration found. The noise
    that comes in with the tilt is neglected: g / distance of the probes, about 30 1/s^2, times
    that of a probe, 1e-7 m/s^2 where the accelerometer itself has 1e-2. That of the acceleration
    is in the covariance of the force, but not its correlation with the acceleration, which is to
    the noise of the inertia forces as the mass in front is to that of the body.

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
        self._aligners = [_Aligner(sensor.delay * sample_rate) for sensor in layout.sensors]
        self._displacement = observe_motion(model, layout, SensorKind.DISPLACEMENT)
        if self._displacement.unseen:
            raise LayoutError(
                f'layout: the displacement sensors cannot see '
                f'{", ".join(self._displacement.unseen)}; add or move sensors '
                '(displacement is needed, with its constant part)'
            )
        self._velocity, self._acceleration = (
            _Rate(
                observe_motion(model, layout, kind),
                self._displacement,
                stencil(order, 0.0, HALF_WIDTH) * sample_rate**order,
            )
            for order, kind in ((1, SensorKind.VELOCITY), (2, SensorKind.ACCELERATION))
        )
        self._force = observe_force(model, layout)
        self._gravity = gravity_reading(model, layout.sensors, layout.gravity)
        self._front_mass = front_mass_reading(model, layout.sensors)
        derived = self._velocity.derived or self._acceleration.derived
        # Samples around an instant that its derivatives need, and that alignment needs.
        self._margin = HALF_WIDTH if derived else 0
        self._reach = self._margin + max(aligner.reach for aligner in self._aligners)
        self._correlations = {
            orders: np.array([aligner.correlation(*orders) for aligner in self._aligners])
            for orders in ((0, 0), (1, 1), (2, 2), (0, 2))
        }
        self._stated_noise = np.array([sensor.noise for sensor in layout.sensors])
        self._noise_estimate = NoiseEstimate(len(layout.sensors))
        self._update_covariances()
        self.follower = StreamFollower(replays=True)
        self.counts = TransformCounts()
        self._buffer = np.empty((0, len(layout.sensors)))
        self._buffer_index = 0
        self._next_output = 0

    @property
    def derived(self) -> tuple[str, ...]:
        """Quantities that are, at least partly, derivatives of the displacement."""
        rates = (('velocity', self._velocity), ('acceleration', self._acceleration))
        return tuple(name for name, rate in rates if rate.derived)

    @property
    def noise_estimated(self) -> bool:
        """Whether the layout leaves out a noise that is estimated from the samples."""
        return bool(np.isnan(self._stated_noise).any())

    @property
    def displacement_covariance(self) -> NDArray[np.float64]:
        """Of the coordinates at one sample; NaN while a noise is neither stated nor known."""
        return self._covariances[0]

    def add(self, block: SampleBlock) -> MotionBlock | None:
        """
        Take one block, give out the motion that it completes.

        Parameters
        ----------
        block : SampleBlock

        Returns
        -------
        MotionBlock or None
            None while too few samples have come, or where the block is not new data of the
            stream (`follower` counts why).

        Raises
        ------
        DataError
            If the block does not have the layout's channels or sample rate.

        """
        self._check(block)
        arrival = self.follower.accept(
            block.stream_id, block.first_index, block.next_index, block.last
        )
        if not arrival.usable:
            return None
        self.counts.blocks += 1
        self._count_missing(block)
        if arrival is Arrival.IN_ORDER:
            self._buffer = np.concatenate((self._buffer, block.samples))
        else:
            self._buffer = block.samples.copy()
            self._buffer_index = block.first_index
            self._noise_estimate.restart()
            if arrival is Arrival.FIRST:
                self._next_output = 0
        if self.noise_estimated:
            self._noise_estimate.add(block.samples)
            self._update_covariances()
        ready = self._buffer.shape[0] - 2 * self._reach
        if ready <= 0 and not block.last:
            return None
        motion = self._motion(block, max(ready, 0))
        if ready > 0:
            self._buffer = self._buffer[ready:]
            self._buffer_index += ready
        return motion

    def _check(self, block: SampleBlock) -> None:
        channels = len(self._layout.sensors)
        if block.samples.shape[1] != channels:
            raise DataError(
                f'block {block.first_index}: {block.samples.shape[1]} channels, '
                f'the layout has {channels}; is another source publishing on the topic?'
            )
        if block.sample_rate != self._rate:
            raise DataError(
                f'block {block.first_index}: sample rate {block.sample_rate} Hz, '
                f'the stream has {self._rate} Hz'
            )

    def _count_missing(self, block: SampleBlock) -> None:
        missing = (~np.isfinite(block.samples)).sum(axis=0)
        for channel in np.flatnonzero(missing):
            name = self._layout.sensors[channel].name
            counts = self.counts.samples_without_reading
            counts[name] = counts.get(name, 0) + int(missing[channel])

    def _update_covariances(self) -> None:
        """Propagate the noise; last the covariance of displacement with acceleration."""
        noise = np.where(
            np.isnan(self._stated_noise),
            self._noise_estimate.standard_deviation,
            self._stated_noise,
        )

        def variance(first: int, second: int) -> NDArray[np.float64]:
            return np.asarray(noise**2 * self._correlations[first, second])

        rate = self._rate
        displacement = self._displacement
        acceleration = self._acceleration.covariance(variance(0, 0), variance(2, 2) * rate**4)
        _, masses = self._front_mass.among(len(noise))
        inertia = self._force.matrix @ masses[list(self._force.channels)]
        self._covariances = (
            displacement.covariance(variance(0, 0)),
            self._velocity.covariance(variance(0, 0), variance(1, 1) * rate**2),
            acceleration,
            self._force.covariance(variance(0, 0)) + inertia @ acceleration @ inertia.T,
            displacement.covariance(variance(0, 2) * rate**2) @ self._acceleration.derived_share.T,
        )

    def _motion(self, block: SampleBlock, ready: int) -> MotionBlock:
        # Aligned readings at the instants given out and the margin either side of them.
        count = ready + 2 * self._margin if ready else 0
        start = self._reach - self._margin
        aligned = np.empty((count, len(self._aligners)))
        for column, aligner in enumerate(self._aligners):
            aligned[:, column] = aligner.apply(self._buffer[:, column], start, count)
        inner = aligned[self._margin : self._margin + ready]
        with np.errstate(invalid='ignore'):
            wide = aligned[:, self._displacement.channels] @ self._displacement.matrix.T
            inner = self._gravity.taken_out(inner, wide[self._margin : self._margin + ready])
            velocity, acceleration = (
                rate.of_motion(inner, wide) for rate in (self._velocity, self._acceleration)
            )
            inner = self._front_mass.taken_out(inner, acceleration)
            force = inner[:, self._force.channels] @ self._force.matrix.T
        first_index = max(self._buffer_index + self._reach, self._next_output)
        self._next_output = first_index + ready
        return MotionBlock(
            stream_id=block.stream_id,
            stamp_ns=stamp_after(block.stamp_ns, first_index - block.first_index, self._rate),
            first_index=first_index,
            sample_rate=self._rate,
            coordinates=self._model.coordinate_names,
            displacement=wide[self._margin : self._margin + ready],
            velocity=velocity,
            acceleration=acceleration,
            force=force,
            displacement_covariance=self._covariances[0],
            velocity_covariance=self._covariances[1],
            acceleration_covariance=self._covariances[2],
            force_covariance=self._covariances[3],
            displacement_acceleration_covariance=self._covariances[4],
            noise_estimated=self.noise_estimated,
            velocity_derived=self._velocity.derived,
            acceleration_derived=self._acceleration.derived,
            last=block.last,
        )


class _Rate:
    """Velocity or acceleration: measured where sensors see it, else differentiated."""

    def __init__(
        self, observation: Observation, displacement: Observation, weights: NDArray[np.float64]
    ) -> None:
        self._observation = observation
        self._displacement = displacement
        self._weights = weights
        share = np.eye(len(observation.seen)) - observation.seen
        self.derived_share = share if observation.unseen else np.zeros_like(share)

    @property
    def derived(self) -> bool:
        return bool(self._observation.unseen)

    def covariance(
        self, variance: NDArray[np.float64], derived_variance: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        measured = self._observation.covariance(variance)
        if not self.derived:
            return measured
        derived = self._displacement.covariance(derived_variance)
        return measured + self.derived_share @ derived @ self.derived_share.T

    def of_motion(
        self, readings: NDArray[np.float64], displacement: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        measured = readings[:, self._observation.channels] @ self._observation.matrix.T
        if not self.derived:
            return measured
        return measured + (
            _convolve(displacement, self._weights, len(readings)) @ self.derived_share.T
        )


class _Aligner:
    """Take a constant delay, in samples, out of one channel."""

    def __init__(self, delay: float) -> None:
        whole = round(delay)
        fraction = delay - whole
        self._shift = whole
        if abs(fraction) < 1e-12:
            self._weights = np.ones(1)
            self.reach = abs(whole)
        else:
            self._weights = stencil(0, fraction, HALF_WIDTH)
            self.reach = abs(whole) + HALF_WIDTH

    def correlation(self, first: int, second: int) -> float:
        """Correlate two derivatives of the aligned channel, per variance of its white noise."""
        filters = [
            np.convolve(self._weights, stencil(order, 0.0, HALF_WIDTH))
            for order in (first, second)
        ]
        return float(filters[0] @ filters[1])

    def apply(self, samples: NDArray[np.float64], start: int, count: int) -> NDArray[np.float64]:
        first = start + self._shift
        if self._weights.size == 1:
            return samples[first : first + count]
        return _convolve(samples[first - HALF_WIDTH :], self._weights, count)


def _convolve(
    samples: NDArray[np.float64], weights: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Weighted sums of consecutive samples, tap by tap so that every bit is reproducible."""
    result = np.zeros((count, *samples.shape[1:]))
    for tap, weight in enumerate(weights):
        result += weight * samples[tap : tap + count]
    return result
