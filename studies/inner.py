# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Errors and intervals where preloads and the exponent of the slideways are unknown too.

The shipped knee and column under a multisine, simulated once per cell and given fresh noise for
every run. The search starts from preloads and exponents that are a fifth off, up or down at
random, and from no value of the other unknowns.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
import itertools
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')

import click
from identnl_ros.core.estimation.estimate import Estimate
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient, Tie
from identnl_ros.core.mechanics.joints import Slideway
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import multisine, Signal
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
from numpy.typing import NDArray
from rich.console import Console

# What is unknown beside the 16 coefficients.
UNKNOWNS = {
    'exponent': 'one exponent for all slideways',
    'preload': 'preload of slideway_8',
    'both': 'one exponent, one preload for all (known ratio)',
    'all': 'one exponent, every preload',
    'single': 'every exponent, every preload',
}
AMPLITUDES = (100, 200, 500, 1000)  # of the sine with the same effective value [N]
# Of the Monte-Carlo runs: the amplitude, and what is unknown.
CELLS = {
    'weak': (*((1000, unknown) for unknown in UNKNOWNS), (200, 'both'), (200, 'all')),
    'likelihood': ((1000, 'both'), (1000, 'all'), (200, 'all')),
}
START_ERROR = 0.2
DURATION = 0.3  # [s]


@dataclass(frozen=True)
class Cell:
    """
    One Monte-Carlo experiment.

    Parameters
    ----------
    estimator : str
        ``weak`` or ``likelihood``.
    unknown : str
        Of `UNKNOWNS`.
    amplitude : int
        Of the sine with the same effective value [N].

    """

    estimator: str
    unknown: str
    amplitude: int


def with_unknown(machine: Machine, unknown: str) -> Machine:
    """
    Make preloads and exponents of the slideways unknown.

    Parameters
    ----------
    machine : Machine
    unknown : str
        Of `UNKNOWNS`.

    Returns
    -------
    Machine

    """
    first = next(joint for joint in machine.joints if isinstance(joint, Slideway))

    def changed(joint: Slideway) -> Slideway:
        exponent, preload = (
            replace(one, estimated=True) for one in (joint.exponent, joint.preload)
        )
        if unknown == 'preload':
            return replace(joint, preload=preload) if joint.name == 'slideway_8' else joint
        if unknown != 'single' and joint is not first:
            exponent = Coefficient(tie=Tie(f'{first.name}.exponent'))
        if unknown == 'both' and joint is not first:
            times = joint.preload.value / first.preload.value
            preload = Coefficient(tie=Tie(f'{first.name}.preload', times))
        if unknown == 'exponent':
            return replace(joint, exponent=exponent)
        return replace(joint, exponent=exponent, preload=preload)

    return replace(
        machine,
        joints=tuple(
            changed(joint) if isinstance(joint, Slideway) else joint for joint in machine.joints
        ),
    )


def case(unknown: str, amplitude: int) -> tuple[Model, Layout, Signal]:
    """
    Make machine, sensors and force.

    Parameters
    ----------
    unknown : str
        Of `UNKNOWNS`.
    amplitude : int
        [N].

    Returns
    -------
    Model
    Layout
    Signal

    """
    model, layout = shipped_knee_and_column()
    band = model.machine.excitations[0].band
    signal = multisine(amplitude, band, 0.5, np.random.default_rng(7))
    return assemble(with_unknown(model.machine, unknown)), layout, signal


@cache
def prepared(unknown: str, amplitude: int) -> tuple[Model, Layout, Reals, Reals]:
    """
    Simulate once.

    Parameters
    ----------
    unknown : str
        Of `UNKNOWNS`.
    amplitude : int
        [N].

    Returns
    -------
    Model
    Layout
    ndarray, shape (n_samples, n_channels)
        Clean readings.
    ndarray, shape (n_unknowns,)
        Cramer-Rao standard deviations.

    """
    model, layout, signal = case(unknown, amplitude)
    clean = clean_readings(model, layout, signal, DURATION)
    return model, layout, clean, cramer_rao(model, layout, signal, DURATION)


def inner(model: Model) -> NDArray[np.bool_]:
    """
    Tell which unknowns are preloads or exponents.

    Parameters
    ----------
    model : Model

    Returns
    -------
    ndarray of bool, shape (n_unknowns,)

    """
    return np.array([model.parameters[i].inner for i in model.estimated])


