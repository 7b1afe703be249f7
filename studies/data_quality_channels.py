# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Faults that a channel shows by itself: how often they are found, and what is found without any.

Every injection puts one fault of the stated size at a random place into a simulated record of
the shipped knee and column, all channels, with fresh sensor noise; six channels of a record get
one each, unless it concerns all. It counts as found if the
monitor names condition and channel; anything it says of other channels, or of another condition,
counts as false. Clean data are an hour of steady motion, of which one period is simulated and
repeated with fresh noise, and a quarter of an hour of blows of random size.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')

import click
from identnl_ros.core.measurement.blocks import ChannelStatus, SampleBlock
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.quality.condition import Condition, Finding
from identnl_ros.core.quality.mark import ALL_CHANNELS
from identnl_ros.core.quality.monitor import monitored, QualityMonitor
from identnl_ros.core.simulation.excitation import Impulses, multisine, Signal, sine, Sweep
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
from identnl_ros.storage.shipped import shipped_config
from monte_carlo import RATE, Reals, RESULTS, SEED, workers
import numpy as np
from rich.console import Console
from scipy.signal.windows import tukey

BLOCK = 100
SECONDS = 3
EXCITATIONS = ('multisine', 'sine', 'sweep', 'impulse')
# Converter steps, in standard deviations of the noise.
LAYOUTS = {'fine': 0.0, 'steps': 1.0}
PERIOD = 0.5  # [s]
# Channels of a record that get a fault of their own.
AT_ONCE = 6
# Spikes are put where polynomials leave at most this of the motion, over the noise: away from
# kinks (contact, blows), which would hide them.
SMOOTH = 1.6

Injection = Callable[['Record', int, np.random.Generator], None]


@dataclass
class Record:
    """
    A record that faults are put into.

    Parameters
    ----------
    samples : ndarray, shape (n_samples, n_channels)
    layout : Layout
    lost : set of int
        Numbers of the blocks that do not arrive.
    saturated : set of (int, int)
        Blocks and channels that the source calls saturated.

    """

    samples: Reals
    layout: Layout
    lost: set[int]
    saturated: set[tuple[int, int]]

    def blocks(self) -> list[SampleBlock]:
        """Cut into blocks."""
        count = len(self.samples) // BLOCK
        blocks = []
        for number in range(count):
            samples = self.samples[number * BLOCK : (number + 1) * BLOCK]
            status = np.isnan(samples).any(axis=0).astype(np.uint8)
            for channel in range(samples.shape[1]):
                if (number, channel) in self.saturated:
                    status[channel] |= ChannelStatus.SATURATED
            if number not in self.lost:
                index = number * BLOCK
                stamp = round(index / RATE * 1e9)
                last = number == count - 1
                blocks.append(SampleBlock(1, stamp, index, RATE, samples, status, last))
        return blocks


@cache
def shipped() -> tuple[Layout, dict[str, Reals]]:
    """
    Simulate what perfect sensors read under every excitation.

    Returns
    -------
    Layout
    dict from str to ndarray, shape (n_samples, n_channels)

    """
    model = assemble(load_machine(shipped_config('knee_column.yaml')).machine)
    layout = load_layout(shipped_config('knee_column_layout.yaml')).layout
    point = model.machine.excitations[0]
    signals: dict[str, Signal] = {
        'multisine': multisine(point.amplitude, point.band, PERIOD, np.random.default_rng(7)),
        'sine': sine(point.amplitude, point.frequency),
        'sweep': Sweep(point.amplitude, point.band, 1.0),
        'impulse': Impulses(5 * point.amplitude, 5e-4, 0.25),
    }
    readings = {}
    for name, signal in signals.items():
        stand = SimulatedStand(model, layout.with_noise_times(0), (signal,), RATE, 0, 1)
        readings[name] = stand.read(round(SECONDS * RATE)).samples
    return layout, readings


def noises(layout: Layout) -> Reals:
    """List the standard deviations of the sensors."""
    return np.array([sensor.noise for sensor in layout.sensors])


def fresh(excitation: str, kind: str, generator: np.random.Generator) -> Record:
    """
    Draw a record without fault.

    Parameters
    ----------
    excitation : str
    kind : str
        Of `LAYOUTS`.
    generator : numpy.random.Generator

    Returns
    -------
    Record

    """
    layout, readings = shipped()
    noise = noises(layout)
    samples = readings[excitation]
    samples = samples + noise * generator.standard_normal(samples.shape)
    steps = LAYOUTS[kind] * noise
    if steps.any():
        samples = steps * np.round(samples / steps)
        sensors = tuple(
            replace(sensor, resolution=float(step))
            for sensor, step in zip(layout.sensors, steps, strict=True)
        )
        layout = replace(layout, sensors=sensors)
    return Record(samples, layout, set(), set())


