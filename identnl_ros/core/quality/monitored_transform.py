# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensor blocks to body motion without the samples that are at fault."""

from collections.abc import Collection

from identnl_ros.core.measurement.blocks import MotionBlock, SampleBlock
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.monitor import BlockQuality, QualityMonitor
from dataclasses import replace

# A channel with these falsifies what is learned from it.
CONTRADICTING = Condition.INVERTED | Condition.SWAPPED | Condition.GAIN


class MonitoredTransform:
    """
    Judge the samples, leave bad ones out, map the others to the motion of the bodies.

    Nodes and commands read streams by way of it, so that both leave out the same samples.

    Parameters
    ----------
    model : Model
    layout : Layout
    sample_rate : float
        [Hz].
    without : collection of str
        Names of sensors that are not to be used.

    Raises
    ------
    LayoutError
        If the sensors do not fit the machine or do not see every coordinate, or one that is not
        to be used does not exist.

    """

    def __init__(
        self, model: Model, layout: Layout, sample_rate: float, without: Collection[str] = ()
    ) -> None:
        self.transform = MotionTransform(model, layout, sample_rate, without)
        self.monitor = QualityMonitor(layout, sample_rate, model)
        self._without = frozenset(without)
        self._contradictions: dict[tuple[str, Condition], str] = {}

    @property
    def follower(self) -> StreamFollower:
        """Judge of the blocks."""
        return self.monitor.follower

    @property
    def quality(self) -> tuple[tuple[SampleBlock, BlockQuality], ...]:
        """Cleaned blocks that the last `add` has made, and the condition of their channels."""
        return self._judged

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Sensors in use that have contradicted the motion of rigid bodies so far, in words."""
        return tuple(self._contradictions.values())

    def add(self, block: SampleBlock) -> tuple[MotionBlock, ...]:
        """
        Take one block, give out the motion that it completes.

        Parameters
        ----------
        block : SampleBlock

        Returns
        -------
        tuple of MotionBlock
            Mostly one; none while too few samples have come, or where the block is not new data
            of the stream (`follower` counts why).

        Raises
        ------
        DataError
            If the block does not have the layout's channels or sample rate.

        """
        cleaned = self.monitor.add(block)
        self._judged = tuple(zip(cleaned, self.monitor.quality, strict=True))
        motions = []
        for one, quality in self._judged:
            self._take_note(quality)
            motion = self.transform.add(one)
            if motion is not None:
                motions.append(replace(motion, contradictions=self.contradictions))
        return tuple(motions)

    def _take_note(self, quality: BlockQuality) -> None:
        for finding in quality.findings:
            if finding.condition & CONTRADICTING and finding.channel not in self._without:
                self._contradictions.setdefault(
                    (finding.channel, finding.condition), finding.sentence
                )
