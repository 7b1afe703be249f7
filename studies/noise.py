# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Errors and intervals of the estimates under sensor noise.

Every cell of the tables is a Monte-Carlo study: the shipped knee and column under one excitation
with one level of noise, simulated once and given fresh noise for every run; errors are compared
with the Cramer-Rao bound, intervals with the truth.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
import itertools
import os
from pathlib import Path
import time

os.environ.setdefault('OMP_NUM_THREADS', '1')

import click
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
from identnl_ros.core.simulation.excitation import multisine, Signal, sine
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

RATE = 10e3  # [Hz]
# The machine vibrates this long before the samples that are used [s].
SETTLING = 0.5
LEVELS = {1: 0.1, 10: 1.0, 100: 10.0}  # displacement noise [nm]: times the nominal noise
EXCITATIONS = ('multisine', 'sine')
RESULTS = Path(__file__).parent / 'results'
BLOCK = 500


@dataclass(frozen=True)
class Cell:
    """
    One Monte-Carlo experiment.

    Parameters
    ----------
    estimator : str
        ``weak``, ``pointwise`` or ``likelihood``.
    excitation : str
        ``multisine`` or ``sine``.
    level : int
        Noise of the displacement sensors [nm]; the accelerometers have 0.001 m/s^2 per nm.
    duration : float
        Of the data of every run [s].

    """

    estimator: str
    excitation: str
    level: int
    duration: float