def _place(record: Record, generator: np.random.Generator, length: int) -> int:
    return int(generator.integers(2000, len(record.samples) - 2000 - length))


def _gap(record: Record, channel: int, generator: np.random.Generator) -> None:
    record.lost.add(_place(record, generator, BLOCK) // BLOCK)


def _block_again(record: Record, channel: int, generator: np.random.Generator) -> None:
    begin = _place(record, generator, BLOCK) // BLOCK * BLOCK
    back = BLOCK * int(generator.integers(1, 16))
    record.samples[begin : begin + BLOCK] = record.samples[begin - back : begin - back + BLOCK]


def _row_held(record: Record, channel: int, generator: np.random.Generator) -> None:
    begin = _place(record, generator, 1)
    record.samples[begin] = record.samples[begin - 1]


def _missing(record: Record, channel: int, generator: np.random.Generator) -> None:
    record.samples[_place(record, generator, 1), channel] = generator.choice([np.nan, np.inf])


def _with(record: Record, channel: int, **changes: float) -> None:
    sensors = list(record.layout.sensors)
    sensors[channel] = replace(sensors[channel], **changes)
    record.layout = replace(record.layout, sensors=tuple(sensors))


def _clip(record: Record, channel: int) -> float:
    """Cut the highest tenth of the range off, at least ten standard deviations."""
    values = record.samples[:, channel]
    noise = record.layout.sensors[channel].noise
    level = min(0.9 * np.abs(values).max(), np.abs(values).max() - 10 * noise)
    np.clip(values, -level, level, out=values)
    return float(level)


def _full_scale(record: Record, channel: int, generator: np.random.Generator) -> None:
    level = _clip(record, channel)
    _with(record, channel, full_scale=abs(level * record.layout.sensors[channel].gain))


def _clipped(record: Record, channel: int, generator: np.random.Generator) -> None:
    _clip(record, channel)


def _source_says(record: Record, channel: int, generator: np.random.Generator) -> None:
    record.saturated.add((_place(record, generator, BLOCK) // BLOCK, channel))


def _stuck(length: int) -> Injection:
    def inject(record: Record, channel: int, generator: np.random.Generator) -> None:
        begin = _place(record, generator, length)
        record.samples[begin : begin + length, channel] = record.samples[begin, channel]

    return inject


def _rest_of_motion(values: Reals, index: int) -> float:
    """Most that polynomials through 33 samples leave, around a sample and before it."""
    place = np.linspace(-1, 1, 33)
    parts = [values[begin : begin + 33] for begin in index - 16 - 33 * np.arange(8)]
    fits = [np.polynomial.Polynomial.fit(place, part, 11, domain=[-1, 1]) for part in parts]
    residuals = [part - fit(place) for part, fit in zip(parts, fits, strict=True)]
    return float(np.sqrt(np.square(residuals).sum(axis=1).max() / (33 - 12)))


def _spike(shape: tuple[float, ...]) -> Injection:
    def inject(record: Record, channel: int, generator: np.random.Generator) -> None:
        sensor = record.layout.sensors[channel]
        noise = float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12)))
        begin = _place(record, generator, len(shape))
        while _rest_of_motion(record.samples[:, channel], begin) > SMOOTH * noise:
            begin = _place(record, generator, len(shape))
        size = noise * generator.choice([-1, 1]) * np.array(shape)
        if sensor.resolution:
            size = sensor.resolution * np.round(size / sensor.resolution)
        record.samples[begin : begin + len(shape), channel] += size

    return inject


def _noise(factor: float) -> Injection:
    def inject(record: Record, channel: int, generator: np.random.Generator) -> None:
        # What was added is as stated; state something else.
        _with(record, channel, noise=record.layout.sensors[channel].noise / factor)

    return inject


def _line(record: Record, channel: int, generator: np.random.Generator) -> None:
    sensor = record.layout.sensors[channel]
    frequency, phase = generator.uniform(0.405, 0.485), generator.uniform(0, 2 * np.pi)
    wave = np.sin(2 * np.pi * frequency * np.arange(len(record.samples)) + phase)
    record.samples[:, channel] += 2 * sensor.noise * wave
    if sensor.resolution:
        values = record.samples[:, channel]
        record.samples[:, channel] = sensor.resolution * np.round(values / sensor.resolution)


def _silent(record: Record, channel: int, generator: np.random.Generator) -> None:
    begin = _place(record, generator, 1500)
    record.samples[begin : begin + 1500, channel] = np.nan


