# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whether a machine file, a layout file or a bag is sound, and what it holds."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from identnl_ros.core.errors import IdentnlError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.mechanics.modes import modes
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine, read_machine
import numpy as np
from numpy.typing import NDArray

HARMLESS_SHARE = 0.01  # samples without reading, of all


@dataclass
class Findings:
    """
    What a check found.

    Parameters
    ----------
    path : Path
    kind : str
        machine, layout or bag.
    facts : dict
        What the file holds, ready for JSON.
    problems : list of str
        In sentences; empty: sound.
    remarks : list of str
        What is not as it should be, but too little to matter.

    """

    path: Path
    kind: str
    facts: dict[str, Any] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Nothing is wrong."""
        return not self.problems


def check_machine(path: Path) -> Findings:
    """
    Check a machine file: can it be read, does it stand, how does it vibrate.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Findings

    """
    findings = Findings(path, 'machine')
    try:
        machine = load_machine(path).machine
        model = assemble(machine)
    except IdentnlError as error:
        findings.problems.append(str(error))
        return findings
    findings.facts = {
        'machine': machine.name,
        'bodies': [body.name for body in machine.bodies],
        'coordinates': list(model.coordinate_names),
        'joints': [joint.name for joint in machine.joints],
        'unknowns': [model.parameters[i].name for i in model.estimated],
        'excitations': [point.name for point in machine.excitations],
    }
    if not model.estimated:
        findings.problems.append('no parameter is marked "estimate": nothing to identify')
    if np.isnan(model.values).any():
        findings.facts['simulation'] = 'not possible: some numbers have no value'
        return findings
    try:
        rest = static_equilibrium(model)
    except IdentnlError as error:
        findings.problems.append(str(error))
        return findings
    found = modes(model, rest)
    findings.facts['rest'] = dict(zip(model.coordinate_names, rest.tolist(), strict=True))
    findings.facts['natural_frequencies'] = [mode.frequency for mode in found]
    findings.facts['damping_ratios'] = [
        mode.damping_ratio if mode.frequency else None for mode in found
    ]
    return findings


def check_layout(path: Path, machine_path: Path | None) -> Findings:
    """
    Check a layout file, against a machine where one is given.

    Parameters
    ----------
    path : Path
    machine_path : Path or None

    Returns
    -------
    Findings

    """
    findings = Findings(path, 'layout')
    try:
        layout = load_layout(path).layout
        findings.facts = _layout_facts(layout)
        findings.problems.extend(_shared_columns(layout))
        if machine_path is not None:
            machine = load_machine(machine_path).machine
            findings.facts |= _fit(machine, layout, layout.sample_rate or 1.0)
    except IdentnlError as error:
        findings.problems.append(str(error))
    return findings


def check_bag(path: Path, machine_path: Path | None) -> Findings:
    """
    Check a bag: is it whole, does it fit its machine.

    Parameters
    ----------
    path : Path
    machine_path : Path or None
        None: the machine file that the bag carries, if any.

    Returns
    -------
    Findings

    """
    findings = Findings(path, 'bag')
    try:
        bag = open_bag(path)
        findings.facts = {'topics': bag.topics, 'streams': []}
        for stream in bag.streams:
            facts = _layout_facts(stream.layout)
            samples, lost, missing = _count(bag.blocks(stream.stream_id))
            facts |= {
                'stream_id': stream.stream_id,
                'sample_rate': stream.sample_rate,
                'samples': samples,
                'duration': samples / stream.sample_rate,
            }
            findings.facts['streams'].append(facts)
            if lost:
                _lacking(findings, lost, samples + lost).append(
                    f'{lost} of {samples + lost} samples are missing between the blocks'
                )
            for sensor, count in zip(stream.layout.sensors, missing, strict=False):
                if count:
                    _lacking(findings, int(count), samples).append(
                        f'{sensor.name}: {count} of {samples} samples have no valid reading'
                    )
            machine = None
            if machine_path is not None:
                machine = load_machine(machine_path).machine
            elif stream.machine_text:
                machine = read_machine(stream.machine_text, f'machine file in {path}')
            if machine is not None:
                facts |= _fit(machine, stream.layout, stream.sample_rate)
        findings.problems.extend(bag.problems)
    except IdentnlError as error:
        findings.problems.append(str(error))
    return findings


def _lacking(findings: Findings, count: int, total: int) -> list[str]:
    """Where to say that some of all samples are not there."""
    return findings.problems if count >= HARMLESS_SHARE * total else findings.remarks


def _count(blocks: Iterator[SampleBlock]) -> tuple[int, int, NDArray[np.int64]]:
    """Count samples, samples missing between blocks, samples without reading by channel."""
    samples = lost = next_index = 0
    missing = np.zeros(0, dtype=int)
    for block in blocks:
        if not samples:
            next_index = block.first_index
            missing = np.zeros(block.samples.shape[1], dtype=int)
        lost += max(0, block.first_index - next_index)
        next_index = max(next_index, block.next_index)
        samples += block.samples.shape[0]
        missing += (~np.isfinite(block.samples)).sum(axis=0)
    return samples, lost, missing


def _shared_columns(layout: Layout) -> list[str]:
    readers: dict[str, list[str]] = {}
    for sensor in layout.sensors:
        readers.setdefault(sensor.column, []).append(sensor.name)
    return [
        f'sensors {" and ".join(names)} read the same column {column!r}; correct the key column'
        for column, names in readers.items()
        if len(names) > 1
    ]


def _layout_facts(layout: Layout) -> dict[str, Any]:
    return {
        'stand': layout.stand,
        'channels': [
            {'name': sensor.name, 'kind': sensor.kind.value, 'unit': sensor.kind.unit}
            for sensor in layout.sensors
        ],
    }


def _fit(machine: Machine, layout: Layout, sample_rate: float) -> dict[str, Any]:
    """How well the layout sees the machine; raises LayoutError where it does not."""
    model = assemble(machine)
    transform = MotionTransform(model, layout, sample_rate)
    deviations = np.sqrt(np.diag(transform.displacement_covariance))
    return {
        'machine': machine.name,
        'derived': list(transform.derived),
        'displacement_standard_deviation': {
            name: float(value) if np.isfinite(value) else None
            for name, value in zip(model.coordinate_names, deviations, strict=True)
        },
    }
