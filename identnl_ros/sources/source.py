# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What every source of samples offers."""

from collections.abc import Iterator
from typing import Protocol

from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.storage.stand_description import StandDescription


class Source(Protocol):
    """
    A source of synchronised samples.

    A source yields blocks as fast as it is asked; whoever publishes them sets the pace by the
    blocks' time stamps. The last block of a stream that ends is marked `last`.

    """

    @property
    def description(self) -> StandDescription:
        """What the channels of the blocks are."""
        ...

    def blocks(self) -> Iterator[SampleBlock]:
        """Yield the blocks of the stream in order."""
        ...