@dataclass(frozen=True)
class Fault:
    """
    A fault of stated size.

    Parameters
    ----------
    size : str
        In words.
    condition : Condition
        That is to be named.
    inject : callable
        Puts it into a record.
    everywhere : bool
        Of all channels, not of one.
    also : Condition
        What may be said of the same channel besides.
    layouts, excitations : tuple of str
        Where it is tried.

    """

    size: str
    condition: Condition
    inject: Injection
    everywhere: bool = False
    also: Condition = Condition.OK
    layouts: tuple[str, ...] = tuple(LAYOUTS)
    excitations: tuple[str, ...] = EXCITATIONS


FAULTS = {
    'gap': Fault('a block of 100 samples lost', Condition.GAP, _gap, True),
    'block again': Fault(
        'a block of 100 samples read again', Condition.REPEAT, _block_again, True
    ),
    'row held': Fault('one row of samples twice', Condition.REPEAT, _row_held, True),
    'missing': Fault('one sample NaN or infinite', Condition.MISSING, _missing),
    'full scale': Fault(
        'a tenth of the range cut off, full scale stated', Condition.SATURATED, _full_scale
    ),
    'clipped': Fault(
        'a tenth of the range cut off, at least 10 sigma; full scale not stated; fine steps',
        Condition.SATURATED,
        _clipped,
        layouts=('fine',),
        excitations=('multisine', 'sine', 'sweep'),
    ),
    'source says saturated': Fault('one block', Condition.SATURATED, _source_says),
    'stuck, fine steps': Fault('12 samples', Condition.STUCK, _stuck(12), layouts=('fine',)),
    'stuck, steps of sigma': Fault('40 samples', Condition.STUCK, _stuck(40), layouts=('steps',)),
    'spike, one sample': Fault('18 sigma', Condition.SPIKE, _spike((18,))),
    'spike, two samples': Fault('20 sigma, same sign', Condition.SPIKE, _spike((20, 20))),
    'spike, two samples, +-': Fault('15 sigma, +-', Condition.SPIKE, _spike((15, -15))),
    'spike, three samples': Fault('50 sigma, same sign', Condition.SPIKE, _spike((50, 50, 50))),
    'more noise': Fault(
        '3 times what is stated; fine steps', Condition.NOISE, _noise(3), layouts=('fine',)
    ),
    'less noise': Fault('a third of what is stated', Condition.NOISE, _noise(1 / 3)),
    'line': Fault(
        '2 sigma amplitude, 0.405 to 0.485 of the sample rate', Condition.ALIASING, _line
    ),
    'silent': Fault(
        'no number for 0.15 s', Condition.LOST, _silent, also=Condition.MISSING
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Result:
    """
    What came of a record.

    Parameters
    ----------
    faults : int
        Injected.
    missed : tuple of str
        Channels whose fault was not found.
    false : tuple of str
        Sentences about other channels or conditions.
    where : str

    """

    faults: int
    missed: tuple[str, ...]
    false: tuple[str, ...]
    where: str


def findings_of(record: Record) -> tuple[Finding, ...]:
    """
    Process a record.

    Parameters
    ----------
    record : Record

    Returns
    -------
    tuple of Finding

    """
    monitor = QualityMonitor(record.layout, RATE)
    for _ in monitored(record.blocks(), monitor):
        pass
    return monitor.summary().findings


def injected(task: tuple[str, int]) -> Result:
    """
    Inject a fault, into several channels at different places, and look for it.

    Parameters
    ----------
    task : tuple of (str, int)
        Name of the fault, number of the record.

    Returns
    -------
    Result

    """
    name, number = task
    fault = FAULTS[name]
    key = (list(FAULTS).index(name), number)
    generator = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=key))
    excitation = fault.excitations[number % len(fault.excitations)]
    kind = fault.layouts[number // len(fault.excitations) % len(fault.layouts)]
    record = fresh(excitation, kind, generator)
    count = 1 if fault.everywhere else AT_ONCE
    channels = generator.choice(len(record.layout.sensors), count, replace=False)
    for channel in channels.tolist():
        fault.inject(record, channel, generator)
    names = [record.layout.sensors[channel].name for channel in channels]
    expected = [ALL_CHANNELS] if fault.everywhere else names
    findings = findings_of(record)
    false = tuple(
        one.sentence
        for one in findings
        if one.channel not in expected or not one.condition & (fault.condition | fault.also)
    )
    right = {one.channel for one in findings if one.condition is fault.condition}
    missed = tuple(one for one in expected if one not in right)
    return Result(len(expected), missed, false, f'{name} {number}: {excitation}, {kind}')


def clean(kind: str, seconds: float, console: Console | None = None) -> list[str]:
    """
    Look for faults where there are none.

    Parameters
    ----------
    kind : str
        ``motion`` or ``blows``.
    seconds : float
        Of data.
    console : Console or None
        For progress.

    Returns
    -------
    list of str
        Sentences of what was found.

    """
    layout, readings = shipped()
    generator = np.random.default_rng(SEED)
    count = round(PERIOD * RATE)
    if kind == 'motion':
        period = readings['multisine'][-count:]
    else:
        # From 0.1 s before one blow to 0.1 s before the next but one. The ends fade, so that
        # readings are continuous where periods of different size meet.
        begin = len(readings['impulse']) - count - round(0.1 * RATE)
        period = readings['impulse'][begin : begin + count] * tukey(count, 0.1)[:, np.newaxis]
    noise = noises(layout)
    monitor = QualityMonitor(layout, RATE)
    status = np.zeros(len(layout.sensors), dtype=np.uint8)
    said = []
    for number in range(round(seconds / PERIOD)):
        # Blows from a thousandth of the full force to all of it; each fades before the next.
        size = 1.0 if kind == 'motion' else 10 ** generator.uniform(-3, 0)
        samples = size * period + noise * generator.standard_normal(period.shape)
        for begin in range(0, count, BLOCK):
            index = number * count + begin
            stamp = round(index / RATE * 1e9)
            block = SampleBlock(1, stamp, index, RATE, samples[begin : begin + BLOCK], status)
            monitor.add(block)
            said += [one.sentence for quality in monitor.quality for one in quality.findings]
        if console and number % 600 == 599:
            console.print(f'{kind}: {(number + 1) * PERIOD:g} s, {len(said)} findings')
    return said


def table(results: dict[str, list[Result]]) -> str:
    """
    Write the detection rates.

    Parameters
    ----------
    results : dict from str to list of Result

    Returns
    -------
    str
        Markdown.

    """
    lines = [
        '| fault | size | condition | injections | found | records with false findings |',
        '| --- | --- | --- | ---: | ---: | ---: |',
    ]
    for name, found in results.items():
        fault = FAULTS[name]
        faults = sum(one.faults for one in found)
        share = 1 - sum(len(one.missed) for one in found) / faults
        false = sum(bool(one.false) for one in found)
        lines.append(
            f'| {name} | {fault.size} | {fault.condition.name} | {faults} | '
            f'{100 * share:.1f} % | {false} of {len(found)} |'
        )
    return '\n'.join(lines)


@click.command()
@click.option('--runs', default=504, show_default=True, help='Injections of every fault.')
@click.option('--fault', 'names', multiple=True, type=click.Choice(list(FAULTS)))
@click.option('--motion', default=3600.0, show_default=True, help='Clean steady motion [s].')
@click.option('--blows', default=900.0, show_default=True, help='Clean blows [s].')
@click.option('--processes', default=2, show_default=True)
def main(runs: int, names: tuple[str, ...], motion: float, blows: float, processes: int) -> None:
    """Study the faults of single channels; the table goes to studies/results."""
    console = Console()
    RESULTS.mkdir(exist_ok=True)
    results: dict[str, list[Result]] = {}
    shipped()
    path = RESULTS / 'data_quality_channels.md'
    head = (
        '# Faults that a channel shows by itself\n\nKnee and column, all 58 channels at 10 kHz; '
        'multisine, sine, sweep and blows of 0.5 ms in turn; converter without steps and with '
        "steps of the noise's standard deviation (sigma); spikes away from kinks of the motion; "
        'written by '
        '`python studies/data_quality_channels.py`.\n\n'
    )
    with workers(processes, runs, console) as mapping:
        for name in names or FAULTS:
            records = runs if FAULTS[name].everywhere else -(-runs // AT_ONCE)
            tasks = [(name, number) for number in range(records)]
            results[name] = list(mapping(injected, tasks))
            console.print(table(results).splitlines()[-1], markup=False, soft_wrap=True)
            for one in [one for one in results[name] if one.missed or one.false][:6]:
                console.print('   ', one.where, one.missed, one.false, markup=False)
            path.write_text(f'{head}{table(results)}\n')
    lines = []
    for kind, seconds in (('motion', motion), ('blows', blows)):
        if seconds:
            said = clean(kind, seconds, console)
            lines.append(f'- {kind}: {seconds:g} s, {len(said)} findings')
            lines += [f'  - {sentence}' for sentence in said[:20]]
    path.write_text(
        f'{head}{table(results)}\n\nClean data (one period repeated with fresh noise; blows of '
        f'random size):\n\n' + '\n'.join(lines) + '\n'
    )


if __name__ == '__main__':
    main()
