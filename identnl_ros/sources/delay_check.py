# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whether the channels of a bag are late against each other, by the motion they measured."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.measured_record import MARGIN, MeasuredRecord
from identnl_ros.core.measurement.short_gaps import bridged
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.readable import readable
from identnl_ros.core.simulation.stand import MOTION_KINDS
from identnl_ros.core.synchronisation.channel_delays import channel_delays, ChannelDelays
from identnl_ros.core.synchronisation.damping_cost import damped_modes, damping_change
from identnl_ros.core.synchronisation.late_channels import late_channels
from identnl_ros.sources.judged_stream import JudgedStream
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

# Of the record that is looked at: the liveliest ones in a row.
MOST_SAMPLES = 8192
# Samples of a channel that are left out there; with more of them it is not compared [-].
MOST_LEFT_OUT = 0.01
# So much of what a channel reads is left by gains and directions as the monitor lets them pass,
# by 3 % and some degrees; what leaves more is no delay [-].
MOST_UNEXPLAINED = 0.1
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
        Against the sensors of the same motion that agree, beyond what the layout states [s].
    deviation : float
        Its standard deviation; infinite: no other sensor tells [s].
    late : bool
        It does not agree.

    """

    name: str
    delay: float
    deviation: float
    late: bool


@dataclass(frozen=True)
class DelayCheck:
    """
    What the motion tells of the delays of channels.

    Parameters
    ----------
    channels : tuple of ChannelDelay
        Those of which delays can be told.
    problems, remarks : tuple of str
        In sentences.

    """

    channels: tuple[ChannelDelay, ...]
    problems: tuple[str, ...]
    remarks: tuple[str, ...]


def check_delays(path: Path, model: Model) -> DelayCheck:
    """
    Estimate the delays of all channels of a bag's first stream.

    Samples and channels that the monitor finds at fault are left out.

    Parameters
    ----------
    path : Path
    model : Model
        With values for all parameters: problems tell what the delays cost of the damping.

    Returns
    -------
    DelayCheck

    Raises
    ------
    DataError
        If the bag cannot be read, or its motion tells nothing.

    """
    bag = open_bag(path)
    judged = JudgedStream(bag, bag.description, model)
    liveliest = _liveliest(path, judged.blocks(), bag.description)
    record, remarks = _comparable(liveliest, [one.channel for one in judged.contradictions()])
    found = channel_delays(model, record)
    modes = damped_modes(model)
    channels: list[ChannelDelay] = []
    problems: list[str] = []
    for group in range(int(found.groups.max(initial=-1)) + 1):
        told = np.isfinite(found.standard_deviations) & (found.standard_deviations > 0)
        members = np.flatnonzero(told & (found.groups == group))
        if members.size < 2:
            continue
        worst = members[np.argmax(found.unexplained[members])]
        if found.unexplained[worst] > MOST_UNEXPLAINED:
            problems.append(_refusal(found, members, int(worst)))
            continue
        widened = float(found.widened[members].max())
        if widened > 1:
            remarks.append(
                f'{_listed(found.names, members)}: rigid motion and noise do not explain all that '
                f'they read; the standard deviations of their delays are {widened:.2g} times '
                'those from noise alone'
            )
        own, sentences = _judged(found, members, modes)
        channels += own
        problems += sentences
    return DelayCheck(tuple(channels), tuple(problems), tuple(remarks))


def _judged(
    found: ChannelDelays,
    members: NDArray[np.int64],
    modes: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[list[ChannelDelay], list[str]]:
    """Tell which channels of a group are late, if that costs anything."""
    names = [found.names[i] for i in members]
    result = late_channels(found.delays[members], found.covariance[np.ix_(members, members)])
    channels = [
        ChannelDelay(name, delay, deviation, place in result.late)
        for place, (name, delay, deviation) in enumerate(
            zip(names, result.delays.tolist(), result.standard_deviations.tolist(), strict=True)
        )
    ]
    sentences = []
    for place in sorted(result.late):
        one = channels[place]
        change = damping_change(one.delay, *modes)
        if change or (not modes[0].size and abs(one.delay) > WORTH_A_WORD):
            sentences.append(_sentence(one, change))
    if not (sentences and result.rivals):
        return channels, [f'{one}; state its delay in the layout' for one in sentences]
    others = ' or '.join(_listed(names, sorted(one)) for one in result.rivals)
    advice = (
        f'or {others} the other way; the sensors do not tell which. Add a sensor, or state in '
        'the layout the delay that you know'
    )
    return channels, [f'{one}; {advice}' for one in sentences]


def _sentence(one: ChannelDelay, change: str | None) -> str:
    kind = 'late' if one.delay > 0 else 'early'
    text = (
        f'{one.name}: is {kind} by {readable(abs(one.delay), "s")} (standard deviation '
        f'{readable(one.deviation, "s", 2)}) against the other sensors of the same motion'
    )
    return f'{text}, which changes {change}' if change else text


def _refusal(found: ChannelDelays, members: NDArray[np.int64], worst: int) -> str:
    return (
        f'{_listed(found.names, members)}: no delays are told, the sensors contradict each other: '
        f'{found.unexplained[worst]:.0%} of what {found.names[worst]} reads is not the rigid '
        'motion that the others see, whatever the delays; check polarity, gain, order of the '
        'columns, places and directions in the layout'
    )


def _listed(names: Sequence[str], members: Iterable[int]) -> str:
    return ', '.join(names[i] for i in members)


def _comparable(
    record: MeasuredRecord, contradicting: Sequence[str]
) -> tuple[MeasuredRecord, list[str]]:
    """Leave out channels at fault; bridge single samples that are left out."""
    sensors = record.layout.sensors
    missing = np.isnan(record.samples).mean(axis=0)
    remarks = []
    kept = []
    for place, sensor in enumerate(sensors):
        if sensor.kind not in MOTION_KINDS:
            continue
        if sensor.name in contradicting:
            remarks.append(f'{sensor.name}: its delay is not told, it contradicts the others')
        elif missing[place] > MOST_LEFT_OUT:
            remarks.append(
                f'{sensor.name}: its delay is not told, {missing[place]:.1%} of its samples are '
                'left out'
            )
        else:
            kept.append(place)
    samples = np.empty((len(record.samples), len(kept)))
    for column, place in enumerate(kept):
        samples[:, column] = bridged(record.samples[:, place])
    layout = replace(record.layout, sensors=tuple(sensors[place] for place in kept))
    return replace(record, layout=layout, samples=samples), remarks


def _liveliest(
    path: Path, blocks: Iterable[SampleBlock], stream: StandDescription
) -> MeasuredRecord:
    """Find the part without lost blocks in which the channels move most, in bounded memory."""
    parts: deque[NDArray[np.float64]] = deque()
    first = following = since = 0
    best = np.empty((0, len(stream.layout.sensors)))
    best_index, best_score = 0, -np.inf
    motion = [i for i, one in enumerate(stream.layout.sensors) if one.kind in MOTION_KINDS]

    def weigh() -> None:
        nonlocal best, best_index, best_score, since
        since = 0
        samples = np.concatenate(parts)
        score = _liveliness(samples[:, motion])
        if score > best_score:
            best, best_index, best_score = samples, first, score

    for block in blocks:
        if parts and block.first_index != following:
            weigh()
            parts.clear()
        if not parts:
            first = block.first_index
        parts.append(block.samples)
        following = block.next_index
        since += len(block.samples)
        while sum(map(len, parts)) - len(parts[0]) >= MOST_SAMPLES:
            first += len(parts.popleft())
        if since >= MOST_SAMPLES // 4:
            weigh()
    if parts:
        weigh()
    if len(best) < 4 * MARGIN:
        raise DataError(f'{path}: has too few samples without a gap to find delays')
    return MeasuredRecord(stream.layout, stream.sample_rate, best, best_index)


def _liveliness(samples: NDArray[np.float64]) -> float:
    """Mean logarithm of the channels' energies: no scale matters, nor do constants."""
    count = np.isfinite(samples).sum(axis=0)
    valid = np.where(np.isfinite(samples), samples, 0.0)
    mean = valid.sum(axis=0) / np.maximum(count, 1)
    energy = (np.where(np.isfinite(samples), samples - mean, 0.0) ** 2).sum(axis=0)
    # Missing samples of a channel cost as much as they may, if it is to be compared.
    missing = 1 - count / max(len(samples), 1)
    scores = np.log(np.maximum(energy, np.finfo(float).tiny)) - missing / MOST_LEFT_OUT
    return float(scores.mean()) if scores.size else 0.0
