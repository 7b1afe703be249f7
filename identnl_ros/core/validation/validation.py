# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Validation on data that the fit has not seen: simulate under the measured force, compare.

Step IV of Berczynski et al. (2010). The parameters are held. Of every uninterrupted run the
initial state alone is fitted, to all its samples, by Gauss-Newton with exact derivatives; what
an error of the parameters does to a simulation is taken with the initial state following.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from identnl_ros.core.algebra.covariance_root import covariance_root
from identnl_ros.core.errors import DataError, MachineError
from identnl_ros.core.likelihood.likelihood_point import (
    LikelihoodSettings,
    Point,
    start_of,
)
from identnl_ros.core.likelihood.likelihood_record import (
    PERFECT,
    prepare,
    PreparedRecord,
)
from identnl_ros.core.likelihood.likelihood_search import search
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_force import measured_forces
from identnl_ros.core.measurement.measured_record import MeasuredRecord, standard_deviations
from identnl_ros.core.measurement.noise import CORRELATION, NoiseEstimate
from identnl_ros.core.measurement.sensor_prediction import SensorPrediction
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.sensitivity import VariedSimulation
from identnl_ros.core.simulation.simulation import STEP_LIMIT as FINE_STEP_LIMIT
from identnl_ros.core.validation.agreement import (
    ChannelComparison,
    exact_test,
    NoiseReference,
    scale_tests,
    ScaleTest,
    STATED_DEGREES,
    StreamComparison,
)
from identnl_ros.core.validation.residual_sums import ResidualSums, SCALES
from identnl_ros.core.validation.spread import Spread
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# The initial state is refined until it moves by this many standard errors, so often at most.
SMALL_STEP = 0.05
REFINEMENTS = 8
FIRST_LENGTH = 256  # samples
# Largest integration step times the fastest eigenvalue where the sensors have noise.
NOISY_STEP_LIMIT = 0.6
# Simulations with noise in the force and errors of the parameters, from which it is estimated
# what the first and the part of the second that is not linear do.
DRAWS = 8
# Errors of parameters in these simulations, relative to their values, at most.
LARGEST_ERROR = 0.5
# What a simulation under an interpolated force may be wrong by, relative to the motion; with
# sensors without noise the integration takes shorter steps.
COMPUTATION = 1e-5
EXACT_COMPUTATION = 1e-6
# Directions of the initial state that readings see less than this, squared, are left alone.
UNSEEN = 1e-12


@dataclass(frozen=True)
class Traces:
    """
    Measurement and simulation over time, consecutive samples of the first run.

    Parameters
    ----------
    channels : tuple of str
    units : tuple of str
    time : ndarray, shape (n_samples,)
        From the first sample of the run [s].
    measured : ndarray, shape (n_samples, n_channels)
        NaN where there is no valid reading [SI].
    simulated, band : ndarray, shape (n_samples, n_channels)
        Band: standard deviation from that of the parameters [SI].

    """

    channels: tuple[str, ...]
    units: tuple[str, ...]
    time: Reals
    measured: Reals
    simulated: Reals
    band: Reals


@dataclass(frozen=True)
class _Draw:
    """A force and a model that could be the true ones; `parts` of the error, as in the root."""

    signals: tuple[Signal, ...]
    model: Model
    parts: Reals


