# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What lost sensors cost, in sentences for the user."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.measurement.motion_map import MotionMap
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

KINDS = (
    SensorKind.DISPLACEMENT,
    SensorKind.VELOCITY,
    SensorKind.ACCELERATION,
    SensorKind.FORCE,
)


def layout_without(layout: Layout, channels: Collection[int]) -> Layout:
    """
    Leave out sensors.

    Parameters
    ----------
    layout : Layout
    channels : collection of int

    Returns
    -------
    Layout

    Raises
    ------
    LayoutError
        If no sensor is left.

    """
    kept = tuple(one for i, one in enumerate(layout.sensors) if i not in channels)
    return replace(layout, sensors=kept)


def cost_of(
    model: Model,
    layout: Layout,
    sample_rate: float,
    lost: Collection[int],
    noise: NDArray[np.float64],
) -> str:
    """
    Say how much worse the motion is known without some sensors.

    Parameters
    ----------
    model : Model
    layout : Layout
    sample_rate : float
        [Hz].
    lost : collection of int
        Channels.
    noise : ndarray, shape (n_channels,)
        Standard deviation of one sample [SI]; NaN, 0: not known, then alike for all of a kind.

    Returns
    -------
    str
        To follow "without them".

    """
    known = {}
    noise = noise.copy()
    for kind in KINDS:
        own = list(layout.of_kind(kind))
        known[kind] = bool(np.all(noise[own] > 0))
        if not known[kind]:
            noise[own] = 1.0
    try:
        complete = MotionMap(model, layout, sample_rate)
    except LayoutError as error:
        # Without them the layout is sound, with them it was not.
        return f'nothing is lost ({error})'
    try:
        rest = MotionMap(model, layout_without(layout, lost), sample_rate)
    except LayoutError as error:
        return f'too little is seen ({error})'
    before = complete.covariances(noise, complete.usual)
    kept = np.array([i not in lost for i in range(len(noise))])
    after = rest.covariances(noise[kept], rest.usual)
    concerned = {layout.sensors[i].kind for i in lost}
    costs = []
    names = [coordinate.in_words for coordinate in model.coordinates]
    newly = dict(zip(KINDS[1:3], np.array(rest.derived) > complete.derived, strict=True))
    for kind, old, new in zip(KINDS, before, after, strict=False):
        if kind not in concerned:
            continue
        squares = np.diag(old)
        ratio = np.ones(len(names))
        np.divide(np.diag(new), squares, out=ratio, where=squares > 0)
        ratio = np.sqrt(ratio)
        worst = int(np.argmax(ratio))
        cost = (
            f'the standard deviation of the {kind.value} in {names[worst]} is '
            f'{ratio[worst]:.3g} times as large'
        )
        if newly.get(kind):
            reason = f'the {kind.value} is (partly) differentiated from the displacement'
            comparable = known[kind] and known[SensorKind.DISPLACEMENT]
            cost = f'{cost}, because {reason}' if comparable else reason
        costs.append(cost)
    return '; '.join(costs)


def sentence_of_loss(
    layout: Layout, lost: Collection[int], cost: str, samples: int, total: int, sample_rate: float
) -> str:
    """
    Say what was lost and what it cost.

    Parameters
    ----------
    layout : Layout
    lost : collection of int
        Channels lost at the same time.
    cost : str
        As `cost_of` tells it.
    samples, total : int
        That have come meanwhile, and in all.
    sample_rate : float
        [Hz].

    Returns
    -------
    str

    """
    names = _names(layout, lost)
    when = f'for {samples / sample_rate:.3g} s ({samples} of {total} samples)'
    if samples >= total:
        when = 'in the whole stream'
    if 1 < len(layout.sensors) == len(lost):
        return f'all channels: no readings {when}'
    return f'{names}: no readings {when}; without {_them(lost)} {cost}'


def sentence_of_ignored(layout: Layout, ignored: Collection[int], cost: str) -> str:
    """
    Say what it costs to ignore sensors.

    Parameters
    ----------
    layout : Layout
    ignored : collection of int
        Channels.
    cost : str
        As `cost_of` tells it.

    Returns
    -------
    str

    """
    return f'{_names(layout, ignored)}: ignored; without {_them(ignored)} {cost}'


def sentences_of_unseen(model: Model, unseen: Sequence[NDArray[np.int_]], total: int) -> list[str]:
    """
    Say which instants tell nothing because sensors that are left do not see enough.

    Parameters
    ----------
    model : Model
    unseen : sequence of 4 ndarray of int, shape (n_coordinates,)
        Instants at which displacement, velocity, acceleration or force of a coordinate is not
        known.
    total : int
        Instants.

    Returns
    -------
    list of str

    """
    sentences = []
    for kind, counts in zip(KINDS, unseen, strict=True):
        if not counts.any():
            continue
        names = [model.coordinates[i].in_words for i in np.flatnonzero(counts)]
        shown = ', '.join(names[:3]) + (f' and {len(names) - 3} more' if len(names) > 3 else '')
        sentences.append(
            f'the {kind.value} of {shown} is not visible to the sensors left at '
            f'{counts.max()} of {total} instants: these cannot be used'
        )
    return sentences


def _names(layout: Layout, channels: Collection[int]) -> str:
    return ', '.join(layout.sensors[i].name for i in sorted(channels))


def _them(channels: Collection[int]) -> str:
    return 'it' if len(channels) == 1 else 'them'
