# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A bag as a source of samples."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.sources.setting import Setting
from identnl_ros.sources.source import Timing
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.stand_description import StandDescription


class BagSource:
    """
    The stream recorded in a bag.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If there is no readable bag of a stand.

    """

    timing = Timing.RECORDED

    def __init__(self, path: Path) -> None:
        self._bag = open_bag(path)

    @property
    def description(self) -> StandDescription:
        """What the channels of the blocks are."""
        return self._bag.description

    def blocks(self) -> Iterator[SampleBlock]:
        """Yield the blocks in the order of recording, the very last one marked so."""
        previous = None
        for block in self._bag.blocks(self.description.stream_id):
            if previous is not None:
                yield previous
            previous = block
        if previous is not None:
            yield replace(previous, last=True)


class BagChoice:
    """Opens the bag that its setting names."""

    settings = (
        Setting(
            'bag', '', 'Bag to replay: an MCAP or SQLite file, or a folder with metadata.yaml.'
        ),
    )

    def make(self, setting: Callable[[str], Any]) -> BagSource:
        """
        Make the source.

        Parameters
        ----------
        setting : callable
            Gives the value of a setting by its name.

        Returns
        -------
        BagSource

        Raises
        ------
        DataError
            If no bag is named, or it cannot be read.

        """
        if not setting('bag'):
            raise DataError('parameter bag is empty; give the path of the bag to replay')
        return BagSource(Path(setting('bag')))


source = BagChoice()