class Validation:
    """
    Compare a machine with given parameters with the records of one stream.

    Parameters
    ----------
    model : Model
        All values known.
    covariance : ndarray, shape (n_unknowns, n_unknowns)
        Of the values, in the order of `Model.estimated`; NaN: that value is taken as exact.
    layout : Layout
    sample_rate : float
        [Hz].
    trace_samples : int
        Keep so many samples of the first run as `traces`.

    Raises
    ------
    DataError
        If the layout has no sensor of motion.
    LayoutError
        If a sensor does not fit the machine.
    MachineError
        If a value is missing, or a mass is not positive.

    """

    def __init__(
        self,
        model: Model,
        covariance: Reals,
        layout: Layout,
        sample_rate: float,
        trace_samples: int = 0,
    ) -> None:
        model.require_values()
        if not np.all(model.mass_diagonal() > 0):
            raise MachineError(f'machine {model.machine.name}: a mass is not positive')
        self._model = model
        self._held = replace(
            model, parameters=tuple(replace(one, estimated=False) for one in model.parameters)
        )
        self._root = covariance_root(covariance)
        self._layout = layout
        self._rate = sample_rate
        self._prediction = SensorPrediction(model, layout, sample_rate)
        channels = len(self._prediction.channels)
        if not channels:
            raise DataError('layout: no sensor of motion; there is nothing to compare with')
        certain = _noise_of_force(layout) is None and not self._root.any()
        self._draws = 0 if certain else DRAWS
        size = self._root.shape[1] + self._draws + 1
        self._products = np.zeros((len(SCALES), channels, size, size))
        self._counts = np.zeros((len(SCALES), channels))
        self._deviation = np.full(channels, np.nan)
        self._perfect = np.zeros(channels, dtype=np.bool_)
        self._limit = NOISY_STEP_LIMIT
        self._fast = NoiseEstimate(channels)
        self._signal = Spread(channels)
        self._generator = np.random.default_rng(0)
        self._trace_samples = trace_samples
        self._runs = self._samples = 0
        self.traces: Traces | None = None
        """Of the first run, where asked for."""
        self.notes: list[str] = []
        """What bears on trust, in sentences."""

    def add(self, record: MeasuredRecord) -> None:
        """
        Compare with one more uninterrupted run.

        Parameters
        ----------
        record : MeasuredRecord
            Of the layout and sample rate given.

        Raises
        ------
        DataError
            If a force has holes.
        LayoutError
            If a force is not measured, or some sensors have no noise while others have.
        MachineError
            If the motion grows without bound.

        """
        prepared = prepare(self._held, record, self._prediction)
        self._learn_noise(record, prepared)
        if self._perfect.any():
            self._limit = FINE_STEP_LIMIT
        state = self._initial_state(prepared)
        others = [self._drawn(record) for _ in range(self._draws)]
        own = 2 * len(self._model.coordinates)
        sums = ResidualSums(len(self._deviation), own + self._products.shape[-1])
        self._fast.restart()
        for rows, valid, measured in self._columns(prepared, state, others):
            sums.add(rows, valid)
            self._fast.add(np.where(valid, rows[:, :, -1], np.nan))
            self._signal.add(measured, valid)
        sums.close()
        follow = _following(sums.products[0].sum(axis=0), own)
        self._products += follow.T @ sums.products @ follow
        self._counts += sums.counts
        self._runs += 1
        self._samples += len(prepared.measured)
        if self._trace_samples and self.traces is None:
            self.traces = self._traced(prepared, state, follow[:own, : self._root.shape[1]])

    def comparison(self) -> StreamComparison:
        """
        Sum up all runs so far.

        Returns
        -------
        StreamComparison

        Raises
        ------
        DataError
            If there was no run.

        """
        if not self._runs:
            raise DataError('no uninterrupted run is long enough to compare with')
        channels = tuple(self._channel(i) for i in range(len(self._deviation)))
        return StreamComparison(
            self._rate, self._runs, self._samples, channels, self._joint_tests()
        )

    @cached_property
    def _sensors(self) -> tuple[int, ...]:
        return self._prediction.channels

    def _learn_noise(self, record: MeasuredRecord, prepared: PreparedRecord) -> None:
        """Fix the unit in which the residuals of every channel are counted."""
        largest = prepared.weights.max(axis=0)
        new = np.isnan(self._deviation) & (largest > 0)
        self._deviation[new] = 1 / largest[new]
        deviation = standard_deviations(record)[list(self._sensors)]
        self._perfect[new] = deviation[new] == 0

    def _initial_state(self, prepared: PreparedRecord) -> Reals:
        """
        Fit the initial state alone, to longer and longer beginnings of the run.

        Over a short time even a strongly nonlinear motion depends almost linearly on it.
        """
        total = len(prepared.measured)
        length = FIRST_LENGTH
        point = start_of(self._held, [prepared], 0)
        while True:
            part = replace(
                prepared, measured=prepared.measured[:length], weights=prepared.weights[:length]
            )
            point = self._refined(part, point)
            if length >= total:
                return point.states[0]
            length = min(4 * length, total)

    def _refined(self, prepared: PreparedRecord, point: Point) -> Point:
        settings = LikelihoodSettings()
        for _ in range(REFINEMENTS):
            outcome = search(self._held, [prepared], point, settings, self._limit)
            stays, point = outcome.point is point, outcome.point
            if stays or outcome.step.size <= SMALL_STEP:
                break
        return point

    def _noisy(self, record: MeasuredRecord) -> MeasuredRecord:
        """Add to the force what its sensors may have added."""
        noise = _noise_of_force(self._layout, standard_deviations(record))
        samples = record.samples.copy()
        if noise is not None:
            samples += noise * self._generator.standard_normal(samples.shape)
        return replace(record, samples=samples)

    def _drawn(self, record: MeasuredRecord) -> _Draw:
        """Draw noise of the force and errors of the parameters."""
        signals = measured_forces(self._model, self._noisy(record))
        parts = self._generator.standard_normal(self._root.shape[1])
        values = self._model.values[list(self._model.estimated)]
        errors = np.abs(self._root @ parts)
        free = (errors > 0) & (values != 0)
        # Values that no machine has tell nothing.
        parts *= min(
            1.0, LARGEST_ERROR / np.max(errors[free] / np.abs(values[free]), initial=LARGEST_ERROR)
        )
        return _Draw(signals, self._model.with_unknowns(values + self._root @ parts), parts)

    def _simulation(
        self, prepared: PreparedRecord, state: Reals, sensitive: bool, model: Model | None = None
    ) -> VariedSimulation:
        displacement, velocity = state.reshape(2, -1)
        return VariedSimulation(
            model or self._model, prepared.signals, 1 / self._rate,
            displacement.copy(), velocity.copy(),
            start=prepared.first / self._rate, step_limit=self._limit, sensitive=sensitive,
            origin=prepared.origin,
        )  # fmt: skip

    def _columns(
        self, prepared: PreparedRecord, state: Reals, draws: list[_Draw]
    ) -> Iterator[tuple[Reals, NDArray[np.bool_], Reals]]:
        """
        Simulate chunk by chunk; all columns in units of the noise.

        They are: by the initial state, by the independent parts of the parameters' errors, what
        each draw changes beyond what is linear in its errors of the parameters, the residual.
        """
        count, none = len(prepared.measured), np.empty(0)
        run = self._prediction.run
        main = run(self._simulation(prepared, state, sensitive=True), count, none)
        others = [
            run(
                self._simulation(
                    replace(prepared, signals=one.signals), state, False, one.model
                ), count, none,
            )
            for one in draws
        ]  # fmt: skip
        own = state.size
        # Channels without any reading keep their place.
        unit = np.where(np.isfinite(self._deviation), self._deviation, 1.0)
        for part, *rest in zip(main, *others, strict=True):
            place = slice(part.first, part.first + len(part.readings))
            valid = prepared.weights[place] > 0
            measured = prepared.measured[place]
            varied = part.derivatives[:, :, own:] @ self._root
            changes = (
                one.readings - part.readings - varied @ draw.parts
                for one, draw in zip(rest, draws, strict=True)
            )
            rows = np.concatenate(
                (
                    part.derivatives[:, :, :own],
                    varied,
                    *(change[:, :, np.newaxis] for change in changes),
                    (measured - part.readings)[:, :, np.newaxis],
                ),
                axis=2,
            )
            rows *= (valid / unit)[:, :, np.newaxis]
            yield rows, valid, measured

    def _traced(self, prepared: PreparedRecord, state: Reals, follow: Reals) -> Traces:
        """Simulate the beginning of a run once more, with the band."""
        count = min(self._trace_samples, len(prepared.measured))
        simulation = self._simulation(prepared, state, sensitive=True)
        readings, bands = [], []
        # What a late sensor shows needs the motion beyond.
        longer = min(len(prepared.measured), count + 2 * SCALES[-1])
        for part in self._prediction.run(simulation, longer, np.empty(0)):
            derivatives = part.derivatives
            varied = (
                derivatives[:, :, state.size :] @ self._root
                + derivatives[:, :, : state.size] @ follow
            )
            readings.append(part.readings)
            bands.append(np.sqrt(np.sum(varied**2, axis=2)))
        sensors = [self._layout.sensors[i] for i in self._sensors]
        valid = prepared.weights[:count] > 0
        return Traces(
            tuple(one.name for one in sensors),
            tuple(one.kind.unit for one in sensors),
            (prepared.first + np.arange(count)) / self._rate,
            np.where(valid, prepared.measured[:count], np.nan),
            np.concatenate(readings)[:count],
            np.concatenate(bands)[:count],
        )

    def _reference(self, channel: int, level: int) -> NoiseReference:
        """Noise to compare with: the stated one for the size, else the fastest changes."""
        sensor = self._layout.sensors[self._sensors[channel]]
        if level == 0 and np.isfinite(sensor.noise):
            return NoiseReference(1.0, STATED_DEGREES)
        deviation, count = self._fast.standard_deviation[channel], self._fast.counts[channel]
        if not np.isfinite(deviation):
            return NoiseReference(1.0, STATED_DEGREES)
        return NoiseReference(float(deviation**2), max(float(count) / CORRELATION, 1.0))

    def _computation(self, channel: int) -> float:
        """Sum of squares of what the simulation may be wrong by, in units of the noise."""
        error = COMPUTATION * self._signal.deviation[channel] / self._deviation[channel]
        return float(self._counts[0, channel] * error**2)

    def _channel(self, channel: int) -> ChannelComparison:
        sensor = self._layout.sensors[self._sensors[channel]]
        products, counts = self._products[:, channel], self._counts[:, channel]
        stated = bool(np.isfinite(sensor.noise))
        if not counts[0]:
            nan = float('nan')
            return ChannelComparison(sensor, 0, nan, nan, nan, stated, nan, nan, ())
        unit = float(self._deviation[channel])
        band = self._root.shape[1]
        squares = np.diag(products[0]) / counts[0]
        drawn = squares[band:-1]
        force = float(drawn.mean()) if self._draws else 0.0
        tests: tuple[ScaleTest, ...]
        if self._perfect[channel]:
            noise = 0.0
            tests = (exact_test(products[0], counts[0], self._draws, EXACT_COMPUTATION / PERFECT),)
        else:
            noise = 1.0 if stated else float(np.sqrt(self._reference(channel, 0).variance))
            tests = tuple(
                test
                for i in range(len(SCALES))
                if counts[i]
                for test in scale_tests(
                    i,
                    products[i],
                    counts[i],
                    self._draws,
                    self._reference(channel, i),
                    self._computation(channel),
                )
            )
        return ChannelComparison(
            sensor,
            int(counts[0]),
            unit * float(np.sqrt(squares[-1])),
            float(self._signal.deviation[channel]),
            unit * noise,
            stated,
            unit * float(np.sqrt(squares[:band].sum())),
            unit * float(np.sqrt(force)),
            tests,
        )

    def _joint_tests(self) -> tuple[ScaleTest, ...]:
        """Test all noisy channels together: small differences in many of them add up."""
        noisy = np.flatnonzero(~self._perfect & (self._counts[0] > 0)).tolist()
        result: list[ScaleTest] = []
        for level in range(len(SCALES)):
            references = {i: self._reference(i, level) for i in noisy}
            used = [i for i in noisy if references[i].variance > 0 and self._counts[level, i]]
            if len(used) < 2:
                continue
            products = sum(self._products[level, i] / references[i].variance for i in used)
            degrees = sum(references[i].degrees for i in used)
            # Stated noises may all be wrong the same way.
            degrees = STATED_DEGREES if level == 0 else degrees
            count = float(self._counts[level, used].sum())
            reference = NoiseReference(1.0, degrees)
            computed = sum(self._computation(i) / references[i].variance for i in used)
            result += scale_tests(
                level, np.asarray(products), count, self._draws, reference, computed
            )
        return tuple(result)


