# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Error rates of the diagnosis: what is hidden at random, what is named.

The shipped machines with nominal noise, displacement sensors and accelerometers; 0.41 s are
diagnosed, the 0.15 s after them are held out. The fit starts from the data, and where that ends
far off from the values of the machine file, which are up to 30 % wrong.
"""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import Value
import os
import time
from typing import Any

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
from identnl_ros.core.discrepancy.diagnosis import Verdict
from identnl_ros.core.errors import IdentnlError
from identnl_ros.sources.record_diagnosis import diagnose_record
from monte_carlo import RESULTS, SEED
import numpy as np
from rich.console import Console
from rich.progress import track

GROUPS = ('one', 'null', 'outside', 'strong', 'two', 'three')
EXCITATIONS = ('multisine', 'sine')
FLOOR = 1.2
# Records of every cell: of the knee and column, of the machine of three bodies.
PLAN = {
    ('one', 'multisine'): (200, 100),
    ('null', 'multisine'): (200, 100),
    ('outside', 'multisine'): (70, 30),
    ('strong', 'multisine'): (40, 20),
    ('two', 'multisine'): (30, 20),
    ('three', 'multisine'): (30, 20),
    ('one', 'sine'): (40, 20),
    ('null', 'sine'): (40, 20),
    ('outside', 'sine'): (10, 5),
    ('strong', 'sine'): (10, 5),
    ('two', 'sine'): (10, 5),
    ('three', 'sine'): (10, 5),
}


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
    case = task.case()
    begin = time.process_time()
    machine = case.description.machine
    try:
        checked = diagnose_record(machine, case.record, case.held_out, task.seed)
    except (IdentnlError, np.linalg.LinAlgError) as error:
        seconds = time.process_time() - begin
        none = float('nan')
        return Result(
            task, case.what, case.hidden, '', (), (), none, none, none, seconds, str(error)
        )
    found, before, after = checked.diagnosis, checked.before, checked.after
    return Result(
        task, case.what, case.hidden, found.verdict.value,
        tuple(one.hypothesis.key for one in found.named),
        tuple(tuple(other.key for other in one.finding.rivals) for one in found.named),
        before.response, after.response, after.noise_floor, time.process_time() - begin,
        '' if found.verdict is not Verdict.UNEXPLAINED
        else ', '.join('/'.join(one.key) for one in found.suspected),
    )  # fmt: skip


def tally(results: Sequence[Result]) -> Counter[str]:
    """
    Count outcomes.

    Parameters
    ----------
    results : sequence of Result

    Returns
    -------
    Counter

    """
    return Counter(one.outcome for one in results)


def table(results: Sequence[Result]) -> str:
    """
    Write a line for every group.

    Parameters
    ----------
    results : sequence of Result

    Returns
    -------
    str
        Markdown.

    """
    kinds = ('named', 'class', 'some', 'more', 'wrong', 'unexplained', 'nothing', 'failed')
    heads = ('hidden', 'machine', 'excitation', 'records', *kinds, 'held-out error <= 1.2 floor')
    lines = [f'| {" | ".join(heads)} | s per record |', '| --- ' * (len(heads) + 1) + '|']
    groups: dict[tuple[str, str, str], list[Result]] = {}
    for one in results:
        key = one.task.group, one.task.machine, one.task.excitation
        groups.setdefault(key, []).append(one)
    order = sorted(groups, key=lambda key: (key[2], GROUPS.index(key[0]), key[1]))
    for key in order:
        own = groups[key]
        counts = tally(own)
        floor = sum(one.reaches_floor for one in own if one.verdict)
        lines.append(
            f'| {" | ".join(key)} | {len(own)} | '
            + ' | '.join(str(counts[kind]) for kind in kinds)
            + f' | {floor} | {np.median([one.seconds for one in own]):.1f} |'
        )
    return '\n'.join(lines)


def by_effect(results: Sequence[Result]) -> str:
    """
    Write a line for every effect that was hidden alone.

    Parameters
    ----------
    results : sequence of Result

    Returns
    -------
    str
        Markdown.

    """
    groups: dict[str, list[Result]] = {}
    for one in results:
        if len(one.hidden) == 1:
            groups.setdefault(one.hidden[0][0], []).append(one)
    lines = ['| effect | records | named | class | other |', '| --- ' * 5 + '|']
    for name, own in sorted(groups.items()):
        counts = tally(own)
        others = ', '.join(
            f'{number} {kind}' for kind, number in counts.items() if kind not in ('named', 'class')
        )
        lines.append(f'| {name} | {len(own)} | {counts["named"]} | {counts["class"]} | {others} |')
    return '\n'.join(lines)


def misses(results: Sequence[Result]) -> str:
    """
    List what was not named rightly.

    Parameters
    ----------
    results : sequence of Result

    Returns
    -------
    str
        Markdown.

    """
    lines = []
    for one in results:
        right = ('nothing',) if one.task.group == 'null' else ('named', 'class')
        right = ('unexplained',) if one.task.group == 'outside' else right
        if one.outcome not in right:
            said = ', '.join('/'.join(key) for key in one.named) or one.note or one.verdict
            task = one.task
            lines.append(
                f'* {task.group}, {task.machine}, {task.excitation}, seed {task.seed}: '
                f'{one.outcome}. Hidden: {one.what or "nothing"}. Said: {said}.'
            )
    return '\n'.join(lines)


def tasks_of(groups: Sequence[str], excitations: Sequence[str], share: float) -> list[Task]:
    """
    List the records to diagnose: the cells of the plan, evenly mixed.

    Parameters
    ----------
    groups, excitations : sequence of str
    share : float
        Of the records of the plan.

    Returns
    -------
    list of Task

    """
    found = []
    for (group, excitation), counts in PLAN.items():
        if group not in groups or excitation not in excitations:
            continue
        for machine, count in zip(MACHINES, counts, strict=True):
            runs = max(1, round(share * count))
            for number in range(runs):
                place = EXCITATIONS.index(excitation) + (number + 0.5) / runs
                found.append((place, Task(group, machine, excitation, SEED + number)))
    return [task for _, task in sorted(found, key=lambda one: one[0])]


@click.command()
@click.option('--group', 'groups', multiple=True, type=click.Choice(GROUPS), default=GROUPS)
@click.option(
    '--excitation', 'excitations', multiple=True, type=click.Choice(EXCITATIONS),
    default=EXCITATIONS,
)  # fmt: skip
@click.option(
    '--share', type=click.FloatRange(0.0, 10.0, min_open=True), default=1.0, show_default=True,
    help='Of the records of the plan.',
)  # fmt: skip
@click.option('--processes', type=click.IntRange(min=1), default=2, show_default=True)
@click.option('--out', default='hidden_effects', show_default=True, help='Name of the results.')
def command(
    groups: Sequence[str], excitations: Sequence[str], share: float, processes: int, out: str
) -> None:
    """Hide effects at random, diagnose, count."""
    tasks = tasks_of(groups, excitations, share)
    results: list[Result] = []
    console = Console(stderr=True)
    count = Value('i', 0)
    with ProcessPoolExecutor(processes, initializer=_alone, initargs=(count,)) as pool:
        futures = [pool.submit(run, task) for task in tasks]
        for one in track(as_completed(futures), total=len(tasks), console=console, transient=True):
            results.append(one.result())
            write(results, out)
    console.print(table(results))


def write(results: Sequence[Result], out: str) -> None:
    """
    Write the tables.

    Parameters
    ----------
    results : sequence of Result
    out : str
        Name of the file.

    """
    text = [__doc__ or '', table(results), '## By effect', by_effect(results)]
    missed = misses(results)
    if missed:
        text += ['## What was not named rightly', missed]
    (RESULTS / f'{out}.md').write_text('# Hidden effects\n\n' + '\n\n'.join(text) + '\n')


def _alone(count: Any) -> None:
    """Keep a process to one processor: so many records are diagnosed at a time."""
    with count.get_lock():
        number = count.value
        count.value += 1
    processors = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {processors[number % len(processors)]})


if __name__ == '__main__':
    command()
