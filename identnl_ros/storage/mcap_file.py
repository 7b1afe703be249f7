# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
An MCAP file read so that all sound messages are kept and all damage is told.

The `mcap` package knows what is in a record. Its readers, though, trust every length they find
and end at the first damage; so the way from record to record is found here.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
import struct
from typing import BinaryIO
import zlib

from identnl_ros.core.errors import DataError
from identnl_ros.storage.recorded_channel import Problems, RecordedChannel, RecordedMessage
import lz4.frame  # type: ignore[import-untyped]
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream, StreamReader
import zstandard

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')  # opcode and length of a record
FOOTER_LENGTH = 20
RUN = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
KNOWN = (*RUN, Opcode.CHUNK_INDEX, Opcode.METADATA_INDEX, Opcode.STATISTICS)
FIRST_PRIVATE = 0x80  # opcode

LARGEST = 2**30  # [bytes] value, chunk or index
LARGEST_RUN = 2**20  # [bytes] records outside of chunks that damage to one of them costs

# What the libraries raise on damaged bytes
DAMAGE = (
    *(McapError, zstandard.ZstdError, struct.error),
    *(ValueError, OverflowError, RuntimeError, MemoryError),
)


@dataclass
class _Part:
    """A chunk, a metadata record or a run (kind 0) of records; no channels: not known which."""

    start: int
    end: int
    kind: int = 0
    channels: set[int] = field(default_factory=set)
    cut: bool = False


class McapFile:
    """
    One MCAP file.

    Parameters
    ----------
    path : Path
    problems : Problems
        Damage found on opening and reading is noted here.
    compressed : bool
        Every message is compressed by itself.

    Raises
    ------
    DataError
        If it is not an MCAP file.

    """

    def __init__(self, path: Path, problems: Problems, compressed: bool = False) -> None:
        """Find the parts of the file."""
        self._path = path
        self._problems = problems
        self._compressed = compressed
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, RecordedChannel] = {}
        self._parts: list[_Part] = []
        self.metadata: dict[str, dict[str, str]] = {}
        with path.open('rb') as stream:
            size = path.stat().st_size
            if stream.read(len(MAGIC)) != MAGIC:
                stream.seek(max(size - len(MAGIC), 0))
                if stream.read() != MAGIC:
                    raise DataError(f'{path} is not an MCAP file: it does not begin as one')
                self._tell(': the first bytes are damaged; nothing is lost', 'byte 0')
            try:
                has_index = self._follow_index(stream, size)
            except DAMAGE as error:
                has_index = False
                self._tell(': the index is damaged; the file was read without it', error)
            if not has_index:
                self._walk(stream, size)

    @property
    def channels(self) -> list[RecordedChannel]:
        """Channels met so far; all of them after `scan`."""
        return list(self._channels.values())

    def scan(self, types: Collection[str]) -> Iterator[RecordedMessage]:
        """Find all channels and the messages of rare types, without reading the whole file."""
        return self._messages(types, quick=True)

    def messages(self, types: Collection[str]) -> Iterator[RecordedMessage]:
        """Read all messages of some message types in the order of the file."""
        return self._messages(types, quick=False)

    def _messages(self, types: Collection[str], quick: bool) -> Iterator[RecordedMessage]:
        with self._path.open('rb') as stream:
            for part in self._parts:
                if quick and not self._may_hold(part, types):
                    continue
                try:
                    for record in _records(stream, part):
                        if not isinstance(record, records.Message):
                            self._keep(record)
                            continue
                        channel = self._channels.get(record.channel_id)
                        if channel is not None and channel.type_name in types:
                            yield RecordedMessage(channel, record.log_time, record.data)
                except DAMAGE as error:
                    # If nothing of a cut chunk is complete, it is told that the file is cut
                    if not part.cut or isinstance(error, CRCValidationError):
                        where = f'bytes {part.start} to {part.end}: {error}'
                        self._tell(': a damaged part was left out', where)

    def _may_hold(self, part: _Part, types: Collection[str]) -> bool:
        if not part.channels or not part.channels <= self._channels.keys():
            return True
        return any(self._channels[number].type_name in types for number in part.channels)

    def _keep(self, record: records.McapRecord) -> None:
        """Remember what is not a message."""
        if isinstance(record, records.Schema):
            text = record.data.decode('utf-8', 'replace') if record.encoding == 'ros2msg' else ''
            self._schemas[record.id] = (record.name, text)
        elif isinstance(record, records.Channel):
            name, text = self._schemas.get(record.schema_id, ('', ''))
            if record.message_encoding != 'cdr':
                name = f'{name} as {record.message_encoding}'
            channel = RecordedChannel(record.topic, name, text, self._compressed)
            self._channels[record.id] = channel
        elif isinstance(record, records.Metadata):
            self.metadata.setdefault(record.name, record.metadata)

    def _follow_index(self, stream: BinaryIO, size: int) -> bool:
        """Find all parts by the index; False: there is none, or it does not list everything."""
        end = size - HEAD.size - FOOTER_LENGTH - len(MAGIC)
        stream.seek(max(end, 0))
        tail = stream.read()
        if not tail.startswith(HEAD.pack(Opcode.FOOTER, FOOTER_LENGTH)) or tail[-8:] != MAGIC:
            return False
        footer = records.Footer.read(ReadDataStream(BytesIO(tail[HEAD.size :])))
        index = _Part(footer.summary_start, end)
        if index.start == 0:
            return False
        crc = zlib.crc32(_take(stream, index.start, end))
        crc = zlib.crc32(tail[: HEAD.size + FOOTER_LENGTH - 4], crc)
        if footer.summary_crc not in (0, crc):
            raise CRCValidationError(footer.summary_crc, crc, footer)
        parts: list[_Part] = []
        counts: object = None
        for record in _records(stream, index):
            if isinstance(record, records.ChunkIndex):
                start, channels = record.chunk_start_offset, set(record.message_index_offsets)
                parts.append(_Part(start, start + record.chunk_length, Opcode.CHUNK, channels))
            elif isinstance(record, records.MetadataIndex):
                parts.append(_Part(record.offset, record.offset + record.length, Opcode.METADATA))
            elif isinstance(record, records.Statistics):
                counts = (record.chunk_count, record.metadata_count)
                if record.message_count and not record.chunk_count:
                    return False
        kinds = [part.kind for part in parts]
        if counts != (kinds.count(Opcode.CHUNK), kinds.count(Opcode.METADATA)):
            return False
        for part in parts:
            if not len(MAGIC) <= part.start < part.start + HEAD.size <= part.end <= index.start:
                raise EndOfFile('it points out of the file')
        # Schemas and channels are repeated in the index: known even if their chunk is damaged
        self._parts = [index, *sorted(parts, key=lambda part: part.start)]
        return True

    def _walk(self, stream: BinaryIO, size: int) -> None:
        """Find all parts by going from record to record."""
        parts, position = self._parts, len(MAGIC)
        kept = 'all complete messages before the end were kept'
        for opcode, start, end in _heads(stream, position, size):
            if opcode == 0 or Opcode.DATA_END < opcode < FIRST_PRIVATE:
                self._tell(' is damaged and could not be read further', f'byte {position}')
                return
            if end > size or opcode == Opcode.FOOTER:
                stream.seek(min(end, size))
                if opcode == Opcode.FOOTER and stream.read() == MAGIC:
                    return
                if opcode == Opcode.CHUNK:
                    end = min(size, position + LARGEST)
                    parts.append(_Part(position, end, opcode, cut=True))
                break
            if opcode in (Opcode.CHUNK, Opcode.METADATA):
                parts.append(_Part(position, end, opcode))
            elif opcode == Opcode.MESSAGE_INDEX and end - start >= 2 and parts:
                parts[-1].channels.add(ReadDataStream(stream).read2())
            elif opcode == Opcode.DATA_END:
                kept = 'only its index is missing, no message is lost'
            elif opcode in RUN and 'index' not in kept:  # the index may be damaged
                last = parts[-1] if parts else _Part(0, 0)
                if last.kind or last.end != position or end - last.start > LARGEST_RUN:
                    parts.append(_Part(position, end))
                else:
                    last.end = end
            position = end
        where = f'last complete record ends at byte {position}'
        self._tell(f' was cut off or never closed; {kept}', where)

    def _tell(self, what: str, where: object) -> None:
        self._problems.add(f'{self._path}{what}', str(where) or type(where).__name__)


