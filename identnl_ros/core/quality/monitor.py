# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The monitor: judges samples as they come, leaves bad ones out and tells why."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace

from identnl_ros.core.measurement.blocks import ChannelStatus, SampleBlock, stamp_after
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.quality.condition import Condition, CONTRADICTING, EXCLUDING, Finding
from identnl_ros.core.quality.consistency import Consistency
from identnl_ros.core.quality.fault_record import bits_set, FaultRecord
from identnl_ros.core.quality.judged_run import AHEAD, JudgedRun, LAG, STRETCH, Stretch
import numpy as np
from numpy.typing import NDArray

# Most samples between the newest one taken and the newest one given out.
LOOKAHEAD = STRETCH + AHEAD + LAG
_CAUSES = tuple(condition for condition in Condition if condition & EXCLUDING)


@dataclass(frozen=True)
class BlockQuality:
    """
    Condition of the channels over a cleaned block.

    Parameters
    ----------
    first_index, next_index : int
        Samples it is about.
    status : ndarray of uint16, shape (n_channels,)
        Bits of `Condition`, of all samples together.
    excluded : ndarray of uint32, shape (n_channels,)
        Samples left out.
    findings : tuple of Finding
        New ones.

    """

    first_index: int
    next_index: int
    status: NDArray[np.uint16]
    excluded: NDArray[np.uint32]
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class ChannelQuality:
    """
    What was left out of a channel since the begin of the stream.

    Parameters
    ----------
    name : str
        Of the sensor.
    samples, excluded : int
        Given out; of these left out.
    causes : dict from Condition to int
        Samples left out for it; a sample may have several, but counts as lost only where it has
        no other.

    """

    name: str
    samples: int
    excluded: int
    causes: dict[Condition, int]


@dataclass(frozen=True)
class QualitySummary:
    """
    Condition of all channels since the begin of the stream.

    Parameters
    ----------
    samples : int
        Judged.
    channels : tuple of ChannelQuality
        In the order of the layout.
    lost_samples, repeated_blocks, foreign_blocks, blocks_after_end : int
        Missing between blocks; blocks that came again or late, or from a second source; of the
        former, those that are new but come after the one that ends the stream.
    findings : tuple of Finding
        All faults so far, one for every channel and condition.
    gain_limits : dict of str to (float, float)
        Relative error of every checked channel's gain that would have been found, and named
        alone, with a probability of 99 %; infinite: none. Empty without a model.

    """

    samples: int
    channels: tuple[ChannelQuality, ...]
    lost_samples: int
    repeated_blocks: int
    foreign_blocks: int
    blocks_after_end: int
    findings: tuple[Finding, ...]
    gain_limits: dict[str, tuple[float, float]]


