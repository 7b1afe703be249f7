# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Alignment of a stream of two sources with clocks of their own.

Displacement probes on one device, accelerometers on another whose clock differs by 40 ppm and
3 ms, stamps of both with 0.5 ms of jitter. Minutes of closed-form motion show how well the clock
is followed; short records of the shipped knee and column, how well damping is identified.
"""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')

import click
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.synchronisation.stream_alignment import (
    AlignedSamples,
    StreamAlignment,
    StreamSource,
)
from identnl_ros.sources.hiding import hidden
from monte_carlo import identified, RATE, Reals, RESULTS, SEED, shipped_knee_and_column
import numpy as np
from rich.console import Console

SKEW, OFFSET, JITTER = 40e-6, 3e-3, 5e-4
EPOCH_NS = 1_700_000_000_000_000_000
SLOW_RATE = 2e3  # of the minutes [Hz]
FREQUENCIES = np.arange(5.0, 300.0, 5.0) + 0.1
ORDERS = {SensorKind.DISPLACEMENT: 0, SensorKind.VELOCITY: 1, SensorKind.ACCELERATION: 2}
Block = tuple[int, int, int, Reals]


@dataclass(frozen=True)
class Case:
    """
    One experiment.

    Parameters
    ----------
    name : str
    duration : float
        [s].
    drift : float
        Growth of the skew [1/s].
    moving : float
        The motion ends after so long; stamps go on [s].

    """

    name: str
    duration: float
    drift: float = 0.0
    moving: float = np.inf


CASES = (
    Case('constant skew', 40.0),
    Case('skew that grows by 1 ppm a minute', 120.0, 1e-6 / 60),
    Case('motion for 20 s, then rest for 40 s', 60.0, 0.0, 20.0),
)


@cache
def column_alone() -> tuple[Model, Layout, Reals]:
    """Take the probes and accelerometers of one body, and a motion of it."""
    model, layout = shipped_knee_and_column()
    sensors = tuple(
        one for one in layout.sensors if one.body == 'column' and not one.reference_body
    )
    generator = np.random.default_rng(0)
    shape = (len(model.coordinates), len(FREQUENCIES))
    motion = generator.normal(size=shape) + 1j * generator.normal(size=shape)
    return model, replace(layout, sensors=sensors), motion * 0.05 / (2 * np.pi * FREQUENCIES) ** 2


def exact(layout: Layout, model: Model, channels: list[int], time: Reals, order: int = 0) -> Reals:
    """Read perfect sensors at any time, or a derivative of what they read."""
    omega = 2 * np.pi * FREQUENCIES
    motion = column_alone()[2]
    lines = np.stack(
        [
            (sensor_matrix(model, (layout.sensors[i],))[0] @ motion)
            * (1j * omega) ** (ORDERS[layout.sensors[i].kind] + order)
            for i in channels
        ]
    )
    return np.asarray((np.exp(1j * np.outer(time, omega)) @ lines.T).real)


def host_time(case: Case, index: Reals) -> Reals:
    """When the second device samples [s]."""
    own = index / SLOW_RATE
    return np.asarray(OFFSET + own * (1 + SKEW) + case.drift * own**2 / 2)


def minutes(task: tuple[Case, int]) -> tuple[Reals, Reals]:
    """
    Follow a clock.

    Parameters
    ----------
    task : tuple of (Case, int)
        The case and the number of the run.

    Returns
    -------
    errors, deviations : ndarray, shape (n_seconds,)
        Delay of the second source's readings after every second, and what was stated of it [s].

    """
    case, number = task
    model, layout, _ = column_alone()
    groups = [
        list(layout.of_kind(kind)) for kind in (SensorKind.DISPLACEMENT, SensorKind.ACCELERATION)
    ]
    names = [tuple(layout.sensors[i].name for i in group) for group in groups]
    sources = [
        StreamSource(name, own, SLOW_RATE)
        for name, own in zip(('probes', 'others'), names, strict=True)
    ]
    alignment = StreamAlignment(layout, sources, SLOW_RATE, model)
    generator = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(number,)))
    noise = np.array([sensor.noise for sensor in layout.sensors])
    size = 20
    errors, deviations = [], []
    for second in range(round(case.duration)):
        blocks: list[Block] = []
        for source, group in enumerate(groups):
            index = second * SLOW_RATE + np.arange(SLOW_RATE)
            time = host_time(case, index) if source else index / SLOW_RATE
            samples = exact(layout, model, group, time)
            # Both are without readings where the motion ends, which has no spectrum.
            samples[time > case.moving] = 0.0
            samples[np.abs(time - case.moving) < 0.05] = np.nan
            samples += noise[group] * generator.standard_normal(samples.shape)
            for begin in range(0, len(index), size):
                stamp = EPOCH_NS + round((time[begin] + generator.normal(0, JITTER)) * 1e9)
                part = samples[begin : begin + size]
                blocks.append((stamp, source, int(index[begin]), part))
        for _ in passed(alignment, sorted(blocks, key=lambda one: one[0])):
            pass
        if not np.isnan(alignment.places).any():
            errors.append(line_error(alignment, case))
            deviations.append(alignment.state[1].deviation)
    return np.array(errors), np.array(deviations)


def line_error(alignment: StreamAlignment, case: Case) -> float:
    """Tell by how much the newest readings of the second source are late [s]."""
    first, second = alignment.places
    return float(host_time(case, np.array(second)) - first / SLOW_RATE)


def passed(alignment: StreamAlignment, blocks: list[Block]) -> Iterator[AlignedSamples]:
    """Feed blocks in the order of their stamps."""
    for stamp, source, index, samples in blocks:
        alignment.add(source, index, stamp, samples)
        yield from alignment.take()


@dataclass(frozen=True)
class StandCase:
    """
    A stand whose stream is identified.

    Parameters
    ----------
    force_noise : float
        Of the force cell [N]; an exact one shows the least change of the noise.
    rate : float
        Of the second device [Hz]; the first one has that of the grid.
    hidden : str
        What the machine has and its description has not, as `hidden` takes it; empty: nothing.
    runs : int

    """

    force_noise: float
    rate: float = RATE
    hidden: str = ''
    runs: int = 40


# The noise of the shipped force cell, and none.
STAND_CASES = (
    StandCase(0.2),
    StandCase(0.0),
    StandCase(0.0, 25.6e3, runs=20),
    # 2 % of the mass, and 2 % of the exciter's force.
    *(
        StandCase(noise, hidden=what, runs=4)
        for what in ('added_mass:column:18 kg', 'coulomb_friction:slideway_8.axis_1:20 N')
        for noise in (0.2, 0.0)
    ),
)
BEGIN, DURATION = 0.5, 0.6  # [s]


@cache
def stand_readings(rate: float, what: str) -> tuple[Model, Layout, Reals, Reals]:
    """Read the simulated stand with both clocks."""
    model, layout = shipped_knee_and_column()
    point = model.machine.excitations[0]
    signal = multisine(point.amplitude, point.band, 0.5, np.random.default_rng(7))
    true = model
    if what:
        told = Description(model.machine, layout)
        effect = hidden(what, told, (signal,), RATE, np.random.default_rng(0))
        true = assemble(effect.truth(told).machine)
    quiet = layout.with_noise_times(0)
    readings = []
    for own in (RATE, rate / (1 + SKEW)):
        begin, count = round(BEGIN * own), round(DURATION * own)
        reading = SimulatedStand(true, quiet, (signal,), own, 0, 1).read(begin + count)
        readings.append(reading.samples[begin:])
    return model, layout, readings[0], readings[1]


def stand(task: tuple[StandCase, int]) -> tuple[Reals, Reals, bool]:
    """
    Identify from an aligned stream.

    Parameters
    ----------
    task : tuple of (StandCase, int)
        And the number of the run.

    Returns
    -------
    scores : ndarray, shape (n_unknowns,)
        Errors over standard deviations.
    damping : ndarray of bool, shape (n_unknowns,)
    doubted : bool

    """
    case, number = task
    model, layout, *readings = stand_readings(case.rate, case.hidden)
    sensors = tuple(
        replace(one, noise=case.force_noise) if one.kind is SensorKind.FORCE else one
        for one in layout.sensors
    )
    layout = replace(layout, sensors=sensors)
    generator = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(1, number)))
    noise = np.array([sensor.noise for sensor in layout.sensors])
    probes = list(layout.of_kind(SensorKind.DISPLACEMENT))
    groups = [probes, [i for i in range(len(layout.sensors)) if i not in probes]]
    rates = (RATE, case.rate)
    sources = [
        StreamSource(name, tuple(layout.sensors[i].name for i in own), rate)
        for name, own, rate in zip(('probes', 'others'), groups, rates, strict=True)
    ]
    alignment = StreamAlignment(layout, sources, RATE, model, settling=0.5)
    blocks: list[Block] = []
    for source, group in enumerate(groups):
        own = readings[source]
        own = own + noise * generator.standard_normal(own.shape)
        for begin in range(0, len(own), 100):
            first = round(BEGIN * rates[source] / (1 + SKEW * source)) + begin
            time = first / rates[source] * (1 + SKEW * source) + generator.normal(0, JITTER)
            part = own[begin : begin + 100, group]
            blocks.append((EPOCH_NS + round(time * 1e9), source, begin, part))
    parts = [*passed(alignment, sorted(blocks, key=lambda one: one[0])), *alignment.end()]
    samples = np.concatenate([one.samples for one in parts])
    valid = np.flatnonzero(np.isfinite(samples).all(axis=1))
    unknown = model.with_unknowns(np.full(len(model.estimated), np.nan))
    estimate, _ = identified(unknown, alignment.layout, samples[valid[0] : valid[-1] + 1], 'weak')
    values = np.array([one.value for one in estimate.parameters])
    deviations = np.array([one.standard_deviation for one in estimate.parameters])
    names = [one.name for one in estimate.parameters]
    doubted = any(one.status is EstimateStatus.MODEL_IN_DOUBT for one in estimate.parameters)
    scores = (values - model.values[list(model.estimated)]) / deviations
    return scores, np.array(['damping' in name for name in names]), doubted


def row_of(case: Case, runs: int, pool: ProcessPoolExecutor) -> str:
    """Carry out a case and write its row."""
    found = list(pool.map(minutes, [(case, number) for number in range(runs)]))
    errors = np.array([one[0] for one in found])
    deviations = np.array([one[1] for one in found])
    inside = np.mean(np.abs(errors) <= 1.96 * deviations)
    moving = errors[:, : int(min(case.moving, case.duration)) - 4]
    return (
        f'| {case.name} | {runs} x {case.duration:g} s | '
        f'{1e6 * np.sqrt(np.mean(moving**2)):.3f} | {1e6 * np.abs(moving).max():.3f} | '
        f'{1e6 * np.sqrt(np.mean(errors[:, -1] ** 2)):.3f} | '
        f'{1e6 * np.median(deviations[:, -1]):.3f} | {inside:.1%} |'
    )


def stand_row_of(case: StandCase, results: list[tuple[Reals, Reals, bool]]) -> str:
    """Write what the identifications have shown."""
    inside = np.abs(np.array([one[0] for one in results])) <= 1.96
    damping = inside[:, results[0][1].astype(bool)]
    held = [f'{one.mean():.1%} of {one.size}' for one in (damping, inside)]
    return (
        f'| {case.force_noise:g} N | {case.rate / 1e3:g} kHz | {case.hidden or "nothing"} | '
        f'{" | ".join(["", ""] if case.hidden else held)} | '
        f'{sum(one[2] for one in results)} of {len(results)} |'
    )


@click.command()
@click.option('--runs', default=20, show_default=True)
@click.option('--processes', default=2, show_default=True)
def main(runs: int, processes: int) -> None:
    """Study the alignment of streams; the table goes to studies/results."""
    console = Console()
    rows: list[str] = []
    stand_rows: list[str] = []
    with ProcessPoolExecutor(processes) as pool:
        for case in CASES:
            rows.append(row_of(case, runs, pool))
            console.print(rows[-1], markup=False, soft_wrap=True)
        for each in STAND_CASES:
            results = list(pool.map(stand, [(each, number) for number in range(each.runs)]))
            stand_rows.append(stand_row_of(each, results))
            console.print(stand_rows[-1], markup=False, soft_wrap=True)
    text = (
        '# Alignment of streams\n\n'
        'Two sources, 40 ppm and 3 ms apart, stamps with 0.5 ms of jitter; written by '
        '`python studies/stream_alignment.py`. Misalignment in us: while there is motion, from '
        '2 s on, root mean square and largest; in the last second, root mean square and stated '
        'standard deviation; how often 1.96 stated standard deviations hold the error.\n\n'
        '| case | runs | RMS | largest | at the end | stated | held |\n'
        '| --- | --- | --- | --- | --- | --- | --- |\n' + '\n'.join(rows) + '\n\n'
        'Weak identification of the aligned stream, knee and column, 0.6 s on a grid of 10 kHz: '
        'how often 95 % intervals hold the truth, and how often the model is doubted. By noise '
        'of the force cell, rate of the second device (accelerometers and force), and what the '
        'machine has that its description has not.\n\n'
        '| force | second device | hidden | damping held | all held | in doubt |\n'
        '| --- | --- | --- | --- | --- | --- |\n' + '\n'.join(stand_rows) + '\n'
    )
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / 'stream_alignment.md').write_text(text)


if __name__ == '__main__':
    main()
