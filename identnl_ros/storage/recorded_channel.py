# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What all kinds of bag files have in common: channels, messages and what went wrong."""

from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace

from identnl_ros.core.errors import DataError
from identnl_ros.storage.cdr import MessageDecoder


@dataclass(frozen=True)
class RecordedChannel:
    """
    A topic in a bag file.

    Parameters
    ----------
    topic : str
    type_name : str
        E.g. ``identnl_msgs/msg/SampleBlock``.
    definition : str
        Of the message type, as the file has it; empty: the file has none.
    compressed : bool
        Every message is compressed by itself (zstd).

    """

    topic: str
    type_name: str
    definition: str
    compressed: bool = False

    def decode(self, data: bytes | memoryview) -> SimpleNamespace:
        """
        Read a message of this channel.

        Parameters
        ----------
        data : bytes or memoryview
            CDR.

        Returns
        -------
        SimpleNamespace
            An attribute for each field.

        Raises
        ------
        DataError
            If the message is damaged or its type is not known.

        """
        if self.compressed:
            data = _decompress(data)
        return _decoder(self.type_name, self.definition).decode(data)


@dataclass(frozen=True)
class RecordedMessage:
    """
    A message in a bag file, not yet decoded.

    Parameters
    ----------
    channel : RecordedChannel
    log_time_ns : int
        When it was recorded [ns].
    data : bytes or memoryview
        CDR.

    """

    channel: RecordedChannel
    log_time_ns: int
    data: bytes | memoryview


class Problems:
    """What is wrong with a bag but did not keep it from being read."""

    def __init__(self) -> None:
        """Start without a problem."""
        self._places: dict[str, dict[str, None]] = {}

    def add(self, what: str, where: str) -> None:
        """
        Note a problem; noting the same one again changes nothing.

        Parameters
        ----------
        what : str
            What is wrong and what was done about it.
        where : str
            The place or the details.

        """
        self._places.setdefault(what, {})[where] = None

    def sentences(self) -> list[str]:
        """
        Tell the problems, one sentence for each kind.

        Returns
        -------
        list of str

        """
        return [
            f'{what} ({next(iter(places))})'
            if len(places) == 1
            else f'{what} ({len(places)} times, first: {next(iter(places))})'
            for what, places in self._places.items()
        ]


def _decompress(data: bytes | memoryview) -> bytes:
    import zstandard

    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError as error:
        raise DataError(f'a compressed message is damaged: {error}') from None


@lru_cache(maxsize=64)
def _decoder(type_name: str, definition: str) -> MessageDecoder:
    if not definition:
        from identnl_ros.storage.message_types import definition_text

        definition = definition_text(type_name)
    return MessageDecoder(type_name, definition)
