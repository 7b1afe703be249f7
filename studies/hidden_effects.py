# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Error rates of the diagnosis: what is hidden at random, what is named.

The shipped machines with nominal noise, displacement sensors and accelerometers; 0.6 s are
diagnosed, the 0.2 s after them are held out. The fit starts from no value of the unknowns.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
import json
import os
import time

os.environ.setdefault('OMP_NUM_THREADS', '1')

import click
from hidden_cases import (
    Case,
    hidden_case,
    Key,
    MACHINES,
    outside_case,
    SIZES,
    STRONG,
)
from identnl_ros.core.discrepancy.diagnosis import diagnose, Verdict
from identnl_ros.core.discrepancy.held_out import held_out_error
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.start_values import start_values
from identnl_ros.core.errors import IdentnlError
from monte_carlo import RESULTS, SEED, workers
import numpy as np
from rich.console import Console

GROUPS = ('one', 'null', 'outside', 'strong', 'two', 'three')
EXCITATIONS = ('multisine', 'sine')
FLOOR = 1.2


@dataclass(frozen=True)
class Task:
    """
    One record to diagnose.

    Parameters
    ----------
    group : str
        Of `GROUPS`.
    machine, excitation : str
    seed : int

    """

    group: str
    machine: str
    excitation: str
    seed: int

    def case(self) -> Case:
        """
        Make the record.

        Returns
        -------
        Case

        """
        if self.group == 'outside':
            return outside_case(self.machine, self.excitation, self.seed)
        number = {'one': 1, 'strong': 1, 'null': 0, 'two': 2, 'three': 3}[self.group]
        strength = (STRONG, STRONG) if self.group == 'strong' else SIZES
        return hidden_case(self.machine, self.excitation, number, strength, self.seed)


@dataclass(frozen=True)
class Result:
    """
    What a diagnosis said.

    Parameters
    ----------
    task : Task
    what : str
        That was hidden.
    hidden : tuple of (str, str)
    verdict : str
        Empty: it failed.
    named : tuple of (str, str)
    rivals : tuple of tuple of (str, str)
        Of each: what else it could be.
    before, after, floor : float
        Held-out errors.
    seconds : float
        Processor time.
    note : str
        Why it failed.

    """

    task: Task
    what: str
    hidden: tuple[Key, ...]
    verdict: str
    named: tuple[Key, ...]
    rivals: tuple[tuple[Key, ...], ...]
    before: float
    after: float
    floor: float
    seconds: float
    note: str = ''

    @property
    def outcome(self) -> str:
        """``named``, ``class``, ``wrong``, ``more``, ``unexplained`` or ``nothing``."""
        if self.verdict in ('unexplained', ''):
            return 'unexplained' if self.verdict else 'failed'
        if not self.named:
            return 'nothing'
        if len(self.named) > len(self.hidden):
            return 'more' if set(self.hidden) <= set(self.named) and self.hidden else 'wrong'
        right = [one in self.hidden for one in self.named]
        if all(right):
            return 'named' if len(right) == len(self.hidden) else 'some'
        for one, others in zip(self.named, self.rivals, strict=True):
            if one not in self.hidden and not set(others) & set(self.hidden):
                return 'wrong'
        return 'class' if len(right) == len(self.hidden) else 'some'

    @property
    def reaches_floor(self) -> bool:
        """The held-out error is that of the noise."""
        return self.after <= FLOOR * self.floor


def run(task: Task) -> Result:
    """
    Diagnose one record.

    Parameters
    ----------
    task : Task

    Returns
    -------
    Result

    """
    os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[os.getpid() % len(os.sched_getaffinity(0))]})
    case = task.case()
    begin = time.process_time()
    description = case.description
    try:
        start = start_values(description.machine, case.record)
        found = diagnose(description, start, case.record, task.seed)
        before = held_out_error(description, found.before.model, case.held_out)
        corrected = found.after.description
        after = held_out_error(corrected, found.after.model, reread(case.held_out, corrected.layout))
    except (IdentnlError, np.linalg.LinAlgError) as error:
        seconds = time.process_time() - begin
        none = float('nan')
        return Result(
            task, case.what, case.hidden, '', (), (), none, none, none, seconds, str(error)
        )
    return Result(
        task, case.what, case.hidden, found.verdict.value,
        tuple(one.hypothesis.key for one in found.named),
        tuple(tuple(other.key for other in one.finding.rivals) for one in found.named),
        before.response, after.response, after.noise_floor, time.process_time() - begin,
        '' if found.verdict is not Verdict.UNEXPLAINED
        else ', '.join('/'.join(one.key) for one in found.suspected),
    )  # fmt: skip
