# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How plots look: to be told apart in grey, labelled in words, in units that people use."""

from dataclasses import dataclass
from typing import Any

from identnl_ros.reports.paper_units import PaperUnit
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

RESOLUTION = 120  # pixels per inch
_PREFIXES = {1e-9: 'n', 1e-6: 'µ', 1e-3: 'm', 1.0: '', 1e3: 'k', 1e6: 'M'}


@dataclass(frozen=True)
class Style:
    """
    How one thing is drawn, as bars, as a line, as dots and as marks.

    Parameters
    ----------
    colour, dashes : str
    width : float
        Of a line [points].
    dot : float
        [points].

    """

    colour: str
    dashes: str
    width: float
    dot: float

    @property
    def bar(self) -> dict[str, Any]:
        """Arguments for bars."""
        return {'color': self.colour, 'edgecolor': 'black', 'linewidth': 0.5}

    @property
    def line(self) -> dict[str, Any]:
        """Arguments for lines."""
        return {'color': self.colour, 'linestyle': self.dashes, 'linewidth': self.width}

    @property
    def dots(self) -> dict[str, Any]:
        """Arguments for dots, which do not hide a lighter line below them."""
        return {'color': self.colour, 'markersize': self.dot, 'rasterized': True}

    @property
    def mark(self) -> dict[str, Any]:
        """Arguments for marks of another shape."""
        return {'color': self.colour, 'markeredgewidth': self.width}


MEASURED = Style('0.75', '-', 3.0, 5.0)
BEFORE = Style('#e08214', '--', 1.4, 2.0)
AFTER = Style('black', '-', 0.9, 1.2)
NOISE = Style('#35618f', ':', 1.6, 2.0)


def figure(
    rows: int, columns: int, width: float, height: float
) -> tuple[Figure, list[list[Axes]]]:
    """
    Make an empty picture.

    Parameters
    ----------
    rows, columns : int
    width, height : float
        [inches].

    Returns
    -------
    Figure
    list of list of Axes

    """
    picture = Figure(figsize=(width, height + 0.5), dpi=RESOLUTION, layout='constrained')
    FigureCanvasAgg(picture)
    table = picture.subplots(rows, columns, squeeze=False)
    for row in table:
        for axes in row:
            axes.grid(color='0.9')
            axes.set_axisbelow(True)
            axes.spines[['top', 'right']].set_visible(False)
    return picture, [list(row) for row in table]


def finish(picture: Figure) -> Figure:
    """
    Put one legend, of all that is drawn, above a picture.

    Parameters
    ----------
    picture : Figure

    Returns
    -------
    Figure

    """
    entries: dict[str, Any] = {}
    for axes in picture.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    picture.legend(
        entries.values(), entries.keys(), loc='outside upper right', ncols=len(entries),
        frameon=False, markerscale=2.0,
    )  # fmt: skip
    return picture


def prefixed(unit: str, values: NDArray[np.float64]) -> PaperUnit:
    """
    Choose a prefix that gives numbers from 1 to 1000.

    Parameters
    ----------
    unit : str
        SI.
    values : ndarray
        [unit].

    Returns
    -------
    PaperUnit

    """
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if unit.startswith('m/s²'):
        return PaperUnit(unit, 1.0)
    fitting = [size for size in _PREFIXES if size <= largest]
    size = max(fitting, default=1.0 if not largest else min(_PREFIXES))
    return PaperUnit(_PREFIXES[size] + unit, size)
