# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A progress bar on standard error, silent where nobody watches."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress


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
