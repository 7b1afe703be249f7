# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A stream of a bag judged as a whole before any of it is used."""

from collections.abc import Collection, Iterable

from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.quality.condition import Finding
from identnl_ros.core.quality.monitor import monitored, QualityMonitor, QualitySummary
from identnl_ros.core.quality.stamp_check import StampCheck
from identnl_ros.storage.bag_reader import Bag
from identnl_ros.storage.stand_description import StandDescription

# Readings that are kept in memory (256 MB); of more, the samples are judged once again as they
# are used.
MOST_READINGS = 2**25


class JudgedStream:
    """
    The samples of a stream without those at fault, known before the first one is used.

    Parameters
    ----------
    bag : Bag
    stream : StandDescription
    model : Model
        Of the machine, to find sensors that contradict the motion of rigid bodies.

    Raises
    ------
    IdentnlError
        If the blocks or the layout do not fit.

    """

    def __init__(self, bag: Bag, stream: StandDescription, model: Model) -> None:
        self.stream = stream
        self._bag = bag
        self._monitor = QualityMonitor(stream.layout, stream.sample_rate, model)
        self._kept: list[SampleBlock] | None = []
        readings = 0
        stamps = StampCheck(stream.sample_rate)
        for block in monitored(stamps.watched(bag.blocks(stream.stream_id)), self._monitor):
            readings += block.samples.size
            if readings > MOST_READINGS:
                self._kept = None
            if self._kept is not None:
                self._kept.append(block)
        self.summary: QualitySummary = self._monitor.summary()
        self.stamps = stamps.findings()

    def contradictions(self, without: Collection[str] = ()) -> tuple[Finding, ...]:
        """
        Tell which sensors contradict the motion of rigid bodies.

        Parameters
        ----------
        without : collection of str
            Sensors that are not used.

        Returns
        -------
        tuple of Finding

        """
        return self._monitor.contradictions(without)

    def believed_against(self, channel: str, unused: Collection[str]) -> tuple[str, ...]:
        """
        Tell on whose word a sensor is left out.

        Parameters
        ----------
        channel : str
            Name of the sensor.
        unused : collection of str
            Sensors that are not used.

        Returns
        -------
        tuple of str

        """
        return tuple(one for one in self._monitor.compared_with(channel) if one not in unused)

    def blocks(self) -> Iterable[SampleBlock]:
        """
        Give the samples that are not at fault, the same each time.

        Returns
        -------
        iterable of SampleBlock

        """
        if self._kept is not None:
            return self._kept
        again = QualityMonitor(self.stream.layout, self.stream.sample_rate)
        return monitored(self._bag.blocks(self.stream.stream_id), again)
