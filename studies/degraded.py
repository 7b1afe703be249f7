# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Errors and intervals of the estimates where samples are missing and sensors are dead.

Every cell of the table is a Monte-Carlo study as in `noise`: the shipped knee and column under the
multisine with nominal noise, simulated once and given fresh noise and fresh losses for every run.
"""

from dataclasses import dataclass
from functools import cache
import itertools
import os
import time

os.environ.setdefault('OMP_NUM_THREADS', '1')

import click
from identnl_ros.core.estimation.estimate import Estimate
from identnl_ros.core.estimation.identifier import identifier_for
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import multisine
from monte_carlo import (
    clean_readings,
    cramer_rao,
    Mapping,
    noisy,
    Outcome,
    outcome_of,
    parameter_table,
    RATE,
    Reals,
    RESULTS,
    SEED,
    shipped_knee_and_column,
    table,
    workers,
)
import numpy as np
from rich.console import Console

# Samples that are lost together.
BLOCK = 100
DEAD = 'front_left'


@dataclass(frozen=True)
class Cell:
    """
    One Monte-Carlo experiment.

    Parameters
    ----------
    name : str
        What is missing, in words.
    estimator : str
        ``weak`` or ``pointwise``.
    duration : float
        Of the data of every run [s].
    lost_blocks : float
        Chance that a block of samples of all channels is lost.
    lost_readings : float
        Chance that a block of samples of a channel of motion is lost.
    lost_samples : float
        Chance that a sample of a channel of motion is lost.
    dead_from : float
        Time from which on a displacement sensor is dead [s].

    """

    name: str
    estimator: str
    duration: float
    lost_blocks: float = 0.0
    lost_readings: float = 0.0
    lost_samples: float = 0.0
    dead_from: float = np.inf


def cells(estimator: str, duration: float) -> tuple[Cell, ...]:
    """
    List the experiments.

    Parameters
    ----------
    estimator : str
    duration : float
        [s].

    Returns
    -------
    tuple of Cell

    """
    run = estimator, duration
    return (
        Cell('nothing', *run),
        Cell('samples, 1e-3', *run, lost_samples=1e-3),
        Cell('a sensor', *run, dead_from=0.0),
        Cell('a sensor from the middle on', *run, dead_from=duration / 2),
        Cell('5 % of all readings', *run, lost_readings=0.05),
        Cell('5 % of the blocks and a sensor', *run, lost_blocks=0.05, dead_from=0.0),
    )


@cache
def prepared(duration: float) -> tuple[Model, Layout, Reals, Reals]:
    """
    Simulate the machine once.

    Parameters
    ----------
    duration : float
        [s].

    Returns
    -------
    Model
    Layout
    ndarray, shape (n_samples, n_channels)
        Clean readings.
    ndarray, shape (n_unknowns,)
        Cramer-Rao standard deviations where nothing is missing.

    """
    model, layout = shipped_knee_and_column()
    point = model.machine.excitations[0]
    signal = multisine(point.amplitude, point.band, 0.5, np.random.default_rng(7))
    clean = clean_readings(model, layout, signal, duration)
    return model, layout, clean, cramer_rao(model, layout, signal, duration)


def thinned(
    samples: Reals, layout: Layout, cell: Cell, generator: np.random.Generator
) -> tuple[Reals, list[int]]:
    """
    Lose what a cell loses.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n_channels)
    layout : Layout
    cell : Cell
    generator : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n_samples, n_channels)
        NaN: missing.
    list of int
        Blocks that arrive.

    """
    count = -(-len(samples) // BLOCK)
    # Without the force nothing can be simulated.
    motion = np.array([sensor.kind.value != 'force' for sensor in layout.sensors])
    lost = generator.random(samples.shape) < cell.lost_samples
    blocks = generator.random((count, samples.shape[1])) < cell.lost_readings
    lost |= np.repeat(blocks, BLOCK, axis=0)[: len(samples)]
    dead = next(i for i, sensor in enumerate(layout.sensors) if sensor.name == DEAD)
    if np.isfinite(cell.dead_from):
        lost[round(cell.dead_from * RATE) :, dead] = True
    arrives = np.flatnonzero(generator.random(count) >= cell.lost_blocks)
    return np.where(lost & motion, np.nan, samples), arrives.tolist()


def one_run(task: tuple[Cell, int]) -> tuple[Estimate, float]:
    """
    Draw noise and losses, and estimate.

    Parameters
    ----------
    task : tuple of (Cell, int)
        The cell and the number of the run, from which all that is random follows.

    Returns
    -------
    Estimate
    float
        Time that it took [s].

    """
    cell, number = task
    model, layout, clean, _ = prepared(cell.duration)
    generator = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(number,)))
    samples = noisy(clean, layout, generator)
    samples, arrives = thinned(samples, layout, cell, generator)
    begin = time.perf_counter()
    transform = MotionTransform(model, layout, RATE)
    # The identification must not know what it is to find.
    unknown = model.with_unknowns(np.full(len(model.estimated), np.nan))
    identifier = identifier_for(unknown, cell.estimator)
    status = np.zeros(samples.shape[1], np.uint8)
    for block in arrives:
        first = block * BLOCK
        motion = transform.add(
            SampleBlock(1, 0, first, RATE, samples[first : first + BLOCK], status)
        )
        if motion is not None:
            identifier.add(motion)
    return identifier.estimate(), time.perf_counter() - begin


def instants(cell: Cell, runs: int) -> tuple[float, float]:
    """
    Count the instants that can be used.

    Parameters
    ----------
    cell : Cell
    runs : int
        To average over.

    Returns
    -------
    float
        Share of the instants at which displacement and acceleration are known.
    float
        Share of those at which every sensor has a reading.

    """
    model, layout, clean, _ = prepared(cell.duration)
    known, complete = [], []
    for number in range(runs):
        generator = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(number, 1)))
        samples, arrives = thinned(clean, layout, cell, generator)
        transform = MotionTransform(model, layout, RATE)
        used = full = 0
        for block in arrives:
            part = samples[block * BLOCK : (block + 1) * BLOCK]
            status = np.zeros(part.shape[1], np.uint8)
            motion = transform.add(SampleBlock(1, 0, block * BLOCK, RATE, part, status))
            full += int(np.isfinite(part).all(axis=1).sum())
            if motion is not None:
                values = np.concatenate((motion.displacement, motion.acceleration), axis=1)
                used += int(np.isfinite(values).all(axis=1).sum())
        known.append(used / len(clean))
        complete.append(full / len(clean))
    return float(np.mean(known)), float(np.mean(complete))


def study(cell: Cell, runs: int, mapping: Mapping) -> Outcome[Cell]:
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
    model, _, _, bound = prepared(cell.duration)
    results = list(mapping(one_run, zip(itertools.repeat(cell, runs), range(runs), strict=False)))
    return outcome_of(cell, model.values[list(model.estimated)], bound, results)


@click.command()
@click.option('--estimator', default='weak', show_default=True)
@click.option('--runs', default=200, show_default=True)
@click.option('--duration', default=0.3, show_default=True, help='Of the data of a run [s].')
@click.option('--processes', default=2, show_default=True)
@click.option(
    '--cell', 'numbers', multiple=True, type=int, help='Of the table, from 0; default: all.'
)
def main(
    estimator: str, runs: int, duration: float, processes: int, numbers: tuple[int, ...]
) -> None:
    """Study missing samples and dead sensors; the table goes to studies/results."""
    console = Console()
    outcomes: list[Outcome[Cell]] = []
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / 'degraded.md'
    with workers(processes, runs, console) as mapping:
        planned = cells(estimator, duration)
        for cell in (planned[i] for i in numbers or range(len(planned))):
            outcomes.append(study(cell, runs, mapping))
            shares = {one.cell.name: instants(one.cell, min(runs, 20)) for one in outcomes}

            def label(cell: Cell, shares: dict[str, tuple[float, float]] = shares) -> str:
                known, complete = shares[cell.name]
                return f'{cell.name} | {100 * known:.1f} % | {100 * complete:.1f} %'

            summary = table('missing | instants used | with all readings', outcomes, label)
            console.print(summary.splitlines()[-1], markup=False, soft_wrap=True)
            details = '\n\n'.join(parameter_table(one.cell.name, one) for one in outcomes)
            path.write_text(
                f'# Missing samples and dead sensors: {estimator} estimator\n\n'
                f'Knee and column, all 16 parameters, displacement and acceleration sensors, '
                f'multisine, 10 nm and 0.01 m/s^2, {duration:g} s of data at 10 kHz; the dead '
                f'sensor is {DEAD}. The bound is that of complete data. Written by `python '
                f'studies/degraded.py --estimator {estimator} --runs {runs}`.\n\n'
                f'{summary}\n\n{details}\n'
            )


if __name__ == '__main__':
    main()
