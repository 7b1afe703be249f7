# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What every source of samples offers."""

from collections.abc import Iterator
from enum import Enum
from typing import Protocol

from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.sources.device_state import DeviceState
from identnl_ros.storage.stand_description import StandDescription


class Timing(Enum):
    """Who sets the pace of a source, and what its time stamps count from."""

    SIMULATED = 'simulated'
    """Blocks as fast as they are asked for, stamps from any origin; published as of now."""
    RECORDED = 'recorded'
    """Blocks as fast as they are asked for, with the stamps of the recording."""
    LIVE = 'live'
    """Blocks as they happen, with the stamps of the acquisition: a `LiveSource`."""


class Source(Protocol):
    """
    A source of synchronised samples.

    The last block of a stream that ends is marked `last`. Unless the source is live, whoever
    publishes the blocks sets the pace by their time stamps.

    """

    @property
    def timing(self) -> Timing:
        """Who sets the pace."""
        ...

    @property
    def description(self) -> StandDescription:
        """What the channels of the blocks are."""
        ...

    def blocks(self) -> Iterator[SampleBlock]:
        """Yield the blocks of the stream in order."""
        ...


class LiveSource(Source, Protocol):
    """
    A source that goes on until it is told to end, whether anybody takes its blocks or not.

    Its blocks are taken as they come, and dropped where they cannot be used.

    """

    def end(self) -> None:
        """
        Ask for the end, from any thread; does not wait for it.

        The iterator of `blocks` ends within a second with a block marked `last`, which may be
        without samples.

        """
        ...

    @property
    def devices(self) -> tuple[DeviceState, ...]:
        """How its devices are."""
        ...