def one_run(task: tuple[Cell, int]) -> tuple[Estimate, float]:
    """
    Draw noise and start values, and estimate.

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
    model, layout, clean, _ = prepared(cell.unknown, cell.amplitude)
    key = (list(UNKNOWNS).index(cell.unknown), cell.amplitude, number)
    generator = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=key))
    samples = noisy(clean, layout, generator)
    truth = model.values[list(model.estimated)]
    start = truth * (1 + START_ERROR * generator.choice((-1, 1), len(truth)))
    unknown = model.with_unknowns(np.where(inner(model), start, np.nan))
    return identified(unknown, layout, samples, cell.estimator)


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
    model, _, _, bound = prepared(cell.unknown, cell.amplitude)
    results = list(mapping(one_run, zip(itertools.repeat(cell, runs), range(runs), strict=False)))
    return outcome_of(cell, model.values[list(model.estimated)], bound, results)


def determined() -> str:
    """
    Write the table of the bounds at every amplitude.

    Returns
    -------
    str
        Markdown.

    """
    lines = [
        '| unknown | ' + ' | '.join(f'{amplitude} N' for amplitude in AMPLITUDES) + ' |',
        '| --- ' * (1 + len(AMPLITUDES)) + '|',
    ]
    for unknown, words in UNKNOWNS.items():
        cells = ' | '.join(', '.join(_bounds(unknown, amplitude)) for amplitude in AMPLITUDES)
        lines.append(f'| {words} | {cells} |')
    return '\n'.join(lines)


def _bounds(unknown: str, amplitude: int) -> Iterator[str]:
    """Say how well exponents and preloads are determined, the worst of each."""
    model, layout, signal = case(unknown, amplitude)
    bound = cramer_rao(model, layout, signal, DURATION) / model.values[list(model.estimated)]
    names = [model.parameters[i].name.partition('.')[2] for i in model.estimated]
    for key, symbol in (('exponent', 'm'), ('preload', 'delta_0')):
        relative = [one for one, name in zip(bound, names, strict=True) if name == key]
        if relative:
            yield f'{symbol} {100 * max(relative):.2g} %'


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
        'estimator | force | unknown beside 16 coefficients',
        outcomes,
        lambda cell: f'{cell.estimator} | {cell.amplitude} N | {UNKNOWNS[cell.unknown]}',
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
    cell = outcome.cell
    title = f'{cell.estimator}, {cell.amplitude} N, {UNKNOWNS[cell.unknown]}'
    return parameter_table(title, outcome)


@click.command()
@click.option('--weak', default=200, show_default=True, help='Runs of the weak estimator.')
@click.option('--likelihood', default=60, show_default=True, help='Runs of the likelihood.')
@click.option('--processes', default=2, show_default=True)
def main(weak: int, likelihood: int, processes: int) -> None:
    """Study both estimators; tables go to studies/results/inner.md."""
    console = Console()
    outcomes: list[Outcome[Cell]] = []
    RESULTS.mkdir(exist_ok=True)
    bounds = determined()
    console.print(bounds, markup=False, soft_wrap=True)
    for estimator, runs in (('weak', weak), ('likelihood', likelihood)):
        with workers(processes, runs, console) as mapping:
            for amplitude, unknown in CELLS[estimator] if runs else ():
                outcomes.append(study(Cell(estimator, unknown, amplitude), runs, mapping))
                console.print(summary(outcomes).splitlines()[-1], markup=False, soft_wrap=True)
                (RESULTS / 'inner.md').write_text(_report(bounds, outcomes))


def _report(bounds: str, outcomes: list[Outcome[Cell]]) -> str:
    return (
        '# Unknown preloads and exponents\n\n'
        f'Knee and column, 10 nm and 0.01 m/s^2, multisine, {DURATION:g} s of data at 10 kHz; '
        f'searches start {100 * START_ERROR:g} % off, up or down at random. Written by '
        '`python studies/inner.py`.\n\n'
        "## Standard errors that Fisher's information allows, by amplitude of the force\n\n"
        'Of the exponent m and the preload delta_0, the worst of several.\n\n'
        f'{bounds}\n\n'
        '## Monte-Carlo runs\n\n'
        f'{summary(outcomes)}\n\n' + '\n\n'.join(details(one) for one in outcomes) + '\n'
    )


if __name__ == '__main__':
    main()
