# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Errors and intervals of the estimates under sensor noise.

Every cell of the tables is a Monte-Carlo study: the shipped knee and column under one excitation
with one level of noise, simulated once and given fresh noise for every run; errors are compared
with the Cramer-Rao bound, intervals with the truth.
"""

from dataclasses import dataclass
from functools import cache
import itertools
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')

import click
from identnl_ros.core.estimation.estimate import Estimate
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import multisine, Signal, sine
from monte_carlo import (
    clean_readings,
    cramer_rao,
    identified,
    Mapping,
    noisy,
    Outcome,
    outcome_of,
    parameter_table,
    Reals,
    RESULTS,
    SEED,
    shipped_knee_and_column,
    table,
    workers,
)
import numpy as np
from rich.console import Console

LEVELS = {1: 0.1, 10: 1.0, 100: 10.0}  # displacement noise [nm]: times the nominal noise
EXCITATIONS = ('multisine', 'sine')


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
    clean = clean_readings(model, layout, signal, cell.duration)
    return model, layout, clean, cramer_rao(model, layout, signal, cell.duration)


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
    generator = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=key))
    # The identification must not know what it is to find.
    unknown = model.with_unknowns(np.full(len(model.estimated), np.nan))
    return identified(unknown, layout, noisy(clean, layout, generator), cell.estimator)


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
    model, _, _, bound = prepared(cell)
    results = list(mapping(one_run, zip(itertools.repeat(cell, runs), range(runs), strict=False)))
    return outcome_of(cell, model.values[list(model.estimated)], bound, results)


def summary(outcomes: list[Outcome[Cell]]) -> str:
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
    return table(
        'excitation | noise',
        outcomes,
        lambda cell: f'{cell.excitation} | {cell.level} nm, {cell.level / 1000:g} m/s^2',
    )


def details(outcome: Outcome[Cell]) -> str:
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
    return parameter_table(f'{outcome.cell.excitation}, {outcome.cell.level} nm', outcome)


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
    outcomes: list[Outcome[Cell]] = []
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f'noise_{estimator}.md'
    with workers(processes, runs, console) as mapping:
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
