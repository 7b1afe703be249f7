# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Calibration of the sensors of a layout file from bags."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from identnl_ros.core.calibration.findings import corrected_layout, Findings, Property
from identnl_ros.core.calibration.force_cell import calibrate_force_cell, KnownMass, ShakenMass
from identnl_ros.core.calibration.known_input import (
    calibrate_amplitude,
    KnownAmplitude,
)
from identnl_ros.core.calibration.motion_calibration import ALL, calibrate_motion, STATED_NOISE
from identnl_ros.core.calibration.quiet_findings import (
    motion_at_rest,
    quiet_findings,
    sensor_matrix_of,
    with_noise,
)
from identnl_ros.core.calibration.quiet_record import quiet_channels, QuietChannel
from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.model import Model
from identnl_ros.sources.bag_runs import BagRuns
from identnl_ros.sources.calibration_references import (
    errors_found,
    gain_errors,
    meant_sensors,
    ReferenceUncertainty,
)
from identnl_ros.sources.offline import machine_of_bag
from identnl_ros.storage.bag_reader import Bag, open_bag
from identnl_ros.storage.layout_file import LayoutFile, load_layout
from identnl_ros.storage.machine_file import load_machine
import numpy as np
from numpy.typing import NDArray

# Relative uncertainty of the noise in the record of a motion, where a quiet one told it.
MEASURED_NOISE = 0.03
# What the samples of a bag depend on, and has to be in the layout file as in the bag.
_COMMON = (
    'kind', 'body', 'point', 'direction', 'reference_body', 'excitation', 'recorded_unit', 'gain',
    'offset', 'drift', 'delay',
)  # fmt: skip


@dataclass(frozen=True)
class CalibrationBags:
    """
    What to calibrate from.

    Parameters
    ----------
    quiet : Path or None
        Machine at rest, exciters off.
    motion : sequence of Path
        Machine in motion.
    references : sequence of str
        Trusted sensors in the motion: names, patterns such as ``knee_a*``, or kinds.
    amplitudes : sequence of (Path, KnownAmplitude)
    masses : sequence of (Path, KnownMass)
    properties : collection of Property
        What to find from the motion.
    uncertainties : sequence of ReferenceUncertainty
        Of sensors that are trusted: references, accelerometers on a known mass, a force cell
        that is shaken alone. Several of one sensor add up.

    """

    quiet: Path | None = None
    motion: Sequence[Path] = ()
    references: Sequence[str] = ()
    amplitudes: Sequence[tuple[Path, KnownAmplitude]] = ()
    masses: Sequence[tuple[Path, KnownMass]] = ()
    properties: frozenset[Property] = ALL
    uncertainties: Sequence[ReferenceUncertainty] = ()


@dataclass(frozen=True)
class BagCalibration:
    """
    Result of a calibration.

    Parameters
    ----------
    file : LayoutFile
        As it was.
    findings : Findings
    channels : tuple of QuietChannel
        Of the quiet record.
    references : tuple of str
        Sensors that were trusted in the motion.
    problems : tuple of str
        Damage found in the bags.

    """

    file: LayoutFile
    findings: Findings
    channels: tuple[QuietChannel, ...]
    references: tuple[str, ...]
    problems: tuple[str, ...]


@dataclass
class _Records:
    """The runs of bags, read anew every time."""

    bags: Sequence[Bag]
    layout: Layout
    problems: list[str] = field(default_factory=list)

    def __iter__(self) -> Iterator[MeasuredRecord]:
        for bag in self.bags:
            for stream in bag.streams:
                for record in BagRuns(bag, stream).runs_of_any():
                    yield replace(record, layout=self.layout)
            self.problems += [one for one in bag.problems if one not in self.problems]


@dataclass(frozen=True)
class _Corrected:
    """Records as a layout with other gains understands them; offsets do not matter."""

    records: Iterable[MeasuredRecord]
    layout: Layout

    def __iter__(self) -> Iterator[MeasuredRecord]:
        for record in self.records:
            factors = np.array([
                old.gain / new.gain
                for old, new in zip(record.layout.sensors, self.layout.sensors, strict=True)
            ])  # fmt: skip
            yield replace(record, layout=self.layout, samples=record.samples * factors)


def calibrate_bags(
    layout_path: Path, machine_path: Path | None, bags: CalibrationBags
) -> BagCalibration:
    """
    Calibrate the sensors of a layout file.

    Parameters
    ----------
    layout_path : Path
    machine_path : Path or None
        None: the machine file that the bags carry, where one is needed.
    bags : CalibrationBags

    Returns
    -------
    BagCalibration

    Raises
    ------
    IdentnlError
        If a file cannot be used, or a bag was recorded with other sensors.

    """
    file = load_layout(layout_path)
    layout = file.layout
    findings = Findings()
    channels: tuple[QuietChannel, ...] = ()
    problems: list[str] = []
    known_noise = layout
    quiet = None
    if bags.quiet is not None:
        quiet = _records([bags.quiet], file, problems)
        channels = quiet_channels(quiet, quiet.layout)
        known_noise = with_noise(layout, channels)
    uncertainty = MEASURED_NOISE if channels else STATED_NOISE
    for path, amplitude in bags.amplitudes:
        records = _records([path], file, problems)
        findings += calibrate_amplitude(records, records.layout, amplitude)
    trusted = meant_sensors(layout, bags.references)
    used = {*trusted, *(name for _, mass in bags.masses for name in mass.accelerometers)}
    used |= {mass.cell for _, mass in bags.masses if not mass.mass}
    errors = gain_errors(layout, bags.uncertainties, used) | errors_found(findings)
    of_cells = Findings()
    for cell in dict.fromkeys(mass.cell for _, mass in bags.masses):
        shaken = []
        for path, mass in bags.masses:
            if mass.cell == cell:
                records = _records([path], file, problems)
                corrected = _corrected_by(findings, known_noise, records.layout)
                shaken.append(ShakenMass(mass, _Corrected(records, corrected), corrected))
        of_cells += calibrate_force_cell(shaken, uncertainty, errors)
    findings += of_cells
    _check_once(findings)
    if bags.motion:
        records = _records(bags.motion, file, problems)
        corrected = _corrected_by(findings, known_noise, records.layout)
        model = _model(records.bags[0], machine_path)
        findings += calibrate_motion(
            model,
            _Corrected(records, corrected),
            corrected,
            trusted,
            bags.properties,
            uncertainty,
            [one.sensor for one in findings.calibrated if one.what is Property.GAIN],
            errors | errors_found(findings),
        )
    if quiet is not None:
        findings += _of_quiet(quiet, channels, findings, machine_path)
    return BagCalibration(file, findings, channels, trusted, tuple(problems))


