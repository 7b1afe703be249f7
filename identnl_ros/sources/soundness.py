# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whether a machine file, a layout file or a bag is sound, and what it holds."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.mechanics.modes import modes
from identnl_ros.core.quality.common_faults import fault_of, told_once
from identnl_ros.core.quality.condition import Condition, EXCLUDING, Finding
from identnl_ros.core.quality.monitor import monitored, QualityMonitor, QualitySummary
from identnl_ros.core.quality.stamp_check import StampCheck
from identnl_ros.sources.delay_check import check_delays
from identnl_ros.sources.losses import AFTER_END
from identnl_ros.storage.alignment_record import read_alignment
from identnl_ros.storage.bag_reader import Bag, open_bag
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine, read_machine
from identnl_ros.storage.stand_description import StandDescription
import numpy as np

HARMLESS_SHARE = 0.01  # samples without reading, of all
# Of the mass of the body that a force cell is on; what is in front of a cell is a plate or a stud.
USUAL_FRONT_SHARE = 0.1


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
        findings.problems.extend(str(error).splitlines())
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
        if machine_path is None:
            findings.remarks.append(
                'not compared with a machine; give its machine file on the same command line'
            )
        else:
            machine = load_machine(machine_path).machine
            findings.facts |= _fit(machine, layout, layout.sample_rate or 1.0)
            findings.remarks.extend(_heavy_front_masses(machine, layout))
    except IdentnlError as error:
        findings.problems.extend(str(error).splitlines())
    return findings