@dataclass(frozen=True)
class Outcome:
    """
    What a cell has shown.

    Parameters
    ----------
    cell : Cell
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

    cell: Cell
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


def signal_of(model: Model, excitation: str) -> Signal:
    """
    Make the force of the shipped exciter.

    Parameters
    ----------
    model : Model
    excitation : str

    Returns
    -------
    Signal

    """
    point = model.machine.excitations[0]
    if excitation == 'sine':
        return sine(point.amplitude, point.frequency)
    return multisine(point.amplitude, point.band, 0.5, np.random.default_rng(7))


@cache
def prepared(cell: Cell) -> tuple[Model, Layout, Reals, Reals]:
    """
    Simulate a cell once.

    Parameters
    ----------
    cell : Cell

    Returns
    -------
    Model
    Layout
    ndarray, shape (n_samples, n_channels)
        Clean readings.
    ndarray, shape (n_unknowns,)
        Cramer-Rao standard deviations.

    """
    model, layout = shipped_knee_and_column()
    layout = layout.with_noise_times(LEVELS[cell.level])
    signal = signal_of(model, cell.excitation)
    settling = round(SETTLING * RATE)
    count = round(cell.duration * RATE)
    stand = SimulatedStand(model, layout.with_noise_times(0), (signal,), RATE, 0, 1)
    clean = stand.read(settling + count).samples[settling:]
    information = expected_information(
        model, layout, (signal,), RATE, cell.duration, settling=SETTLING
    )
    return model, layout, clean, np.sqrt(np.diag(information.solve().inverse))


def one_run(task: tuple[Cell, int]) -> tuple[Estimate, float]:
    """
    Draw noise and estimate.

    Parameters
    ----------
    task : tuple of (Cell, int)
        The cell and the number of the run, from which the noise follows.

    Returns
    -------
    Estimate
    float
        Time that it took [s].

    """
    cell, number = task
    model, layout, clean, _ = prepared(cell)
    key = (EXCITATIONS.index(cell.excitation), cell.level, number)
    generator = np.random.default_rng(np.random.SeedSequence(20260101, spawn_key=key))
    noise = np.array([sensor.noise for sensor in layout.sensors])
    samples = clean + noise * generator.standard_normal(clean.shape)
    # The identification must not know what it is to find.
    unknown = model.with_unknowns(np.full(len(model.estimated), np.nan))
    begin = time.perf_counter()
    if cell.estimator == 'likelihood':
        estimate = likelihood_estimate(unknown, [MeasuredRecord(layout, RATE, samples)])
    else:
        transform = MotionTransform(model, layout, RATE)
        identifier = identifier_for(unknown, cell.estimator)
        for first in range(0, len(samples), BLOCK):
            part = samples[first : first + BLOCK]
            motion = transform.add(
                SampleBlock(1, 0, first, RATE, part, np.zeros(part.shape[1], np.uint8))
            )
            if motion is not None:
                identifier.add(motion)
        estimate = identifier.estimate()
    return estimate, time.perf_counter() - begin


def study(
    cell: Cell,
    runs: int,
    mapping: Callable[..., Iterator[tuple[Estimate, float]]],
) -> Outcome:
    """
    Carry out a cell.

    Parameters
    ----------
    cell : Cell
    runs : int
    mapping : callable
        `map`, or that of a pool of processes.

    Returns
    -------
    Outcome

    """
    model, _, _, bound = prepared(cell)
    results = list(mapping(one_run, zip(itertools.repeat(cell, runs), range(runs), strict=False)))
    estimates = [estimate for estimate, _ in results]
    values, deviations = (
        np.array([[getattr(one, name) for one in each.parameters] for each in estimates])
        for name in ('value', 'standard_deviation')
    )
    doubted = sum(each.parameters[0].status is EstimateStatus.MODEL_IN_DOUBT for each in estimates)
    return Outcome(
        cell,
        tuple(one.name for one in estimates[0].parameters),
        model.values[list(model.estimated)],
        bound,
        values,
        deviations,
        doubted,
        int((~np.isfinite(deviations).all(axis=1)).sum()),
        float(np.median([seconds for _, seconds in results])),
    )


def summary(outcomes: list[Outcome]) -> str:
    """
    Write the table of several cells.

    Parameters
    ----------
    outcomes : list of Outcome

    Returns
    -------
    str
        Markdown.

    """
    lines = [
        '| excitation | noise | runs | RMSE / bound, all (worst) | coverage of 95 % intervals, '
        'pooled (lowest - highest; 99.9 % band) | worst bias / RMSE | doubted | failed | '
        's per run |',
        '| --- | --- | --- | --- | --- | --- | --- | --- | --- |',
    ]
    for outcome in outcomes:
        ratio, coverage = outcome.error_ratio, outcome.coverage
        low, high = outcome.band
        lines.append(
            f'| {outcome.cell.excitation} | {outcome.cell.level} nm, '
            f'{outcome.cell.level / 1000:g} m/s^2 | {len(outcome.values)} | '
            f'{np.sqrt(np.mean(ratio**2)):.3f} ({ratio.max():.3f}) | '
            f'{100 * coverage.mean():.2f} % ({100 * coverage.min():.1f} - '
            f'{100 * coverage.max():.1f}; {100 * low:.1f} - {100 * high:.1f}) | '
            f'{np.abs(outcome.bias_ratio).max():.3f} | {outcome.doubted} | {outcome.failed} | '
            f'{outcome.seconds:.2f} |'
        )
    return '\n'.join(lines)


def details(outcome: Outcome) -> str:
    """
    Write the table of one cell, parameter by parameter.

    Parameters
    ----------
    outcome : Outcome

    Returns
    -------
    str
        Markdown.

    """
    cell = outcome.cell
    lines = [
        f'### {cell.excitation}, {cell.level} nm\n',
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


@click.command()
@click.option('--estimator', default='weak', show_default=True)
@click.option('--runs', default=1000, show_default=True)
@click.option('--duration', default=0.3, show_default=True, help='Of the data of a run [s].')
@click.option('--processes', default=2, show_default=True)
@click.option('--level', 'levels', multiple=True, type=click.Choice([str(one) for one in LEVELS]))
@click.option('--excitation', 'excitations', multiple=True, type=click.Choice(EXCITATIONS))
def main(
    estimator: str,
    runs: int,
    duration: float,
    processes: int,
    levels: tuple[str, ...],
    excitations: tuple[str, ...],
) -> None:
    """Study one estimator; tables go to studies/results."""
    console = Console()
    outcomes: list[Outcome] = []
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f'noise_{estimator}.md'
    with ProcessPoolExecutor(processes) as pool:

        def mapping(function, tasks):  # type: ignore[no-untyped-def]
            return track(
                pool.map(function, tasks, chunksize=4), total=runs, console=console, transient=True
            )

        for excitation, level in itertools.product(excitations or EXCITATIONS, levels or LEVELS):
            cell = Cell(estimator, excitation, int(level), duration)
            outcomes.append(study(cell, runs, mapping))
            console.print(summary(outcomes).splitlines()[-1], markup=False, soft_wrap=True)
            path.write_text(
                f'# Estimates under noise: {estimator} estimator\n\n'
                f'Knee and column, all 16 parameters, {duration:g} s of data at 10 kHz; written '
                f'by `python studies/noise.py --estimator {estimator}`.\n\n'
                f'{summary(outcomes)}\n\n' + '\n\n'.join(details(one) for one in outcomes) + '\n'
            )


if __name__ == '__main__':
    main()
