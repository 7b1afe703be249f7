# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Faults of channels that show in the motion of rigid bodies: what is found, what is not.

A record of every machine is simulated once, periodic and settled, and repeated; every trial draws
fresh noise, a channel and a fault, which begins after 3 to 5 s (gains: 7 to 9 s). A
trial counts as named if, 10.5 s later (drift: 32 s), the findings are exactly those of the fault;
as named with others if there are more, and each of these says that it may be the true one instead.
Gains that are not named by then have until 110 s after the begin. Seeds from 5000 on; those below
served the development. Limits are those of Clopper and Pearson, 95 %.

Sizes: gains 5 to 20 % off; the least gain is as far off as the software, from the 6 s before the
fault, says that it names alone in 99 % of the cases. The motion of the windows with the fault may
be another: rows tell apart whether these state less. Exchanged channels of a kind have readings
that differ by 20 %; hum at 50 or 60 +- 0.4 Hz has 1 to 5 times the noise of a sample more 5 % of
the motion within 4 Hz; drift is 3 to 10 times the noise of a sample in 30 s. Nothing should be
found in clean data (an hour of the first machine with the multisine, a minute of all others), in
quiet data (no motion; noise 0.7 to 3 times what is stated) and with inexact layouts (directions 1
degree, gains 1 %, times up to 25 us off).
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import get_context
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')

import click
from identnl_ros.core.measurement.complete_layout import complete_layout, TYPICAL_NOISE
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.consistency import Consistency
from identnl_ros.core.simulation.excitation import Impulses, multisine, Signal, sine, Sweep
from identnl_ros.core.simulation.stand import MOTION_KINDS, SimulatedStand
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
from identnl_ros.storage.shipped import shipped_config
from monte_carlo import RATE, Reals, RESULTS, SEED
import numpy as np
from rich.console import Console
from rich.progress import track
from scipy.stats import binomtest

PERIOD = 2.0  # s, of all excitations
SETTLING = 8.0  # s, after which 1e-8 of the start is left
BLOCK = 2000
MACHINES = ('knee_column', 'three_body', 'complete')
EXCITATIONS = ('multisine', 'sine', 'sweep', 'impulse')
FAULTS = ('inverted', 'two inverted', 'swapped', 'gain', 'hum', 'drift', 'least gain')
WITHOUT = ('clean', 'quiet', 'inexact')
ORDER = (*FAULTS, *WITHOUT)
LATEST = 10.5  # s after the fault begins; drift: 32 s
LATEST_GAIN = 110.0  # s, for those that are not named by then
WINDOW = 6.6  # s that the software judges together
FIRST_SEED = 5000
# Swapped channels differ by this share of the larger; gains are 5 to 20 % off either way.
LEAST_DIFFERENCE = 0.2
# Hum: 1 to 5 times the noise of a sample, more this share of the motion near its frequency.
LEAST_HUM = 0.05


@dataclass(frozen=True)
class Task:
    """
    One trial.

    Parameters
    ----------
    fault, machine, excitation : str
    seed : int
    duration : float
        Of a trial without fault [s].

    """

    fault: str
    machine: str
    excitation: str
    seed: int
    duration: float = 0.0


@dataclass(frozen=True)
class Result:
    """
    What a trial has shown.

    Parameters
    ----------
    task : Task
    expected, found : tuple of str
        Channel and condition.
    delay : float
        From the begin of the fault to the right findings [s]; NaN: never.
    named : bool
        Exactly these.
    with_others : bool
        These and others, of which it is said that these may be meant instead.
    size : float
        Of a gain: the factor less one.
    stated : float
        The least that the software states to name alone: before the fault; of the least gain the
        smallest in the windows with the fault.

    """

    task: Task
    expected: tuple[str, ...]
    found: tuple[str, ...]
    delay: float
    named: bool
    with_others: bool
    size: float
    stated: float


