# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Diagnose a bag: what the machine or the layout that it carries lacks."""

from collections.abc import Callable
from pathlib import Path

from identnl_ros.core.discrepancy.checked_diagnosis import CheckedDiagnosis
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.sources.bag_runs import BagRuns
from identnl_ros.sources.offline import machine_of_bag
from identnl_ros.sources.record_diagnosis import diagnose_record, divided
from identnl_ros.storage.bag_reader import Bag, open_bag


def diagnose_bag(
    path: Path,
    machine_path: Path | None = None,
    validate: Path | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> CheckedDiagnosis:
    """
    Diagnose the longest uninterrupted run of a bag.

    Parameters
    ----------
    path : Path
    machine_path : Path or None
        A machine file; None: the one that the bag carries.
    validate : Path or None
        Bag to check the result on; None: the last part of the same run.
    seed : int
        Of the draws of noise.
    progress : callable
        Is told what goes on, in words.

    Returns
    -------
    CheckedDiagnosis

    Raises
    ------
    IdentnlError
        If a file cannot be used, or they do not fit one another.

    """
    bag = open_bag(path)
    machine = machine_of_bag(bag, machine_path)
    record = _longest_run(bag)
    problems = bag.problems
    held_out = None
    if validate is not None:
        other = open_bag(validate)
        held_out = _longest_run(other)
        _require_same(record.layout, held_out.layout, validate)
        problems += other.problems
    parts = divided(record, held_out, str(path))
    return diagnose_record(machine, *parts, seed, progress, tuple(problems))


def _longest_run(bag: Bag) -> MeasuredRecord:
    longest: MeasuredRecord | None = None
    for stream in bag.streams:
        for record in BagRuns(bag, stream).runs():
            if longest is None or len(record.samples) > len(longest.samples):
                longest = record
    if longest is None:
        raise DataError(
            f'{bag.path}: no uninterrupted run with a measured force in it{bag.damage}'
        )
    return longest


def _require_same(layout: Layout, other: Layout, where: Path) -> None:
    names = [sensor.name for sensor in layout.sensors]
    if [sensor.name for sensor in other.sensors] != names:
        raise DataError(
            f'{where}: its sensors are not those of the bag that is diagnosed; expected '
            f'{", ".join(names[:6])} ...'
        )
