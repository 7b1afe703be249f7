# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Diagnose a bag: what the machine or the layout that it carries lacks."""

from collections.abc import Callable
from pathlib import Path

from identnl_ros.core.discrepancy.checked_diagnosis import CheckedDiagnosis
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.diagnosis import diagnose
from identnl_ros.core.discrepancy.held_out import held_out_error
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.start_values import start_values
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.sources.bag_runs import BagRuns
from identnl_ros.sources.offline import machine_of_bag
from identnl_ros.storage.bag_reader import open_bag

# Samples that are diagnosed, and that are held out to check the result.
LONGEST = 2**14
LONGEST_HELD_OUT = 2**12
SHORTEST = 2**9
# Part of a single record that is held out.
HELD_OUT_SHARE = 0.25


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
    record = _longest_run(path)
    problems = list(bag.problems)
    if validate is None:
        count = min(round(HELD_OUT_SHARE * len(record.samples)), LONGEST_HELD_OUT)
        whole = len(record.samples)
        held_out = record.part(whole - count, whole)
        record = record.part(0, whole - count)
    else:
        held_out = _longest_run(validate)
        held_out = _first(held_out, LONGEST_HELD_OUT)
        _require_same(record.layout, held_out.layout, validate)
        problems += open_bag(validate).problems
    record = _first(record, LONGEST)
    if len(record.samples) < SHORTEST:
        raise DataError(
            f'{path}: {len(record.samples)} uninterrupted samples with force are too few for a '
            f'diagnosis, expected at least {SHORTEST}'
        )
    description = Description(machine, record.layout)
    start = start_values(machine, record)
    diagnosis = diagnose(description, start, record, seed, progress=progress)
    progress('simulating held-out data')
    before = held_out_error(description, diagnosis.before.model, held_out)
    after = before
    if diagnosis.named:
        corrected = diagnosis.after.description
        after = held_out_error(
            corrected, diagnosis.after.model, reread(held_out, corrected.layout)
        )
    return CheckedDiagnosis(
        diagnosis, machine, len(record.samples), len(held_out.samples), record.sample_rate,
        before, after, tuple(problems),
    )  # fmt: skip


def _longest_run(path: Path) -> MeasuredRecord:
    bag = open_bag(path)
    longest: MeasuredRecord | None = None
    for stream in bag.streams:
        for record in BagRuns(bag, stream).runs():
            if longest is None or len(record.samples) > len(longest.samples):
                longest = record
    if longest is None:
        raise DataError(f'{path}: no uninterrupted run with a measured force in it')
    return longest


def _first(record: MeasuredRecord, count: int) -> MeasuredRecord:
    return record.part(0, count)


def _require_same(layout: Layout, other: Layout, where: Path) -> None:
    names = [sensor.name for sensor in layout.sensors]
    if [sensor.name for sensor in other.sensors] != names:
        raise DataError(
            f'{where}: its sensors are not those of the bag that is diagnosed; expected '
            f'{", ".join(names[:6])} ...'
        )