@cache
def prepared(machine: str, excitation: str) -> tuple[Model, Layout, Reals]:
    """
    Simulate one period of the settled motion, read by perfect sensors.

    Parameters
    ----------
    machine, excitation : str

    Returns
    -------
    Model
    Layout
    ndarray, shape (n_samples, n_channels)

    """
    name = 'knee_column' if machine == 'complete' else machine
    model = assemble(load_machine(shipped_config(f'{name}.yaml')).machine)
    layout = load_layout(shipped_config(f'{name}_layout.yaml')).layout
    if machine == 'complete':
        layout = complete_layout(model.machine)
    point = model.machine.excitations[0]
    generator = np.random.default_rng(7)
    signal: Signal = {
        'multisine': multisine(point.amplitude, point.band, PERIOD, generator),
        'sine': sine(point.amplitude, 40.0),
        'sweep': Sweep(point.amplitude, point.band, PERIOD),
        'impulse': Impulses(10 * point.amplitude, 2e-3, 1.0),
    }[excitation]
    signals = (signal,) * len(model.machine.excitations)
    stand = SimulatedStand(model, layout.with_noise_times(0.0), signals, RATE, 0, 1)
    stand.read(int(SETTLING * RATE))
    return model, layout, stand.read(int(PERIOD * RATE)).samples


def noise_of(layout: Layout) -> Reals:
    """
    Give the noise of a sample, the typical one where none is stated.

    Parameters
    ----------
    layout : Layout

    Returns
    -------
    ndarray, shape (n_channels,)

    """
    return np.array(
        [TYPICAL_NOISE[one.kind] if np.isnan(one.noise) else one.noise for one in layout.sensors]
    )


def inexact(model: Model, layout: Layout, clean: Reals, generator: np.random.Generator) -> Reals:
    """
    Give the readings of sensors 1 degree, 1 % and up to 25 us off.

    Parameters
    ----------
    model : Model
    layout : Layout
        As the user believes the sensors to be.
    clean : ndarray, shape (n_samples, n_channels)
        One period.
    generator : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n_samples, n_channels)

    """
    result = clean.copy()
    omega = 2 * np.pi * np.fft.rfftfreq(len(clean), 1 / RATE)
    for kind in MOTION_KINDS:
        channels = list(layout.of_kind(kind))
        sensors = tuple(layout.sensors[i] for i in channels)
        turned = tuple(
            replace(one, direction=one.direction + np.radians(1.0) * across(one.direction, draw))
            for one, draw in zip(sensors, generator.normal(size=(len(sensors), 3)), strict=True)
        )
        motion = clean[:, channels] @ np.linalg.pinv(sensor_matrix(model, sensors)).T
        result[:, channels] = motion @ sensor_matrix(model, turned).T
    result *= 1 + 0.01 * generator.normal(size=result.shape[1])
    late = generator.uniform(-25e-6, 25e-6, result.shape[1])
    spectra = np.fft.rfft(result, axis=0) * np.exp(-1j * np.outer(omega, late))
    return np.fft.irfft(spectra, len(clean), axis=0)


def across(direction: Reals, draw: Reals) -> Reals:
    """
    Make a unit vector at right angles.

    Parameters
    ----------
    direction, draw : ndarray, shape (3,)

    Returns
    -------
    ndarray, shape (3,)

    """
    left = draw - (draw @ direction) * direction
    return np.asarray(left / np.linalg.norm(left))