class QualityMonitor:
    """
    Give out the blocks of a stream without the samples that are at fault.

    Samples are judged in stretches that count from the begin of a run, so that the result does
    not depend on how the stream is cut into blocks. Memory does not grow.

    Parameters
    ----------
    layout : Layout
    sample_rate : float
        [Hz].
    model : Model or None
        Of the machine: cleaned samples are compared with the motion of rigid bodies, which
        tells the channels that contradict the others; None: they are not.

    """

    def __init__(
        self,
        layout: Layout,
        sample_rate: float,
        model: Model | None = None,
    ) -> None:
        self._layout = layout
        self._rate = sample_rate
        self._model = model
        self.follower = StreamFollower(replays=True)
        self._quality: tuple[BlockQuality, ...] = ()
        self._newest: SampleBlock | None = None
        self._begin()

    @property
    def quality(self) -> tuple[BlockQuality, ...]:
        """Of the blocks that the last `add` has given out."""
        return self._quality

    def add(self, block: SampleBlock) -> tuple[SampleBlock, ...]:
        """
        Take one block, give out what is judged.

        Parameters
        ----------
        block : SampleBlock

        Returns
        -------
        tuple of SampleBlock
            Values unchanged, NaN where one is left out; none while too few samples have come
            or where the block is not new data of the stream; two where a run has ended in front
            of this block: the rest of that run, and what this block completes.

        Raises
        ------
        DataError
            If the block does not have the layout's channels or sample rate.

        """
        block.require(len(self._layout.sensors), self._rate)
        self._quality = ()
        expected = self.follower.next_index
        arrival = self.follower.accept(
            block.stream_id, block.first_index, block.next_index, block.last
        )
        if not arrival.usable:
            return ()
        given: list[SampleBlock] = []
        if arrival is not Arrival.IN_ORDER:
            given += self._finish()
            if arrival is Arrival.FIRST:
                self._begin()
            else:
                self._record.add(
                    -1, Condition.GAP, expected, block.first_index, block.first_index - expected
                )
                self._after_gap = True
            self._run.restart(block.first_index)
            self._given_to = block.first_index
        self._newest = block
        self._run.append(block.samples, _flagged(block))
        given += self._give(self._run.judge(block.last), block.last)
        return tuple(given)

    def contradictions(self, without: Collection[str] = ()) -> tuple[Finding, ...]:
        """
        Tell which sensors have contradicted the motion of rigid bodies so far.

        Parameters
        ----------
        without : collection of str
            Sensors that are not used.

        Returns
        -------
        tuple of Finding

        """
        return tuple(
            finding
            for (channel, condition), finding in self._inconsistencies.items()
            if condition & CONTRADICTING and channel not in without
        )

    def compared_with(self, channel: str) -> tuple[str, ...]:
        """
        Tell which sensors see the motion that a sensor sees.

        Parameters
        ----------
        channel : str
            Name of the sensor.

        Returns
        -------
        tuple of str

        """
        return () if self._consistency is None else self._consistency.checkable[channel]

    def finish(self) -> tuple[SampleBlock, ...]:
        """
        Give out what is still held back, where a stream ends without saying so.

        Returns
        -------
        tuple of SampleBlock
            At most one; a block that follows is treated as after a gap.

        """
        if self._newest is None or self._given_to == self.follower.next_index:
            return ()
        self._quality = ()
        if self._consistency is not None:
            self._consistency.finish()
        given = tuple(self._finish())
        self._run.restart(self.follower.next_index)
        return given

    def summary(self) -> QualitySummary:
        """
        Sum up since the begin of the stream.

        Returns
        -------
        QualitySummary

        """
        return QualitySummary(
            samples=self._samples,
            channels=tuple(
                ChannelQuality(
                    sensor.name,
                    self._samples,
                    int(self._excluded[channel]),
                    {
                        cause: int(counts[channel])
                        for cause, counts in self._causes.items()
                        if counts[channel]
                    },
                )
                for channel, sensor in enumerate(self._layout.sensors)
            ),
            lost_samples=self.follower.lost_samples,
            repeated_blocks=self.follower.repeated_blocks,
            foreign_blocks=self.follower.foreign_blocks,
            blocks_after_end=self.follower.blocks_after_end,
            findings=(*self._record.findings(), *self._inconsistencies.values()),
            gain_limits=self._gain_limits(),
        )

    def _begin(self) -> None:
        """Forget everything but the settings."""
        channels = len(self._layout.sensors)
        self._run = JudgedRun(self._layout, self._rate)
        self._record = FaultRecord(self._layout, self._rate)
        self._consistency = _consistency(self._model, self._layout, self._rate)
        self._inconsistencies: dict[tuple[str, Condition], Finding] = {}
        self._told: set[tuple[str, Condition]] = set()
        self._causes = {cause: np.zeros(channels, dtype=np.int64) for cause in _CAUSES}
        self._excluded = np.zeros(channels, dtype=np.int64)
        self._samples = 0
        self._given_to = 0
        self._after_gap = False
        self._newest = None

    def _finish(self) -> list[SampleBlock]:
        """Give out the rest of the run before."""
        return self._give(self._run.judge(True), False)

    def _give(self, stretches: list[Stretch], last: bool) -> list[SampleBlock]:
        block = self._newest
        if block is None or (not stretches and not last):
            return []
        channels = len(self._layout.sensors)
        samples = np.concatenate([np.empty((0, channels)), *(one.samples for one in stretches)])
        flags = np.concatenate(
            [np.empty((0, channels), dtype=np.uint16), *(one.flags for one in stretches)]
        )
        for one in stretches:
            self._take_note(one)
        if last and self._consistency is not None:
            self._consistency.finish()
        excluded = (flags & EXCLUDING) != 0
        if excluded.any():
            samples[excluded] = np.nan
        first_index, self._given_to = self._given_to, self._given_to + len(samples)
        status = np.bitwise_or.reduce(flags, axis=0)
        for one in stretches:
            status |= one.standing
        for finding in self._inconsistent():
            status[self._channel(finding)] |= np.uint16(finding.condition)
        if self._after_gap:
            status |= np.uint16(Condition.GAP)
            self._after_gap = False
        self._quality = (
            *self._quality,
            BlockQuality(
                first_index,
                self._given_to,
                status,
                excluded.sum(axis=0).astype(np.uint32),
                (*self._record.news(), *self._new_inconsistent()),
            ),
        )
        missing = np.isnan(samples).any(axis=0)
        return [
            replace(
                block,
                stamp_ns=stamp_after(block.stamp_ns, first_index - block.first_index, self._rate),
                first_index=first_index,
                samples=samples,
                channel_status=np.where(missing, ChannelStatus.MISSING_SAMPLES, 0).astype(np.uint8)
                | np.where(status & Condition.SATURATED, ChannelStatus.SATURATED, 0).astype(
                    np.uint8
                ),
                last=last,
            )
        ]

    def _take_note(self, one: Stretch) -> None:
        """Count, and tell findings from the flags of a stretch."""
        self._samples += len(one.flags)
        if self._consistency is not None and len(one.samples):
            cleaned = np.where(one.flags & EXCLUDING, np.nan, one.samples)
            self._consistency.add(one.first_index, cleaned)
        for condition in bits_set(one.flags):
            flagged = (one.flags & condition) != 0
            counts = flagged.sum(axis=0)
            if condition is Condition.LOST:
                others = EXCLUDING & ~Condition.LOST
                self._causes[condition] += (flagged & ((one.flags & others) == 0)).sum(axis=0)
            elif condition in self._causes:
                self._causes[condition] += counts
            everywhere = condition is Condition.REPEAT
            for channel in [-1] if everywhere else np.flatnonzero(counts).tolist():
                rows = np.flatnonzero(flagged[:, channel])
                self._record.add(
                    channel,
                    condition,
                    one.first_index + int(rows[0]),
                    one.first_index + int(rows[-1]) + 1,
                    rows.size,
                    one.amounts.get((channel, condition), float('nan')),
                )
        self._excluded += ((one.flags & EXCLUDING) != 0).sum(axis=0)
        for condition in bits_set(one.standing):
            for channel in np.flatnonzero(one.standing & condition).tolist():
                self._record.add(
                    channel,
                    condition,
                    one.first_index,
                    one.first_index + len(one.flags),
                    len(one.flags),
                    one.amounts[channel, condition],
                )

    def _inconsistent(self) -> tuple[Finding, ...]:
        return () if self._consistency is None else self._consistency.findings()

    def _gain_limits(self) -> dict[str, tuple[float, float]]:
        watch = self._consistency
        if watch is None:
            return {}
        limits = watch.least_gain_limits
        return {name: limits[name] for name, others in watch.checkable.items() if others}

    def _new_inconsistent(self) -> tuple[Finding, ...]:
        """Tell those that did not stand before."""
        standing = self._inconsistent()
        keys = {(finding.channel, finding.condition) for finding in standing}
        news = tuple(one for one in standing if (one.channel, one.condition) not in self._told)
        self._told = keys
        for one in standing:
            self._inconsistencies[one.channel, one.condition] = one
        return news

    def _channel(self, finding: Finding) -> int:
        names = [sensor.name for sensor in self._layout.sensors]
        return names.index(finding.channel)


def monitored(blocks: Iterable[SampleBlock], monitor: QualityMonitor) -> Iterator[SampleBlock]:
    """
    Clean a stream.

    Parameters
    ----------
    blocks : iterable of SampleBlock
    monitor : QualityMonitor

    Yields
    ------
    SampleBlock

    """
    for block in blocks:
        yield from monitor.add(block)
    yield from monitor.finish()


def _flagged(block: SampleBlock) -> NDArray[np.bool_]:
    """Channels that the source says to be saturated."""
    return np.asarray((block.channel_status & ChannelStatus.SATURATED) != 0)


def _consistency(model: Model | None, layout: Layout, sample_rate: float) -> Consistency | None:
    if model is None:
        return None
    return Consistency(model, layout, sample_rate)
