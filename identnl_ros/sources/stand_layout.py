# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The sensor layout of a simulated stand: asked for, beside the machine file, or complete."""

from dataclasses import dataclass
from pathlib import Path

from identnl_ros.core.measurement.complete_layout import complete_layout
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.storage.layout_file import default_layout_path, load_layout
from identnl_ros.storage.machine_file import MachineFile

DEFAULT_SAMPLE_RATE = 10_000.0  # [Hz]


@dataclass(frozen=True)
class StandLayout:
    """
    A layout and where it comes from.

    Parameters
    ----------
    layout : Layout
    text : str
        Of its file; empty where there is none.
    remark : str
        What the user should know of the choice; empty: nothing.

    """

    layout: Layout
    text: str
    remark: str = ''

    def sample_rate(self, asked: float | None) -> float:
        """
        Choose the sample rate.

        Parameters
        ----------
        asked : float or None
            [Hz]; None: that of the layout file, or 10 kHz.

        Returns
        -------
        float
            [Hz].

        """
        return (self.layout.sample_rate or DEFAULT_SAMPLE_RATE) if asked is None else asked


def stand_layout(machine: MachineFile, path: Path | None) -> StandLayout:
    """
    Find the layout of a simulated stand.

    Parameters
    ----------
    machine : MachineFile
    path : Path or None
        Layout file; None: the one beside the machine file, else a layout that sees everything.

    Returns
    -------
    StandLayout

    Raises
    ------
    LayoutError
        If the file is unsound.

    """
    beside = default_layout_path(machine.path)
    if path is None and not beside.exists():
        return StandLayout(
            complete_layout(machine.machine),
            '',
            f'no layout file given and no {beside}: three-axis sensors of displacement, velocity '
            'and acceleration at three points of every body',
        )
    file = load_layout(path or beside)
    return StandLayout(file.layout, file.text)