def fault_of(
    task: Task, layout: Layout, clean: Reals, checkable: Sequence[str],
    generator: np.random.Generator,
) -> tuple[Callable[[Reals, Reals], Reals], tuple[str, ...], float]:  # fmt: skip
    """
    Draw a fault.

    Parameters
    ----------
    task : Task
    layout : Layout
    clean : ndarray, shape (n_samples, n_channels)
    checkable : sequence of str
        Channels to choose from.
    generator : numpy.random.Generator

    Returns
    -------
    callable
        Readings and times since the fault began to faulty readings.
    tuple of str
        What should be said.
    float
        Of a gain: factor less one; else NaN.

    """
    names = [sensor.name for sensor in layout.sensors]
    one, other = (names.index(i) for i in generator.choice(checkable, 2, replace=False))
    noise = noise_of(layout)[one]
    factors = np.ones(len(names))
    if task.fault in ('inverted', 'two inverted'):
        wrong = [one, other][: 1 + (task.fault == 'two inverted')]
        factors[wrong] = -1
        return lambda y, t: y * factors, tuple(f'{names[i]} INVERTED' for i in wrong), np.nan
    if task.fault == 'gain':
        factors[one] = 1 + generator.uniform(0.05, 0.2) * generator.choice((-1, 1))
        return lambda y, t: y * factors, (f'{names[one]} GAIN',), float(factors[one] - 1)
    if task.fault == 'hum':
        frequency = generator.choice((50, 60)) + generator.uniform(-0.4, 0.4)
        near = motion_near(layout, clean, one, float(frequency))
        size = noise * generator.uniform(1, 5) + LEAST_HUM * near
        return (
            lambda y, t: added(y, one, size * np.sin(2 * np.pi * frequency * t)),
            (f'{names[one]} HUM',),
            np.nan,
        )
    if task.fault == 'drift':
        size = noise * generator.uniform(3, 10) * generator.choice((-1, 1))
        return lambda y, t: added(y, one, size * t / 30), (f'{names[one]} DRIFT',), np.nan
    moving = clean - clean.mean(axis=0)
    others = [
        i for i, sensor in enumerate(layout.sensors)
        if sensor.kind is layout.sensors[one].kind and i != one and names[i] in checkable
        and np.std(moving[:, i] - moving[:, one])
        > LEAST_DIFFERENCE * max(np.std(moving[:, i]), np.std(moving[:, one]))
    ]  # fmt: skip
    other = int(generator.choice(others))
    order = np.arange(len(names))
    order[[one, other]] = other, one
    said = f'{names[one]} SWAPPED', f'{names[other]} SWAPPED'
    return lambda y, t: y[:, order], said, np.nan


def motion_near(layout: Layout, clean: Reals, channel: int, frequency: float) -> float:
    """
    Find the largest amplitude of the sensors of a kind on a body, within 4 Hz of a frequency.

    Parameters
    ----------
    layout : Layout
    clean : ndarray, shape (n_samples, n_channels)
    channel : int
    frequency : float
        [Hz].

    Returns
    -------
    float
        [SI].

    """
    own = layout.sensors[channel]
    alike = [
        i for i, one in enumerate(layout.sensors)
        if (one.kind, one.body) == (own.kind, own.body)
    ]  # fmt: skip
    near = np.abs(np.fft.rfftfreq(len(clean), 1 / RATE) - frequency) < 4
    spectra = np.fft.rfft(clean[:, alike], axis=0)[near] * 2 / len(clean)
    return float(np.sqrt((np.abs(spectra) ** 2).sum(axis=0).max()))


def added(readings: Reals, channel: int, values: Reals) -> Reals:
    """
    Add to one channel.

    Parameters
    ----------
    readings : ndarray, shape (n_samples, n_channels)
    channel : int
    values : ndarray, shape (n_samples,)

    Returns
    -------
    ndarray, shape (n_samples, n_channels)

    """
    result = readings.copy()
    result[:, channel] += values
    return result


