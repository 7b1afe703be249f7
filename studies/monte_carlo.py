# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the Monte-Carlo studies share: the machine, one noisy run, the tables."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
import time
from typing import Any, Generic, TypeVar

from identnl_ros.core.design.fisher import expected_information
from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus
from identnl_ros.core.estimation.identifier import identifier_for
from identnl_ros.core.likelihood.likelihood_estimate import likelihood_estimate
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
from identnl_ros.storage.shipped import shipped_config
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from scipy.stats import binom, norm

Reals = NDArray[np.float64]
Result = tuple[Estimate, float]
Mapping = Callable[[Callable[[Any], Result], Iterable[Any]], Iterable[Result]]
C = TypeVar('C')

RATE = 10e3  # [Hz]
# The machine vibrates this long before the samples that are used [s].
SETTLING = 0.5
RESULTS = Path(__file__).parent / 'results'
BLOCK = 500
SEED = 20260101


@dataclass(frozen=True)
class Outcome(Generic[C]):
    """
    What a cell has shown.

    Parameters
    ----------
    cell : object
        The experiment.
    names : tuple of str
    truth, bound : ndarray, shape (n_unknowns,)
        True values, their Cramer-Rao standard deviations.
    values, deviations : ndarray, shape (n_runs, n_unknowns)
        Estimates and the standard deviations stated with them; NaN where a run failed.
    doubted, failed : int
        Runs whose model was doubted; that gave no estimate with an interval.
    seconds : float
        Median time of a run.

    """

    cell: C
    names: tuple[str, ...]
    truth: Reals
    bound: Reals
    values: Reals
    deviations: Reals
    doubted: int
    failed: int
    seconds: float

    @property
    def error_ratio(self) -> Reals:
        """Root mean square error over the bound."""
        return np.asarray(
            np.sqrt(np.nanmean((self.values - self.truth) ** 2, axis=0)) / self.bound
        )

    @property
    def bias_ratio(self) -> Reals:
        """Mean error over the root mean square error."""
        error = self.values - self.truth
        return np.asarray(np.nanmean(error, axis=0) / np.sqrt(np.nanmean(error**2, axis=0)))

    @property
    def coverage(self) -> Reals:
        """Share of the 95 % intervals that hold the truth."""
        inside = np.abs(self.values - self.truth) <= norm.ppf(0.975) * self.deviations
        return np.asarray(inside[np.isfinite(self.deviations).all(axis=1)].mean(axis=0))

    @property
    def band(self) -> tuple[float, float]:
        """Between which 99.9 % of coverages would lie if intervals were exact."""
        runs = int(np.isfinite(self.deviations).all(axis=1).sum())
        low, high = binom.interval(0.999, runs, 0.95)
        return low / runs, high / runs


def shipped_knee_and_column() -> tuple[Model, Layout]:
    """
    Load the reference machine with displacement sensors and accelerometers.

    Returns
    -------
    Model
    Layout
        With nominal noise and an exact force cell, as the bound takes it.

    """
    model = assemble(load_machine(shipped_config('knee_column.yaml')).machine)
    layout = load_layout(shipped_config('knee_column_layout.yaml')).layout
    sensors = tuple(
        replace(sensor, noise=0.0) if sensor.kind is SensorKind.FORCE else sensor
        for sensor in layout.sensors
        if sensor.kind is not SensorKind.VELOCITY
    )
    return model, replace(layout, sensors=sensors)


def clean_readings(model: Model, layout: Layout, signal: Signal, duration: float) -> Reals:
    """
    Simulate what perfect sensors read once the machine has settled.

    Parameters
    ----------
    model : Model
    layout : Layout
    signal : Signal
    duration : float
        [s].

    Returns
    -------
    ndarray, shape (n_samples, n_channels)

    """
    settling = round(SETTLING * RATE)
    count = round(duration * RATE)
    stand = SimulatedStand(model, layout.with_noise_times(0), (signal,), RATE, 0, 1)
    return stand.read(settling + count).samples[settling:]


def cramer_rao(model: Model, layout: Layout, signal: Signal, duration: float) -> Reals:
    """
    Find the smallest standard deviations of the unknowns.

    Parameters
    ----------
    model : Model
    layout : Layout
    signal : Signal
    duration : float
        [s].

    Returns
    -------
    ndarray, shape (n_unknowns,)

    """
    information = expected_information(model, layout, (signal,), RATE, duration, SETTLING)
    return np.sqrt(np.diag(information.solve().inverse))


def noisy(clean: Reals, layout: Layout, generator: np.random.Generator) -> Reals:
    """
    Add the noise of the sensors.

    Parameters
    ----------
    clean : ndarray, shape (n_samples, n_channels)
    layout : Layout
    generator : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n_samples, n_channels)

    """
    noise = np.array([sensor.noise for sensor in layout.sensors])
    return np.asarray(clean + noise * generator.standard_normal(clean.shape))


