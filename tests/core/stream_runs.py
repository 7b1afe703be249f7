# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Closed-form readings of devices with clocks of their own, block by block."""

from dataclasses import dataclass, field

from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.synchronisation.stream_alignment import StreamAlignment, StreamSource
import numpy as np

from tests.core.machines import line_layout, oscillator

D, V, A, F = (
    SensorKind.DISPLACEMENT,
    SensorKind.VELOCITY,
    SensorKind.ACCELERATION,
    SensorKind.FORCE,
)
MODEL = assemble(oscillator())
LAYOUT = line_layout(kinds=(D, V, A), noise={D: 1e-8, V: 2e-6, A: 1e-2, F: 0.0})
NAMES = tuple(sensor.name for sensor in LAYOUT.sensors)
EPOCH_NS = 1_700_000_000_000_000_000
JITTER = 5e-4
FREQUENCIES = np.arange(5.0, 200.0, 5.0) + 0.1
_PHASES = np.random.default_rng(0).uniform(0, 2 * np.pi, len(FREQUENCIES))
ORDERS = {D: 0, V: 1, A: 2}


def motion(kind, time, amplitude=0.14):
    """Give readings of a sum of sines whose accelerations have one amplitude."""
    omega = 2 * np.pi * FREQUENCIES
    if kind is F:
        return np.sin(20 * time)
    result = np.zeros(len(time))
    for one, phase in zip(omega, _PHASES, strict=True):
        result += amplitude * one ** (ORDERS[kind] - 2) * np.sin(
            one * time + phase + ORDERS[kind] * np.pi / 2
        )  # fmt: skip
    return result


@dataclass
class Device:
    """A source whose sample n is taken at the host time that `clock` says."""

    name: str
    channels: tuple[int, ...]
    rate: float
    skew: float = 0.0
    offset: float = 0.0
    drift: float = 0.0  # growth of the skew [1/s]
    jitter: float = JITTER
    seed: int = 1
    noise: float = 1.0
    latency: float = 0.0
    amplitude: float = 0.14
    block: float = 0.01
    until: float = np.inf  # host time at which the motion ends [s]
    blocks: list = field(default_factory=list)

    @property
    def source(self):
        return StreamSource(self.name, tuple(NAMES[i] for i in self.channels), self.rate)

    def time(self, index):
        """Host time of samples [s]."""
        own = np.asarray(index, dtype=float) / self.rate
        return self.offset + own * (1 + self.skew) + self.drift * own**2 / 2

    def index_at(self, time):
        """Fractional index of a host time, the inverse of `time`."""
        own = (np.asarray(time) - self.offset) / (1 + self.skew)
        for _ in range(4):
            own = own - (self.time(own * self.rate) - time)
        return own * self.rate

    def record(self, duration, begin=0):
        """Make the blocks of some time."""
        generator = np.random.default_rng(self.seed)
        size = round(self.block * self.rate)
        for first in range(begin, begin + round(duration * self.rate), size):
            time = self.time(np.arange(first, first + size))
            samples = np.stack(
                [motion(LAYOUT.sensors[i].kind, time, self.amplitude) for i in self.channels],
                axis=1,
            )
            samples[time >= self.until] = 0.0
            noise = np.array([LAYOUT.sensors[i].noise for i in self.channels]) * self.noise
            samples += noise * generator.standard_normal(samples.shape)
            late = self.latency + generator.normal(0, self.jitter)
            stamp = EPOCH_NS + round((time[0] + late) * 1e9)
            self.blocks.append((first, stamp, samples))
        return self


def play(alignment, devices, order='time', seed=0, each=None):
    """Feed all blocks, by their stamps or interleaved at random; return what comes out."""
    events = [
        (stamp, number, first, samples)
        for number, device in enumerate(devices)
        for first, stamp, samples in device.blocks
    ]
    position = {number: 0 for number in range(len(devices))}
    late = np.random.default_rng(seed)
    if order == 'time':
        keys = [event[0] for event in events]
    else:  # each source in order, up to 0.3 s late
        keys = []
        last = dict.fromkeys(position, 0)
        for stamp, number, *_ in events:
            last[number] = max(last[number], stamp + int(late.uniform(0, 3e8)))
            keys.append(last[number])
    found = []
    for at in np.argsort(np.array(keys), kind='stable'):
        stamp, number, first, samples = events[at]
        alignment.add(number, first, stamp, samples)
        found.extend(alignment.take())
        if each:
            each(alignment)
    found.extend(alignment.end())
    return found


def joined(parts):
    """Put what came out in one table; rows that were skipped are NaN."""
    begin, end = parts[0].first_index, parts[-1].first_index + len(parts[-1].samples)
    table = np.full((end - begin, parts[0].samples.shape[1]), np.nan)
    for part in parts:
        table[part.first_index - begin : part.first_index - begin + len(part.samples)] = (
            part.samples
        )
    return table


def aligned(devices, rate=None, model=MODEL, order='time', **options):
    """Align what devices recorded."""
    alignment = StreamAlignment(
        LAYOUT, [one.source for one in devices], rate or devices[0].rate, model, **options
    )
    return alignment, play(alignment, devices, order)


def misalignments(devices, table, skipped=0):
    """
    Measure from what came out by how much the last channel is late, second by second [s].

    The first device passes unchanged; its samples say which time each row has.
    """
    first = devices[0]
    known = np.flatnonzero(np.isfinite(table[:, 0]))[0]
    wanted = table[known, list(first.channels)]
    (index,) = (
        begin + row
        for begin, _, samples in first.blocks
        for row in np.flatnonzero((samples == wanted).all(axis=1))
    )
    time = first.time(index - known + np.arange(len(table)))
    device = devices[-1]
    kind = LAYOUT.sensors[device.channels[-1]].kind
    step = 1e-5
    exact = motion(kind, time, device.amplitude)
    slope = (
        motion(kind, time + step, device.amplitude) - motion(kind, time - step, device.amplitude)
    ) / (2 * step)
    error = exact - table[:, device.channels[-1]]
    result = []
    for begin in range(skipped, len(table) - 1000, 2000):
        part = slice(begin, begin + 2000)
        valid = np.isfinite(error[part])
        if valid.sum() > 500:
            own = slope[part][valid]
            result.append(own @ error[part][valid] / (own @ own))
    return np.array(result)