def check_bag(path: Path, machine_path: Path | None, delays: bool = False) -> Findings:
    """
    Check a bag: is it whole, does it fit its machine.

    Parameters
    ----------
    path : Path
    machine_path : Path or None
        None: the machine file that the bag carries, if any.
    delays : bool
        Also whether channels of the first stream are late, as far as redundant sensors tell.

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
            machine = None
            if machine_path is not None:
                machine = load_machine(machine_path).machine
            elif stream.machine_text:
                machine = read_machine(stream.machine_text, f'machine file in {path}')
            model = None if machine is None else assemble(machine)
            stamps = StampCheck(stream.sample_rate)
            blocks = stamps.watched(bag.blocks(stream.stream_id))
            summary = _judged(blocks, stream, model)
            findings.problems.extend(stamps.findings().problems)
            samples, lost = summary.samples, summary.lost_samples
            facts |= {
                'stream_id': stream.stream_id,
                'sample_rate': stream.sample_rate,
                'samples': samples,
                'duration': samples / stream.sample_rate,
                'left_out': {
                    channel.name: {cause.in_words: n for cause, n in channel.causes.items()}
                    for channel in summary.channels
                    if channel.causes
                },
                'faults': [_fault(one) for one in summary.findings],
            }
            if summary.gain_limits:
                facts |= _gains_told(summary.gain_limits)
            findings.facts['streams'].append(facts)
            if lost:
                _lacking(findings, lost, samples + lost).append(
                    f'{lost} of {samples + lost} samples are missing between the blocks'
                )
            if summary.blocks_after_end:
                findings.problems.append(AFTER_END.format(summary.blocks_after_end))
            _tell_faults(findings, summary)
            if machine is not None:
                facts |= _fit(machine, stream.layout, stream.sample_rate)
                findings.remarks.extend(_heavy_front_masses(machine, stream.layout))
            if delays and model is not None and stream is bag.streams[0]:
                facts['delays'] = _delays(path, model, findings)
        _tell_alignment(bag, findings)
        findings.problems.extend(bag.problems)
    except IdentnlError as error:
        findings.problems.append(str(error))
    return findings


def _tell_alignment(bag: Bag, findings: Findings) -> None:
    """Tell what delays between the sources of a bag remain, as far as it says so."""
    sources, problem = read_alignment(bag)
    if problem:
        findings.problems.append(problem)
    if sources:
        findings.facts['remaining_delays'] = {one.name: one.deviation for one in sources}
    for one in sources:
        if not one.by_motion and one.deviation > 0.5 / bag.description.sample_rate:
            findings.remarks.append(
                f'{one.name}: is not aligned, a delay with a standard deviation of '
                f'{one.deviation * 1e6:.3g} us against the other files of the run remains'
            )


def _delays(path: Path, model: Model, findings: Findings) -> dict[str, Any]:
    try:
        found = check_delays(path, model)
    except DataError as error:
        findings.remarks.append(f'delays are not known: {error}')
        return {}
    findings.problems.extend(found.problems)
    findings.remarks.extend(found.remarks)
    return {
        one.name: {'delay': one.delay, 'standard_deviation': one.deviation}
        for one in found.channels
        if np.isfinite(one.deviation)
    }


def _lacking(findings: Findings, count: int, total: int) -> list[str]:
    """Where to say that some of all samples are not there."""
    return findings.problems if count >= HARMLESS_SHARE * total else findings.remarks


def _tell_faults(findings: Findings, summary: QualitySummary) -> None:
    """Tell faults of channels, those that cost little as remarks."""
    shares = {channel.name: channel.excluded for channel in summary.channels}
    usual = min(shares.values())  # of faults of all channels
    problems: list[tuple[str, str]] = []
    remarks: list[tuple[str, str]] = []
    for fault in summary.findings:
        # A channel is lost by another fault, which is told.
        if fault.condition & (Condition.GAP | Condition.LOST):
            continue
        harmful = not fault.condition & EXCLUDING
        left_out = shares.get(fault.channel, usual)
        serious = harmful or left_out >= HARMLESS_SHARE * summary.samples
        (problems if serious else remarks).append(fault_of(fault))
    findings.problems.extend(told_once(problems, shares))
    findings.remarks.extend(told_once(remarks, shares))


def _judged(
    blocks: Iterator[SampleBlock], stream: StandDescription, model: Model | None
) -> QualitySummary:
    monitor = QualityMonitor(stream.layout, stream.sample_rate, model)
    for _ in monitored(blocks, monitor):
        pass
    return monitor.summary()


def _gains_told(limits: dict[str, tuple[float, float]]) -> dict[str, Any]:
    """Say how wrong a gain would have to be to be found: for people, and channel by channel."""
    told = {name: one for name, (one, _) in limits.items() if np.isfinite(one)}
    text = 'not told: no motion, or less than 1 s'
    if told:
        worst = max(told, key=lambda name: told[name])
        text = (
            f'found from {100 * min(told.values()):.2g} % to {100 * told[worst]:.2g} % ({worst})'
        )
        silent = len(limits) - len(told)
        text += f'; {silent} not told: too little motion' if silent else ''
    return {
        'wrong_gains': text,
        'gain_limits': {
            name: {
                'found': found if np.isfinite(found) else None,
                'named': named if np.isfinite(named) else None,
            }
            for name, (found, named) in limits.items()
        },
    }


def _fault(finding: Finding) -> dict[str, Any]:
    return {
        'channel': finding.channel,
        'condition': finding.condition.in_words,
        'first_index': finding.first_index,
        'next_index': finding.next_index,
        'amount': finding.amount if np.isfinite(finding.amount) else None,
        'unit': finding.unit,
        'sentence': finding.sentence,
    }


def _shared_columns(layout: Layout) -> list[str]:
    readers: dict[str, list[str]] = {}
    for sensor in layout.sensors:
        readers.setdefault(sensor.column, []).append(sensor.name)
    return [
        f'sensors {" and ".join(names)} read the same column {column!r}; correct the key column'
        for column, names in readers.items()
        if len(names) > 1
    ]


def _heavy_front_masses(machine: Machine, layout: Layout) -> list[str]:
    """Tell front masses that look like a number in another unit."""
    masses = {body.name: body.mass.value for body in machine.bodies}
    bodies = {point.name: point.body for point in machine.excitations}
    remarks = []
    for channel in layout.of_kind(SensorKind.FORCE):
        sensor = layout.sensors[channel]
        body = bodies.get(sensor.excitation, '')
        if sensor.front_mass > USUAL_FRONT_SHARE * masses.get(body, np.inf):
            remarks.append(
                f'{sensor.name}: a front_mass of {sensor.front_mass:.4g} kg is '
                f'{sensor.front_mass / masses[body]:.0%} of the mass of {body} '
                f'({masses[body]:.4g} kg), expected below {USUAL_FRONT_SHARE:.0%}; a bare number '
                'is in kg, grams are written "85 g"'
            )
    return remarks


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