def _of_quiet(
    quiet: _Records,
    channels: Sequence[QuietChannel],
    findings: Findings,
    machine_path: Path | None,
) -> Findings:
    """Put the quiet record in the terms of the layout, with what else was found."""
    layout = quiet.layout
    errors: dict[tuple[str, Property], float] = {}
    for one in findings.calibrated:
        size = abs(one.value) if one.what is Property.GAIN else 1.0
        key = one.sensor, one.what
        errors[key] = float(np.hypot(errors.get(key, 0.0), one.standard_error / size))
    model = None
    if machine_path is not None or quiet.bags[0].description.machine_text:
        model = _model(quiet.bags[0], machine_path)
    found = quiet_findings(
        channels,
        layout,
        corrected_layout(layout, findings.calibrated),
        errors,
        None if model is None else _rest(model, layout),
    )
    if model is None:
        return found
    moving = motion_at_rest(model, quiet, with_noise(layout, channels))
    return replace(found, remarks=(*moving, *found.remarks))


def _rest(model: Model, layout: Layout) -> NDArray[np.float64] | None:
    """Find the readings of the displacement sensors at rest, if they are known."""
    if np.isnan(model.values).any():
        return None
    rest = static_equilibrium(model)
    if model.estimated and rest.any():
        return None
    return np.asarray(sensor_matrix_of(model, layout) @ rest)


def _records(paths: Sequence[Path], file: LayoutFile, problems: list[str]) -> _Records:
    opened = [open_bag(path) for path in paths]
    layouts = [
        _common_layout(bag, stream.layout, file) for bag in opened for stream in bag.streams
    ]
    names = [[sensor.name for sensor in one.sensors] for one in layouts]
    if any(one != names[0] for one in names):
        raise DataError(
            f'{paths[0]}: the streams have different channels; calibrate from one after the other'
        )
    return _Records(opened, layouts[0], problems)


def _common_layout(bag: Bag, recorded: Layout, file: LayoutFile) -> Layout:
    """Check that file and bag mean the same sensors; those of the file, in the bag's order."""
    sensors = {sensor.name: sensor for sensor in file.layout.sensors}
    differences = []
    for sensor in recorded.sensors:
        if sensor.name not in sensors:
            differences.append(f'{sensor.name} (not in the file)')
        elif keys := _different(sensor, sensors[sensor.name]):
            differences.append(f'{sensor.name} ({", ".join(keys)})')
    if differences:
        more = f' and {len(differences) - 5} more' if len(differences) > 5 else ''
        raise LayoutError(
            f'{file.path} does not describe the sensors that {bag.path} was recorded with: '
            f'{"; ".join(differences[:5])}{more} differ; give the layout file of the record'
        )
    return replace(file.layout, sensors=tuple(sensors[one.name] for one in recorded.sensors))


def _different(one: Sensor, other: Sensor) -> list[str]:
    found = []
    for key in _COMMON:
        first, second = getattr(one, key), getattr(other, key)
        if isinstance(first, str) or not isinstance(first, float | np.ndarray):
            same = first == second
        else:
            same = bool(np.allclose(first, second, rtol=1e-9, atol=1e-15))
        if not same:
            found.append(key)
    return found


def _chosen(layout: Layout, like: Layout) -> Layout:
    """Sensors of a layout in the order of another one."""
    sensors = {sensor.name: sensor for sensor in layout.sensors}
    return replace(layout, sensors=tuple(sensors[one.name] for one in like.sensors))


def _corrected_by(findings: Findings, known_noise: Layout, like: Layout) -> Layout:
    """Put what was found into the sensors of a record; their noise in SI follows the gain."""
    layout = _chosen(known_noise, like)
    corrected = corrected_layout(layout, findings.calibrated)
    gains = {sensor.name: sensor.gain for sensor in layout.sensors}
    return replace(
        corrected,
        sensors=tuple(
            replace(
                one,
                noise=one.noise * abs(gains[one.name] / one.gain),
                resolution=one.resolution * abs(gains[one.name] / one.gain),
            )
            for one in corrected.sensors
        ),
    )


def _check_once(findings: Findings) -> None:
    """Refuse two gains of one sensor."""
    found: set[str] = set()
    for one in findings.calibrated:
        if one.what is Property.GAIN:
            if one.sensor in found:
                raise DataError(
                    f'sensor {one.sensor}: two known inputs give its gain; give one at a time'
                )
            found.add(one.sensor)


def _model(bag: Bag, machine_path: Path | None) -> Model:
    if machine_path is not None:
        return assemble(load_machine(machine_path).machine)
    return assemble(machine_of_bag(bag))
