# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A progress bar on standard error, silent where nobody watches."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


@contextmanager
def progress(title: str, total: float) -> Iterator[Callable[[float], None]]:
    """
    Show how far a job has come.

    Parameters
    ----------
    title : str
    total : float
        Size of the whole job.

    Yields
    ------
    callable
        To be called with the size of every part done.

    """
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=total)
        yield lambda part: bar.advance(task, part)


@contextmanager
def progress_of(title: str) -> Iterator[Callable[[int, int], None]]:
    """
    Show how far a job has come whose size turns out on the way.

    Parameters
    ----------
    title : str

    Yields
    ------
    callable
        To be called with what is done and what there is to do.

    """
    with progress(title, 1.0) as advance:
        before = 0.0

        def report(done: int, size: int) -> None:
            nonlocal before
            share = done / size if size else 1.0
            advance(share - before)
            before = share

        yield report


@contextmanager
def activity(title: str) -> Iterator[Callable[[str], None]]:
    """
    Show what a job whose size is not known does, and since when.

    Parameters
    ----------
    title : str

    Yields
    ------
    callable
        To be called with what is done from now on.

    """
    console = Console(stderr=True)
    columns = SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True,
                  disable=not console.is_terminal) as bar:  # fmt: skip
        task = bar.add_task(title, total=None)
        yield lambda what: bar.update(task, description=f'{title}: {what}')
