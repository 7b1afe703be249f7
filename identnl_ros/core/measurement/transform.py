# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensor blocks to body motion, streaming: the paper's step II."""

from collections.abc import Collection
from dataclasses import dataclass, field
from difflib import get_close_matches

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.alignment import Aligner
from identnl_ros.core.measurement.blocks import MOTION, MotionBlock, SampleBlock, stamp_after
from identnl_ros.core.measurement.channel_losses import ChannelLosses
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
from identnl_ros.core.measurement.degradation import (
    cost_of,
    layout_without,
    sentence_of_ignored,
    sentence_of_loss,
    sentences_of_unseen,
)
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.motion_map import MotionMap
from identnl_ros.core.measurement.noise import NoiseEstimate
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray


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
    interpolation or derivative are not given out. Where a sensor has no valid reading, the others
    of its kind tell the motion as far as they can; `degradation` says what that cost.

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
    without : collection of str
        Names of sensors that are not to be used.

    Raises
    ------
    LayoutError
        If the sensors do not fit the machine or do not see every coordinate, or one that is not
        to be used does not exist.

    """

    def __init__(
        self, model: Model, layout: Layout, sample_rate: float, without: Collection[str] = ()
    ) -> None:
        self._model = model
        self._given = layout
        self._rate = sample_rate
        self._ignored = channels_of(layout, without)
        self._kept = [i for i in range(len(layout.sensors)) if i not in self._ignored]
        # Sensors that are not used are as if they did not exist.
        self._layout = layout_without(layout, self._ignored)
        self._map = _map_without(model, layout, sample_rate, self._ignored)
        self._losses = ChannelLosses(len(self._kept), sample_rate)
        self._costs: dict[frozenset[int], str] = {}
        self._aligners = [Aligner(one.delay * sample_rate) for one in self._layout.sensors]
        self._stated_noise = np.array([sensor.noise for sensor in self._layout.sensors])
        self._noise_estimate = NoiseEstimate(len(self._kept))
        self._reach_out()
        self._covariances = self._usual_covariances
        self.follower = StreamFollower(replays=True)
        self.counts = TransformCounts()
        self._unseen = [np.zeros(len(model.coordinates), np.int_) for _ in MOTION]
        self._instants = 0
        self._buffer = np.empty((0, len(self._kept)))
        self._buffer_index = 0
        self._next_output = 0

    def _reach_out(self) -> None:
        """Find what follows from what is derived: samples around an instant, covariances."""
        self._usual_covariances = self._map.covariances(self._noise, self._map.usual)
        self._margin = self._map.margin
        self._reach = self._margin + max(aligner.reach for aligner in self._aligners)

    @property
    def derived(self) -> tuple[str, ...]:
        """Quantities that are, at least partly, derivatives of the displacement."""
        rates = zip(('velocity', 'acceleration'), self._map.derived, strict=True)
        return tuple(name for name, derived in rates if derived)

    @property
    def noise_estimated(self) -> bool:
        """Whether the layout leaves out a noise that is estimated from the samples."""
        return bool(np.isnan(self._stated_noise).any())

    @property
    def displacement_covariance(self) -> NDArray[np.float64]:
        """Of the coordinates at one sample; NaN while a noise is neither stated nor known."""
        return self._covariances[0]

    @property
    def degradation(self) -> tuple[str, ...]:
        """What sensors without readings for long, or ignored, have cost so far, in sentences."""
        sentences = []
        if self._ignored:
            noise = np.array([sensor.noise for sensor in self._given.sensors])
            noise[self._kept] = self._noise
            cost = cost_of(self._model, self._given, self._rate, self._ignored, noise)
            sentences.append(sentence_of_ignored(self._given, self._ignored, cost))
        for lost, samples in self._losses.together.items():
            if lost not in self._costs or self.noise_estimated:
                self._costs[lost] = cost_of(
                    self._model, self._layout, self._rate, lost, self._noise
                )
            total = self._losses.samples
            sentences.append(
                sentence_of_loss(self._layout, lost, self._costs[lost], samples, total, self._rate)
            )
        return (*sentences, *sentences_of_unseen(self._model, self._unseen, self._instants))

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
        block.require(len(self._given.sensors), self._rate)
        samples = block.samples[:, self._kept] if self._ignored else block.samples
        arrival = self.follower.accept(
            block.stream_id, block.first_index, block.next_index, block.last
        )
        if not arrival.usable:
            return None
        self.counts.blocks += 1
        if arrival is Arrival.FIRST:
            self._losses.restart()
            self._map.restart()
            self._next_output = 0
        self._count_missing(samples)
        lost = self._losses.lost
        self._losses.add(samples)
        # What is derived instead of measured, or no longer, does not continue what came before;
        # neither does motion with more noise where that must be read off the motion itself.
        derives_other = self._map.use_without(self._losses.lost)
        if derives_other:
            self._reach_out()
        continues = not derives_other and not (self.noise_estimated and lost != self._losses.lost)
        if arrival is Arrival.IN_ORDER and continues:
            self._buffer = np.concatenate((self._buffer, samples))
        else:
            # At least one instant between what does not belong together.
            skipped = int(arrival is Arrival.IN_ORDER and not self._reach)
            self._buffer = samples[skipped:].copy()
            self._buffer_index = block.first_index + skipped
        if arrival is not Arrival.IN_ORDER:
            self._noise_estimate.restart()
        if self.noise_estimated:
            self._noise_estimate.add(samples)
        ready = self._buffer.shape[0] - 2 * self._reach
        if ready <= 0 and not block.last:
            return None
        motion = self._motion(block, max(ready, 0))
        if ready > 0:
            self._buffer = self._buffer[ready:]
            self._buffer_index += ready
        return motion

    def _count_missing(self, samples: NDArray[np.float64]) -> None:
        missing = (~np.isfinite(samples)).sum(axis=0)
        for channel in np.flatnonzero(missing):
            name = self._layout.sensors[channel].name
            counts = self.counts.samples_without_reading
            counts[name] = counts.get(name, 0) + int(missing[channel])

    @property
    def _noise(self) -> NDArray[np.float64]:
        """Of one sample of every channel that is used."""
        estimated = self._noise_estimate.standard_deviation
        return np.where(np.isnan(self._stated_noise), estimated, self._stated_noise)

    def _motion(self, block: SampleBlock, ready: int) -> MotionBlock:
        # Aligned readings at the instants given out and the margin either side of them.
        count = ready + 2 * self._margin if ready else 0
        start = self._reach - self._margin
        aligned = np.empty((count, len(self._aligners)))
        for column, aligner in enumerate(self._aligners):
            aligned[:, column] = aligner.apply(self._buffer[:, column], start, count)
        first_index = max(self._buffer_index + self._reach, self._next_output)
        self._next_output = first_index + ready
        mapped = self._map.motion(aligned, first_index)
        if self.noise_estimated or any(one.maps for one in mapped.accuracies):
            self._covariances = self._map.covariances(self._noise, mapped.accuracies)
        else:
            self._covariances = self._usual_covariances
        tables = mapped.displacement, mapped.velocity, mapped.acceleration, mapped.force
        for unseen, table in zip(self._unseen, tables, strict=True):
            unseen += np.isnan(table).sum(axis=0)
        self._instants += ready
        velocity_derived, acceleration_derived = self._map.derived
        return MotionBlock(
            stream_id=block.stream_id,
            stamp_ns=stamp_after(block.stamp_ns, first_index - block.first_index, self._rate),
            first_index=first_index,
            sample_rate=self._rate,
            coordinates=self._model.coordinate_names,
            displacement=mapped.displacement,
            velocity=mapped.velocity,
            acceleration=mapped.acceleration,
            force=mapped.force,
            displacement_covariance=self._covariances[0],
            velocity_covariance=self._covariances[1],
            acceleration_covariance=self._covariances[2],
            force_covariance=self._covariances[3],
            displacement_acceleration_covariance=self._covariances[4],
            noise_estimated=self.noise_estimated,
            velocity_derived=velocity_derived,
            acceleration_derived=acceleration_derived,
            last=block.last,
        )


def channels_of(layout: Layout, names: Collection[str]) -> frozenset[int]:
    """
    Find sensors by name.

    Parameters
    ----------
    layout : Layout
    names : collection of str

    Returns
    -------
    frozenset of int
        Their channels.

    Raises
    ------
    LayoutError
        If one does not exist.

    """
    known = [sensor.name for sensor in layout.sensors]
    for name in names:
        if name not in known:
            close = get_close_matches(name, known, 3)
            hint = f'did you mean {" or ".join(close)}?' if close else f'has {", ".join(known)}'
            raise LayoutError(f'sensor {name}: layout {layout.stand} does not have it; {hint}')
    return frozenset(known.index(name) for name in names)


def _map_without(
    model: Model, layout: Layout, sample_rate: float, ignored: Collection[int]
) -> MotionMap:
    try:
        return MotionMap(model, layout_without(layout, ignored), sample_rate)
    except LayoutError as error:
        if not ignored:
            raise
        names = ', '.join(layout.sensors[i].name for i in sorted(ignored))
        raise LayoutError(f'{error} (ignored: {names})') from None
