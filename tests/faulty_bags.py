# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Bags of the knee and column in which something is wrong with a channel."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

CONFIG = Path(__file__).resolve().parents[1] / 'config'
RATE = 5000.0
DURATION = 1.2


@cache
def recorded() -> tuple[StandDescription, tuple[SampleBlock, ...], str]:
    """Simulate once."""
    machine = load_machine(CONFIG / 'knee_column.yaml')
    layout = load_layout(CONFIG / 'knee_column_layout.yaml')
    run = TestRun(Excitation.MULTISINE, DURATION, RATE, seed=3)
    source = SimulatedSource(machine.machine, layout.layout, run, machine.text, layout.text)
    return source.description, tuple(source.blocks()), machine.text


def write_faulty(
    path: Path,
    fault: Callable[[NDArray[np.float64], dict[str, int]], None],
    keep: Callable[[str], bool] = lambda _: True,
) -> Path:
    """
    Write a bag.

    Parameters
    ----------
    path : Path
    fault : callable
        Changes the samples, shape (n_samples, n_channels), given the columns by name.
    keep : callable
        Tells by its name whether the layout has a sensor.

    Returns
    -------
    Path

    """
    description, blocks, _ = recorded()
    columns = {sensor.name: i for i, sensor in enumerate(description.layout.sensors)}
    samples = np.concatenate([block.samples for block in blocks])
    fault(samples, columns)
    kept = [i for name, i in columns.items() if keep(name)]
    layout = description.layout
    layout = replace(layout, sensors=tuple(layout.sensors[i] for i in kept))
    with BagWriter(path) as bag:
        bag.write_description(replace(description, layout=layout))
        for block in blocks:
            part = samples[block.first_index : block.next_index, kept]
            status = block.channel_status[kept]
            bag.write_block(replace(block, samples=part, channel_status=status))
    return path


def inverted(samples: NDArray[np.float64], columns: dict[str, int]) -> None:
    """Turn the polarity of a probe."""
    samples[:, columns['knee_s1x']] *= -1


def stuck(samples: NDArray[np.float64], columns: dict[str, int]) -> None:
    """Hold the value of an accelerometer from the middle on."""
    column = columns['column_a2y']
    samples[3000:, column] = samples[3000, column]
