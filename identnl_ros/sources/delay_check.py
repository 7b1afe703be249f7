# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whether the channels of a bag are late against each other, by the motion they measured."""

from dataclasses import dataclass
from pathlib import Path

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import LARGEST_READING
from identnl_ros.core.measurement.measured_record import MARGIN, MeasuredRecord
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.damping_cost import damped_modes, damping_change
from identnl_ros.core.synchronisation.delay_estimate import channel_delays, DelayEstimate
from identnl_ros.storage.bag_reader import Bag, open_bag
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

# Of the record that is looked at.
MOST_SAMPLES = 4096
# A delay so many standard deviations from 0 is there: of a hundred channels, one in 150 bags
# without delays shows one.
SIGNIFICANT = 4.0
# Where the damping is not known [s].
WORTH_A_WORD = 1e-6


@dataclass(frozen=True)
class ChannelDelay:
    """
    By how much a channel is late.

    Parameters
    ----------
    name : str
        Of the sensor.
    delay : float
        Against the median of the sensors that see the same motion, beyond what the layout states
        [s].
    deviation : float
        Its standard deviation; infinite: no other sensor tells [s].
    warning : str or None
        What to tell the user; None: nothing.

    """

    name: str
    delay: float
    deviation: float
    warning: str | None


def check_delays(path: Path, model: Model) -> list[ChannelDelay]:
    """
    Estimate the delays of all channels of a bag's first stream.

    Parameters
    ----------
    path : Path
    model : Model
        With values for all parameters: warnings tell what the delays cost of the damping.

    Returns
    -------
    list of ChannelDelay
        Of the motion sensors that have readings.

    Raises
    ------
    DataError
        If the bag cannot be read, or its motion tells nothing.

    """
    bag = open_bag(path)
    found = channel_delays(model, _newest_whole(bag, bag.description))
    frequencies, ratios = damped_modes(model)
    result = []
    for name, delay, deviation in zip(
        found.names, _from_medians(found).tolist(), found.standard_deviations.tolist(), strict=True
    ):
        warning = None
        if np.isfinite(deviation) and abs(delay) > SIGNIFICANT * deviation:
            change = damping_change(delay, frequencies, ratios)
            if change or (not frequencies.size and abs(delay) > WORTH_A_WORD):
                warning = _sentence(name, delay, deviation, change)
        result.append(ChannelDelay(name, delay, deviation, warning))
    return result


def _from_medians(found: DelayEstimate) -> NDArray[np.float64]:
    """Count delays from the median of linked channels: a late one makes no other early."""
    count = len(found.names)
    _, groups = connected_components(found.covariance[:count, :count] != 0)
    delays = found.delays.copy()
    told = np.isfinite(found.standard_deviations)
    for group in range(groups.max(initial=-1) + 1):
        members = told & (groups == group)
        if members.any():
            delays[members] -= np.median(delays[members])
    return delays


def _sentence(name: str, delay: float, deviation: float, change: str | None) -> str:
    kind = 'late' if delay > 0 else 'early'
    text = (
        f'{name}: is {kind} by {abs(delay) * 1e6:.3g} us (standard deviation '
        f'{deviation * 1e6:.2g} us) against the other sensors of the same motion'
    )
    if change:
        text += f', which changes {change}'
    return f'{text}; state its delay in the layout'


def _newest_whole(bag: Bag, stream: StandDescription) -> MeasuredRecord:
    """Read the end of the last part without lost blocks, in bounded memory."""
    parts: list[NDArray[np.float64]] = []
    best: list[NDArray[np.float64]] = []
    first_index = best_index = next_index = 0
    for block in bag.blocks(stream.stream_id):
        if parts and block.first_index < next_index:
            continue
        if not parts or block.first_index > next_index:
            parts, first_index = [], block.first_index
        parts.append(block.samples)
        next_index = block.next_index
        while sum(map(len, parts)) - len(parts[0]) >= MOST_SAMPLES:
            first_index += len(parts.pop(0))
        if sum(map(len, parts)) >= sum(map(len, best)):
            best, best_index = list(parts), first_index
    samples = np.concatenate(best) if best else np.empty((0, len(stream.layout.sensors)))
    samples = np.where(np.abs(samples) <= LARGEST_READING, samples, np.nan)
    if len(samples) < 4 * MARGIN:
        raise DataError(f'{bag.path}: has too few samples without a gap to find delays')
    return MeasuredRecord(stream.layout, stream.sample_rate, samples, best_index)