class _RecordStream(BytesIO):
    """One record; gives exactly as many bytes as are asked for, or none."""

    def read(self, length: int | None = -1, /) -> bytes:
        """Read bytes."""
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile(f'{length} bytes expected where {len(data)} are left')
        return data


def _take(stream: BinaryIO, start: int, end: int) -> bytes:
    if not 0 <= start <= end <= start + LARGEST:
        raise EndOfFile(f'bytes {start} to {end} cannot be a part of the file')
    stream.seek(start)
    return stream.read(end - start)


def _heads(stream: BinaryIO, position: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the content of each record; one that is cut ends after `end`."""
    while position < end:
        stream.seek(position)
        head = stream.read(min(HEAD.size, end - position))
        opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (Opcode.HEADER, end)
        start = position + HEAD.size
        position = start + length
        yield opcode, start, position


def _records(stream: BinaryIO, part: _Part) -> Iterator[records.McapRecord]:
    """Read the records of a part, of a cut one those that are complete."""
    start, end = part.start, part.end
    if part.kind == Opcode.METADATA:
        record = _RecordStream(_take(stream, start + HEAD.size, end))
        yield records.Metadata.read(ReadDataStream(record))
        return
    if part.kind == Opcode.CHUNK:
        content = _chunk_content(_take(stream, start + HEAD.size, end), part.cut)
        stream, start, end = BytesIO(content), 0, len(content)
    for opcode, begin, stop in _heads(stream, start, end):
        if stop > end:
            if part.cut:
                return
            raise EndOfFile('a record runs over the end')
        if opcode in KNOWN:
            record = _RecordStream(_take(stream, begin - HEAD.size, stop))
            yield next(StreamReader(record, skip_magic=True, emit_chunks=True).records)


def _chunk_content(record: bytes, cut: bool) -> bytes:
    """Decompress and verify a chunk, or return what there is of a cut one."""
    stream = BytesIO(record) if cut else _RecordStream(record)
    chunk = records.Chunk.read(ReadDataStream(stream))
    size = chunk.uncompressed_size
    if size > LARGEST:
        raise ValueError(f'a chunk of {size} bytes is larger than {LARGEST}')
    if chunk.compression not in ('', 'zstd', 'lz4'):
        raise UnsupportedCompressionError(chunk.compression)
    if cut:
        if chunk.compression == 'zstd':
            chunk.data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size)
        elif chunk.compression == 'lz4':
            chunk.data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size)
        chunk.compression = ''
        if len(chunk.data) < size:
            return bytes(chunk.data)
    if chunk.compression == 'zstd' and zstandard.frame_content_size(chunk.data) not in (-1, size):
        raise ValueError('the size of the compressed data is damaged')
    content, length = get_chunk_data_stream(chunk, validate_crc=True)
    if length != size:
        raise ValueError(f'a chunk has {length} bytes, expected {size}')
    return content.read(length)