def _following(products: Reals, own: int) -> Reals:
    """
    Let the initial state follow whatever else changes, to the least residual.

    Returns
    -------
    ndarray, shape (n_columns, n_columns - own)
        From all columns to those that are left, with what the initial state takes of them.

    """
    scale = np.sqrt(np.diag(products)[:own])
    scale[scale == 0] = 1.0
    squares, shapes = np.linalg.eigh(products[:own, :own] / np.outer(scale, scale))
    seen = squares > UNSEEN * max(float(squares.max(initial=0.0)), np.finfo(float).tiny)
    inverse = (shapes[:, seen] / squares[seen]) @ shapes[:, seen].T
    taken = inverse @ (products[:own, own:] / scale[:, np.newaxis]) / scale[:, np.newaxis]
    return np.vstack((-taken, np.eye(len(products) - own)))


def _noise_of_force(layout: Layout, found: Reals | None = None) -> Reals | None:
    """Noise of the force sensors, 0 for all others; None: they have none, for certain."""
    cells = np.array([bool(sensor.excitation) for sensor in layout.sensors])
    if found is None:
        found = np.array([
            np.hypot(sensor.noise, sensor.resolution) for sensor in layout.sensors
        ])  # fmt: skip
    noise = np.where(cells, found, 0.0)
    return None if np.all(noise == 0) else np.nan_to_num(noise)
