# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Reading of bags: any ROS 2 bag that holds sample blocks and their description."""

from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from types import SimpleNamespace
from typing import TypeVar

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.storage.bag_files import open_files
from identnl_ros.storage.message_reading import (
    block_from_message,
    description_from_message,
    estimate_from_message,
    RecordedEstimate,
)
from identnl_ros.storage.message_types import ESTIMATES, SAMPLE_BLOCK, STAND_DESCRIPTION
from identnl_ros.storage.recorded_channel import Problems, RecordedMessage
from identnl_ros.storage.stand_description import StandDescription

_Value = TypeVar('_Value')


class Bag:
    """
    A bag with the samples of one or more streams; made by `open_bag`.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If the path is not a bag or the bag holds no samples.

    """

    def __init__(self, path: Path) -> None:
        """Find the topics and the descriptions."""
        self.path = path
        self._problems = Problems()
        self._files = open_files(path, self._problems)
        self._streams: dict[int, StandDescription] = {}
        for message in self._messages((STAND_DESCRIPTION,), quick=True):
            self._add_description(message)
        self._check_is_usable()

    @property
    def streams(self) -> tuple[StandDescription, ...]:
        """Descriptions of all streams in the order of recording."""
        return tuple(self._streams.values())

    @property
    def description(self) -> StandDescription:
        """Description of the first stream; most bags hold one only."""
        return next(iter(self._streams.values()))

    @property
    def topics(self) -> dict[str, str]:
        """Message types by topic."""
        return {
            channel.topic: channel.type_name for file in self._files for channel in file.channels
        }

    @property
    def problems(self) -> list[str]:
        """What was found wrong so far, in sentences; complete after `blocks` has ended."""
        return self._problems.sentences()

    @property
    def damage(self) -> str:
        """The `problems` as the end of a sentence; empty: none so far."""
        return ''.join(f'; {sentence}' for sentence in self.problems)

    def metadata(self, name: str) -> dict[str, str] | None:
        """
        Find a metadata record.

        Parameters
        ----------
        name : str

        Returns
        -------
        dict of str or None
            None: the bag has none of this name.

        """
        for file in self._files:
            if name in file.metadata:
                return file.metadata[name]
        return None

    def blocks(self, stream_id: int | None = None) -> Iterator[SampleBlock]:
        """
        Read the blocks in the order of recording; only one part of the file is in memory.

        Damaged blocks are left out and become `problems`.

        Parameters
        ----------
        stream_id : int or None
            None: blocks of all streams, as they come.

        Yields
        ------
        SampleBlock

        """
        for message in self._messages((STAND_DESCRIPTION, SAMPLE_BLOCK)):
            if message.channel.type_name == STAND_DESCRIPTION:
                self._add_description(message)
                continue
            block = self._convert(message, block_from_message)
            if (
                block is not None
                and self._is_described(block)
                and stream_id in (None, block.stream_id)
            ):
                yield block

    def _messages(self, types: tuple[str, ...], quick: bool = False) -> Iterator[RecordedMessage]:
        try:
            for file in self._files:
                yield from file.scan(types) if quick else file.messages(types)
        except OSError as error:
            raise DataError(
                f'{self.path} cannot be read any more: {error.strerror or error}; '
                'check the medium and whether the file was moved'
            ) from None

    def _add_description(self, message: RecordedMessage) -> None:
        description = self._convert(message, description_from_message)
        if description is not None:
            self._streams.setdefault(description.stream_id, description)

    def _is_described(self, block: SampleBlock) -> bool:
        description = self._streams.get(block.stream_id)
        if description is None:
            self._problems.add(
                f'{self.path}: blocks of a stream without a description were left out',
                f'stream {block.stream_id}',
            )
            return False
        found, expected = block.samples.shape[1], len(description.layout.sensors)
        if found != expected:
            self._problems.add(
                f'{self.path}: blocks whose channels do not fit the description were left out',
                f'block {block.first_index} has {found} channels, expected {expected}',
            )
        return bool(found == expected)

    def _convert(
        self, message: RecordedMessage, convert: Callable[[SimpleNamespace], _Value]
    ) -> _Value | None:
        """Decode a message; a damaged one becomes a problem."""
        try:
            return convert(message.channel.decode(message.data))
        except (DataError, AttributeError) as error:
            self._problems.add(
                f'{self.path}: a message on {message.channel.topic} was left out',
                f'at {message.log_time_ns} ns: {error}',
            )
            return None

    def _check_is_usable(self) -> None:
        channels = [channel for file in self._files for channel in file.channels]
        types = {channel.type_name for channel in channels}
        missing = [name for name in (STAND_DESCRIPTION, SAMPLE_BLOCK) if name not in types]
        if missing:
            found = ', '.join(
                sorted({f'{channel.topic} ({channel.type_name})' for channel in channels})
            )
            raise DataError(
                f'{self.path} is not a recording of a stand: found {found or "no topics"}, '
                f'expected also {" and ".join(missing)}{self.damage}'
            )
        if not self._streams:
            raise DataError(
                f'{self.path} has the topic of the stand description but no readable message '
                f'on it, so the channels are not known{self.damage}'
            )


def open_bag(path: str | PathLike[str]) -> Bag:
    """
    Open a bag for reading.

    Parameters
    ----------
    path : path
        An MCAP or SQLite file, or a folder as `ros2 bag` makes it.

    Returns
    -------
    Bag

    Raises
    ------
    DataError
        If the path is not a bag or the bag holds no samples.

    """
    return Bag(Path(path))


def read_estimates(path: str | PathLike[str]) -> Iterator[RecordedEstimate]:
    """
    Read the estimates that were published while a bag was recorded.

    Parameters
    ----------
    path : path
        As for `open_bag`; the bag need not hold samples.

    Yields
    ------
    RecordedEstimate
        In the order of recording; damaged ones are left out.

    Raises
    ------
    DataError
        If the path is not a bag.

    """
    for file in open_files(Path(path), Problems()):
        for message in file.messages((ESTIMATES,)):
            try:
                yield estimate_from_message(
                    message.channel.topic, message.channel.decode(message.data)
                )
            except (DataError, AttributeError):
                continue
