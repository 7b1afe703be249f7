# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Diagnose a record, live or from a bag: start values, diagnosis, check on held-out data."""

from collections.abc import Callable
import os

from identnl_ros.core.discrepancy.checked_diagnosis import CheckedDiagnosis
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.diagnosis import diagnose
from identnl_ros.core.discrepancy.held_out import held_out_error
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.start_values import start_values
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.machine import Machine

# Samples that are diagnosed, and that are held out to check the result.
LONGEST = 2**13
LONGEST_HELD_OUT = 2**12
SHORTEST = 2**9
# Part of a single record that is held out.
HELD_OUT_SHARE = 0.25


def divided(
    record: MeasuredRecord, held_out: MeasuredRecord | None, where: str
) -> tuple[MeasuredRecord, MeasuredRecord]:
    """
    Choose what of a record is diagnosed, and what the result is checked on.

    Parameters
    ----------
    record : MeasuredRecord
    held_out : MeasuredRecord or None
        To check the result on; None: the last part of the record.
    where : str
        What the record comes from, for errors.

    Returns
    -------
    diagnosed, held_out : MeasuredRecord

    Raises
    ------
    DataError
        If the record is too short.

    """
    if held_out is None:
        count = min(round(HELD_OUT_SHARE * len(record.samples)), LONGEST_HELD_OUT)
        whole = len(record.samples)
        held_out, record = record.part(whole - count, whole), record.part(0, whole - count)
    record, held_out = record.part(0, LONGEST), held_out.part(0, LONGEST_HELD_OUT)
    if len(record.samples) < SHORTEST:
        raise DataError(
            f'{where}: {len(record.samples)} uninterrupted samples with force are too few for a '
            f'diagnosis, expected at least {SHORTEST}'
        )
    return record, held_out


def diagnose_record(
    machine: Machine,
    record: MeasuredRecord,
    held_out: MeasuredRecord,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
    problems: tuple[str, ...] = (),
) -> CheckedDiagnosis:
    """
    Diagnose a record and check the result on another one.

    Parameters
    ----------
    machine : Machine
    record, held_out : MeasuredRecord
        As `divided` gives them.
    seed : int
        Of the draws of noise.
    progress : callable
        Is told what goes on, in words.
    problems : tuple of str
        Of the data, to be passed on.

    Returns
    -------
    CheckedDiagnosis

    Raises
    ------
    IdentnlError
        If the machine lacks start values, cannot be simulated, or does not fit the layout.

    """
    description = Description(machine, record.layout)
    start = start_values(machine, record)
    diagnosis = diagnose(
        description, start, record, seed, progress=progress, threads=len(os.sched_getaffinity(0))
    )
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
        before, after, problems,
    )  # fmt: skip
