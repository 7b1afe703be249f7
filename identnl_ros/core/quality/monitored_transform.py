# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensor blocks to body motion without the samples that are at fault."""

from collections.abc import Collection
from dataclasses import replace

from identnl_ros.core.measurement.blocks import MotionBlock, SampleBlock
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.quality.monitor import BlockQuality, QualityMonitor


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
        self._judged: tuple[tuple[SampleBlock, BlockQuality], ...] = ()

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
        return tuple(one.sentence for one in self.monitor.contradictions(self._without))

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
        return self._mapped(self.monitor.add(block))

    def finish(self) -> tuple[MotionBlock, ...]:
        """
        Give out what is still held back, where a stream ends without saying so.

        Returns
        -------
        tuple of MotionBlock

        """
        cleaned = self.monitor.finish()
        return self._mapped(cleaned) if cleaned else ()

    def _mapped(self, cleaned: tuple[SampleBlock, ...]) -> tuple[MotionBlock, ...]:
        self._judged = tuple(zip(cleaned, self.monitor.quality, strict=True))
        motions = []
        contradictions = self.contradictions
        for one in cleaned:
            motion = self.transform.add(one)
            if motion is not None:
                motions.append(replace(motion, contradictions=contradictions))
        return tuple(motions)