def run(task: Task) -> Result:
    """
    Let one record pass.

    Parameters
    ----------
    task : Task

    Returns
    -------
    Result

    """
    model, layout, clean = prepared(task.machine, task.excitation)
    cell = (
        ORDER.index(task.fault),
        MACHINES.index(task.machine),
        EXCITATIONS.index(task.excitation),
    )
    generator = np.random.default_rng([SEED, *cell, task.seed])
    watch = Consistency(model, layout, RATE)
    noise = noise_of(layout)
    begin, end, expected = task.duration, task.duration, ()
    size = stated = np.nan
    least = task.fault == 'least gain'
    if task.fault in FAULTS:
        table = watch.drift_checkable if task.fault == 'drift' else watch.checkable
        checkable = [name for name, others in table.items() if others]
        begin = generator.uniform(3, 5) + (4 if 'gain' in task.fault else 0)
        end = begin + (32 if task.fault == 'drift' else LATEST)
        if not least:
            change, expected, size = fault_of(task, layout, clean, checkable, generator)
    elif task.fault == 'inexact':
        clean = inexact(model, layout, clean, generator)
    elif task.fault == 'quiet':
        clean, noise = 0 * clean, noise * generator.uniform(0.7, 3)
    delay = np.nan
    every: set[str] = set()
    found: tuple[str, ...] = ()
    named = others = False
    index = 0
    while index < int(end * RATE):
        places = index + np.arange(BLOCK)
        readings = clean[places % len(clean)]
        time = places / RATE - begin
        if time[-1] > 0:
            if not expected and least:
                change, expected, size = least_gain(watch, layout, generator)
            if task.fault == 'gain' and np.isnan(stated):
                stated = watch.gain_limits[expected[0].split()[0]][1]
            faulty = change(readings, time)
            readings = np.where((time > 0)[:, np.newaxis], faulty, readings)
        drawn = generator.standard_normal(readings.shape, dtype=np.float32)
        watch.add(index, readings + noise * drawn)
        if least and time[0] > WINDOW:
            stated = np.fmin(stated, watch.gain_limits[expected[0].split()[0]][1])
        index += BLOCK
        standing = watch.findings()
        found = tuple(f'{one.channel} {Condition(one.condition).name}' for one in standing)
        every |= set(found)
        named = set(expected) == set(found)
        others = set(expected) < set(found) and all(
            key in expected or says_instead(one.sentence, expected)
            for key, one in zip(found, standing, strict=True)
        )
        if expected and np.isnan(delay) and (named or others):
            delay = time[-1]
        if task.fault == 'gain' and not named and index >= int(end * RATE):
            end = begin + LATEST_GAIN
        if task.fault == 'gain' and named and time[-1] > LATEST:
            break
    if not expected:
        found, named, others = tuple(sorted(every)), not every, False
    return Result(task, expected, found, delay, named, others, size, stated)


def says_instead(sentence: str, expected: Sequence[str]) -> bool:
    """
    Tell whether a finding says that a true fault may be meant instead.

    Parameters
    ----------
    sentence : str
    expected : sequence of str
        Channel and condition.

    Returns
    -------
    bool

    """
    _, _, instead = sentence.partition('or ')
    return any(one.split()[0] in instead for one in expected)


def least_gain(
    watch: Consistency, layout: Layout, generator: np.random.Generator
) -> tuple[Callable[[Reals, Reals], Reals], tuple[str, ...], float]:
    """
    Draw a gain that is as wrong as the software states to find.

    Parameters
    ----------
    watch : Consistency
        That has seen good data.
    layout : Layout
    generator : numpy.random.Generator

    Returns
    -------
    callable
        Readings and times since the fault began to faulty readings.
    tuple of str
        What should be said.
    float
        Factor less one.

    """
    limits = {name: one for name, (_, one) in watch.gain_limits.items() if np.isfinite(one)}
    name = str(generator.choice(list(limits)))
    size = limits[name] * generator.choice((-1, 1))
    factors = np.ones(len(layout.sensors))
    factors[[sensor.name for sensor in layout.sensors].index(name)] += size
    return lambda y, t: y * factors, (f'{name} GAIN',), float(size)


def table(results: Sequence[Result]) -> str:
    """
    Count.

    Parameters
    ----------
    results : sequence of Result

    Returns
    -------
    str

    """
    lines = [
        '| fault | machine | excitation | trials | named | named with others | missed | else | '
        'seconds to the finding: median, largest |',
        '| --- | --- | --- | --- | --- | --- | --- | --- | --- |',
    ]
    cells = sorted({(one.task.fault, one.task.machine, one.task.excitation) for one in results})
    for cell in cells:
        own = [
            one for one in results
            if (one.task.fault, one.task.machine, one.task.excitation) == cell
        ]  # fmt: skip
        delays = [one.delay for one in own if np.isfinite(one.delay)]
        times = f'{np.median(delays):.1f}, {max(delays):.1f}' if delays else ''
        lines.append(f'| {" | ".join(cell)} | {counts(own)} | {times} |')
    lines += [
        '',
        '| fault | trials | named | named with others | missed | else | named or named with '
        'others: share, limits | sizes: median, largest |',
        '| --- | --- | --- | --- | --- | --- | --- | --- |',
    ]
    rows = {
        fault: [one for one in results if one.task.fault == fault]
        for fault in dict.fromkeys(cell[0] for cell in cells)
    }
    for fault in ('gain', 'least gain'):
        gains = rows.get(fault, [])
        rows[f'{fault}, not less than stated'] = [
            one for one in gains if abs(one.size) >= one.stated
        ]
        rows[f'{fault}, less than stated'] = [one for one in gains if abs(one.size) < one.stated]
    for fault, own in rows.items():
        if not own:
            continue
        right = sum(one.named or one.with_others for one in own)
        interval = binomtest(right, len(own)).proportion_ci(0.95, 'exact')
        sizes = np.abs([one.size for one in own])
        drawn = '' if np.isnan(sizes).all() else (
            f'{100 * np.median(sizes):.1f} %, {100 * sizes.max():.1f} %'
        )  # fmt: skip
        lines.append(
            f'| {fault} | {counts(own)} | {100 * right / len(own):.1f} %, '
            f'{100 * interval.low:.1f} to {100 * interval.high:.1f} % | {drawn} |'
        )
    return '\n'.join(lines)


