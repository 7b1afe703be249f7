# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Bags of an oscillator with a force cell and a few probes, in which something is wrong."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.layout_file import read_layout
from identnl_ros.storage.machine_file import read_machine
import numpy as np
from numpy.typing import NDArray

MACHINE = """
machine: oscillator
bodies:
  table: {mass: 50 kg, centre_of_mass: [0, 0, 0], degrees_of_freedom: [translation_1]}
joints:
  spring:
    kind: six_spring
    body: table
    to: ground
    point: [0, 0, 0]
    stiffness: [{estimate: 1e7 N/m}]
    damping: [{estimate: 1e3 N*s/m}]
excitations:
  shaker:
    body: table
    point: [0, 0, 0]
    direction: +x
    amplitude: 50 N
    frequency: 60 Hz
    band: [10 Hz, 300 Hz]
"""
FREE = MACHINE.replace('mass: 50 kg', 'mass: {estimate: 50 kg}')
NOISES = {'displacement': '10 nm', 'acceleration': '0.01 m/s^2'}
RATE = 5000.0


def layout(*probes: str) -> str:
    """Lay out sensors: d1, d2, ... of displacement, a1, a2, ... of acceleration."""
    lines = ['stand: oscillator', 'sensors:']
    lines.append('  force: {kind: force, excitation: shaker, noise: 0.02 N}')
    for name in probes:
        kind = 'displacement' if name.startswith('d') else 'acceleration'
        lines.append(
            f'  {name}: {{kind: {kind}, body: table, point: [0, 0, 0], direction: +x, '
            f'noise: {NOISES[kind]}}}'
        )
    return '\n'.join(lines) + '\n'


def write_oscillator(
    path: Path,
    fault: Callable[[NDArray[np.float64], dict[str, int]], None] = lambda *_: None,
    machine: str = MACHINE,
    probes: tuple[str, ...] = ('d1', 'a1'),
    duration: float = 2.0,
    rate: float = RATE,
) -> Path:
    """
    Write a bag.

    Parameters
    ----------
    path : Path
    fault : callable
        Changes the samples, shape (n_samples, n_channels), given the columns by name.
    machine : str
        Text of a machine file.
    probes : tuple of str
        See `layout`.
    duration : float
        [s].
    rate : float
        Sample rate that the bag states; the samples are those at `RATE` [Hz].

    Returns
    -------
    Path

    """
    text = layout(*probes)
    sensors = read_layout(text, 'layout')
    run = TestRun(Excitation.MULTISINE, duration, RATE, seed=3)
    source = SimulatedSource(read_machine(machine, 'machine'), sensors, run, machine, text)
    blocks = tuple(source.blocks())
    samples = np.concatenate([block.samples for block in blocks])
    fault(samples, {sensor.name: i for i, sensor in enumerate(sensors.sensors)})
    with BagWriter(path) as bag:
        bag.write_description(replace(source.description, sample_rate=rate))
        for block in blocks:
            part = samples[block.first_index : block.next_index]
            stamp_ns = round(block.first_index / rate * 1e9)
            stated = replace(block, samples=part, sample_rate=rate, stamp_ns=stamp_ns)
            bag.write_block(stated)
    return path


def gains(**factors: float) -> Callable[[NDArray[np.float64], dict[str, int]], None]:
    """Multiply the readings of some sensors."""

    def fault(samples: NDArray[np.float64], columns: dict[str, int]) -> None:
        for name, factor in factors.items():
            samples[:, columns[name]] *= factor

    return fault
