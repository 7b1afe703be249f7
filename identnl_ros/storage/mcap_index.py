# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Where the parts of an MCAP file are: by the index at its end, or by walking through it."""

from dataclasses import dataclass, field
from typing import BinaryIO
import zlib

from identnl_ros.storage.mcap_records import (
    DamageError,
    FieldReader,
    FOOTER_SIZE,
    HEAD,
    MAGIC,
    Opcode,
    split_records,
)

LARGEST_RUN = 2**20  # [bytes] messages outside of chunks that are read at once
LARGEST_INDEX = 2**28  # [bytes]


@dataclass
class Part:
    """
    A part of a file that is read at once.

    Parameters
    ----------
    start, end : int
        Position in the file [bytes].
    is_chunk : bool
        One chunk, else a run of records.
    cut : bool
        The end of its last record is missing.
    channels : set of int
        Channels that have messages in it; empty: not known.

    """

    start: int
    end: int
    is_chunk: bool
    cut: bool = False
    channels: set[int] = field(default_factory=set)


@dataclass
class Contents:
    """
    What is where in a file.

    Parameters
    ----------
    parts : list of Part
        Hold schemas, channels and messages; in the order of the file.
    metadata : list of tuple of int
        Start and end of metadata records [bytes].
    cut_at : int or None
        Where the last complete record ends if the file is cut [bytes].
    data_ended : bool
        What is missing of a cut file is index only.
    damaged_at : int or None
        Where the file cannot be followed further because of damage [bytes].
    index_damaged : bool
        The index at the end has a wrong check sum.

    """

    parts: list[Part] = field(default_factory=list)
    metadata: list[tuple[int, int]] = field(default_factory=list)
    cut_at: int | None = None
    data_ended: bool = False
    damaged_at: int | None = None
    index_damaged: bool = False


def find_contents(stream: BinaryIO, size: int) -> Contents:
    """
    Find all parts of a file.

    Parameters
    ----------
    stream : file
    size : int
        Of the file [bytes].

    Returns
    -------
    Contents

    """
    try:
        contents = _by_index(stream, size)
    except DamageError:
        contents = _by_walking(stream, size)
        contents.index_damaged = True
        return contents
    return contents or _by_walking(stream, size)


def read_at(stream: BinaryIO, start: int, end: int) -> memoryview:
    """
    Read a range of a file.

    Parameters
    ----------
    stream : file
    start, end : int
        [bytes].

    Returns
    -------
    memoryview
        Less than asked for at the end of the file.

    """
    stream.seek(start)
    return memoryview(stream.read(max(end - start, 0)))


def _by_index(stream: BinaryIO, size: int) -> Contents | None:
    """Use the index; None: there is none, or it does not list everything."""
    footer_start = size - FOOTER_SIZE - len(MAGIC)
    tail = read_at(stream, footer_start, size) if footer_start > 0 else memoryview(b'')
    if not tail or HEAD.unpack_from(tail) != (Opcode.FOOTER, 20) or tail[-8:] != MAGIC:
        return None
    footer = FieldReader(tail[HEAD.size :])
    start, _, crc = footer.number('Q'), footer.number('Q'), footer.number('I')
    if start == 0:
        return None
    if not 0 < start <= footer_start or footer_start - start > LARGEST_INDEX:
        raise DamageError('the footer is damaged')
    data = read_at(stream, start, footer_start)
    if crc and zlib.crc32(tail[: HEAD.size + 16], zlib.crc32(data)) != crc:
        raise DamageError('the check sum of the index is wrong')

    contents = Contents()
    counts = None
    for opcode, record in split_records(data):
        fields = FieldReader(record)
        if opcode == Opcode.CHUNK_INDEX:
            fields.number('Q'), fields.number('Q')
            part = Part(fields.number('Q'), 0, is_chunk=True)
            part.end = part.start + fields.number('Q')
            offsets = FieldReader(fields.bytes(fields.number('I')))
            while offsets.remains():
                part.channels.add(offsets.number('H'))
                offsets.number('Q')
            contents.parts.append(part)
        elif opcode == Opcode.METADATA_INDEX:
            position = fields.number('Q')
            contents.metadata.append((position, position + fields.number('Q')))
        elif opcode == Opcode.STATISTICS:
            messages, _, _ = fields.number('Q'), fields.number('H'), fields.number('I')
            _, n_metadata, n_chunks = (fields.number('I') for _ in range(3))
            counts = (n_chunks, n_metadata)
            if messages and not n_chunks:
                return None
    for position, end in [(part.start, part.end) for part in contents.parts] + contents.metadata:
        if not len(MAGIC) <= position < position + HEAD.size <= end <= start:
            raise DamageError('the index points out of the file')
    if counts != (len(contents.parts), len(contents.metadata)):
        return None
    contents.parts.sort(key=lambda part: part.start)
    # Schemas and channels are repeated here: known even if their chunk is damaged
    contents.parts.insert(0, Part(start, footer_start, is_chunk=False))
    return contents


def _by_walking(stream: BinaryIO, size: int) -> Contents:
    """Go from record to record."""
    contents = Contents()
    parts = contents.parts
    position = len(MAGIC)
    while True:
        head = read_at(stream, position, position + HEAD.size)
        if len(head) < HEAD.size:
            contents.cut_at = position
            return contents
        opcode, length = HEAD.unpack(head)
        end = position + HEAD.size + length
        if opcode == 0 or Opcode.DATA_END < opcode < Opcode.FIRST_PRIVATE:
            contents.damaged_at = position
            return contents
        if opcode == Opcode.FOOTER:
            if end > size or read_at(stream, end, size) != MAGIC:
                contents.cut_at = position
            return contents
        is_chunk = opcode == Opcode.CHUNK
        if end > size:
            contents.cut_at = position
            if is_chunk:
                parts.append(Part(position, size, is_chunk, cut=True))
            return contents
        if is_chunk:
            parts.append(Part(position, end, is_chunk))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            if not contents.data_ended:  # what is repeated in an index may be damaged
                _extend(parts, position, end)
        elif opcode == Opcode.METADATA:
            contents.metadata.append((position, end))
        elif opcode == Opcode.MESSAGE_INDEX and length >= 2 and parts:
            index = FieldReader(read_at(stream, position + HEAD.size, position + HEAD.size + 2))
            parts[-1].channels.add(index.number('H'))
        elif opcode == Opcode.DATA_END:
            contents.data_ended = True
        position = end


def _extend(parts: list[Part], start: int, end: int) -> None:
    """Add a record outside of chunks to the last run, or begin another."""
    last = parts[-1] if parts else Part(0, 0, is_chunk=True)
    if not last.is_chunk and last.end == start and end - last.start <= LARGEST_RUN:
        last.end = end
    else:
        parts.append(Part(start, end, is_chunk=False))