def counts(results: Sequence[Result]) -> str:
    """
    Count trials: all, named, named with others, missed, else.

    Parameters
    ----------
    results : sequence of Result

    Returns
    -------
    str
        Cells of a row.

    """
    named = sum(one.named for one in results)
    others = sum(one.with_others for one in results)
    missed = sum(not one.named and not one.found for one in results)
    rest = len(results) - named - others - missed
    return f'{len(results)} | {named} | {others} | {missed} | {rest}'


def tasks_of(faults: Sequence[str], runs: int, hours: float) -> list[Task]:
    """
    List the trials.

    Parameters
    ----------
    faults : sequence of str
    runs : int
        Of every fault with every machine and excitation; a quarter without fault.
    hours : float
        Of clean data of the reference machine with the multisine; the others have a sixtieth.

    Returns
    -------
    list of Task

    """
    tasks = []
    for fault in faults:
        for machine in MACHINES:
            for excitation in EXCITATIONS:
                if fault == 'quiet' and excitation != 'multisine':
                    continue
                duration = 60.0 if fault == 'quiet' else 20.0
                if fault == 'clean':
                    first = (machine, excitation) == (MACHINES[0], EXCITATIONS[0])
                    duration = hours * (3600 if first else 60)
                count = 1 if fault == 'clean' else runs if fault in FAULTS else runs // 4 + 1
                tasks += [
                    Task(fault, machine, excitation, FIRST_SEED + seed, duration)
                    for seed in range(count)
                ]
    return tasks


def report(results: Sequence[Result]) -> str:
    """
    Write what is kept: the tables, and every trial that was not named rightly.

    Parameters
    ----------
    results : sequence of Result

    Returns
    -------
    str
        Markdown.

    """
    text = ['# Consistency of channels', __doc__ or '', table(results)]
    misses = [
        f'* {one.task.fault}, {one.task.machine}, {one.task.excitation}, seed {one.task.seed}: '
        f'expected {", ".join(one.expected) or "nothing"}; '
        f'found {", ".join(one.found) or "nothing"}.'
        for one in results
        if not one.named and not one.with_others
    ]
    if misses:
        text += ['## What was not named rightly', '\n'.join(misses)]
    return '\n\n'.join(text) + '\n'


@click.command()
@click.option(
    '--fault', 'faults', multiple=True, type=click.Choice(ORDER),
    default=ORDER,
)  # fmt: skip
@click.option('--runs', type=click.IntRange(min=1), default=25, show_default=True)
@click.option('--hours', type=click.FloatRange(min=0.001), default=1.0, show_default=True)
@click.option('--processes', type=click.IntRange(min=1), default=2, show_default=True)
@click.option('--out', default='data_quality_consistency', show_default=True)
def command(faults: Sequence[str], runs: int, hours: float, processes: int, out: str) -> None:
    """Draw faults, let records pass, count."""
    console = Console(stderr=True)
    tasks = tasks_of(faults, runs, hours)
    for cell in {(one.machine, one.excitation) for one in tasks}:
        prepared(*cell)  # once, for all processes
    with ProcessPoolExecutor(processes, get_context('fork')) as pool:
        done = pool.map(run, tasks, chunksize=2)
        results = list(track(done, total=len(tasks), console=console, transient=True))
    (RESULTS / f'{out}.md').write_text(report(results))
    console.print(table(results))


if __name__ == '__main__':
    command()