def identified(model: Model, layout: Layout, samples: Reals, estimator: str) -> Result:
    """
    Estimate from one record.

    Parameters
    ----------
    model : Model
        Knows of its unknowns no more than the identification may.
    layout : Layout
    samples : ndarray, shape (n_samples, n_channels)
    estimator : str
        ``weak``, ``pointwise`` or ``likelihood``.

    Returns
    -------
    Estimate
    float
        Time that it took [s].

    """
    begin = time.perf_counter()
    if estimator == 'likelihood':
        estimate = likelihood_estimate(model, [MeasuredRecord(layout, RATE, samples)])
        return estimate, time.perf_counter() - begin
    transform = MotionTransform(model, layout, RATE)
    identifier = identifier_for(model, estimator)
    for first in range(0, len(samples), BLOCK):
        part = samples[first : first + BLOCK]
        motion = transform.add(
            SampleBlock(1, 0, first, RATE, part, np.zeros(part.shape[1], np.uint8))
        )
        if motion is not None:
            identifier.add(motion)
    return identifier.estimate(), time.perf_counter() - begin


def outcome_of(cell: C, truth: Reals, bound: Reals, results: Sequence[Result]) -> Outcome[C]:
    """
    Gather the runs of a cell.

    Parameters
    ----------
    cell : object
    truth, bound : ndarray, shape (n_unknowns,)
    results : sequence of (Estimate, float)

    Returns
    -------
    Outcome

    """
    estimates = [estimate for estimate, _ in results]
    values, deviations = (
        np.array([[getattr(one, name) for one in each.parameters] for each in estimates])
        for name in ('value', 'standard_deviation')
    )
    doubted = sum(each.parameters[0].status is EstimateStatus.MODEL_IN_DOUBT for each in estimates)
    return Outcome(
        cell,
        tuple(one.name for one in estimates[0].parameters),
        truth,
        bound,
        values,
        deviations,
        doubted,
        int((~np.isfinite(deviations).all(axis=1)).sum()),
        float(np.median([seconds for _, seconds in results])),
    )


def table(heads: str, outcomes: Sequence[Outcome[C]], label: Callable[[C], str]) -> str:
    """
    Write the table of several cells.

    Parameters
    ----------
    heads : str
        Of the columns that tell the cells apart, e.g. ``excitation | noise``.
    outcomes : sequence of Outcome
    label : callable
        Gives these columns of a cell.

    Returns
    -------
    str
        Markdown.

    """
    lines = [
        f'| {heads} | runs | RMSE / bound, all (worst) | coverage of 95 % intervals, '
        'pooled (lowest - highest; 99.9 % band) | worst bias / RMSE | doubted | failed | '
        's per run |',
        '| --- ' * (heads.count('|') + 8) + '|',
    ]
    for outcome in outcomes:
        ratio, coverage = outcome.error_ratio, outcome.coverage
        low, high = outcome.band
        lines.append(
            f'| {label(outcome.cell)} | {len(outcome.values)} | '
            f'{np.sqrt(np.mean(ratio**2)):.3f} ({ratio.max():.3f}) | '
            f'{100 * coverage.mean():.2f} % ({100 * coverage.min():.1f} - '
            f'{100 * coverage.max():.1f}; {100 * low:.1f} - {100 * high:.1f}) | '
            f'{np.abs(outcome.bias_ratio).max():.3f} | {outcome.doubted} | {outcome.failed} | '
            f'{outcome.seconds:.2f} |'
        )
    return '\n'.join(lines)


def parameter_table(title: str, outcome: Outcome[C]) -> str:
    """
    Write the table of one cell, parameter by parameter.

    Parameters
    ----------
    title : str
    outcome : Outcome

    Returns
    -------
    str
        Markdown.

    """
    lines = [
        f'### {title}\n',
        '| parameter | bound | RMSE / bound | bias / RMSE | coverage |',
        '| --- | --- | --- | --- | --- |',
    ]
    for i, name in enumerate(outcome.names):
        lines.append(
            f'| {name} | {100 * outcome.bound[i] / outcome.truth[i]:.3g} % | '
            f'{outcome.error_ratio[i]:.3f} | {outcome.bias_ratio[i]:+.3f} | '
            f'{100 * outcome.coverage[i]:.1f} % |'
        )
    return '\n'.join(lines)


@contextmanager
def workers(processes: int, runs: int, console: Console) -> Iterator[Mapping]:
    """
    Share runs among processes, with a progress bar.

    Parameters
    ----------
    processes : int
    runs : int
        Of every cell.
    console : Console

    Yields
    ------
    callable
        In the place of `map`.

    """
    with ProcessPoolExecutor(processes) as pool:

        def mapping(function: Callable[[Any], Result], tasks: Iterable[Any]) -> Iterable[Result]:
            return track(
                pool.map(function, tasks, chunksize=4), total=runs, console=console, transient=True
            )

        yield mapping
