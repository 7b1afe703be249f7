# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Records of the MCAP format, as far as a bag is read from them.

The library's reader gives up at the first damage and returns damaged chunks as if they
were sound. This one tells complete, cut and damaged parts apart, so that all that is sound can
be kept.
"""

from collections.abc import Iterator
from enum import IntEnum
import struct
import zlib

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
FOOTER_SIZE = HEAD.size + 20

LARGEST_CHUNK = 2**30  # [bytes] decompressed


class Opcode(IntEnum):
    """Kinds of records."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    DATA_END = 0x0F
    FIRST_PRIVATE = 0x80


class DamageError(Exception):
    """Part of a file is not what the format prescribes."""


class FieldReader:
    """
    Reads the fields of a record one after another.

    Parameters
    ----------
    view : memoryview
        The record without its head.

    """

    def __init__(self, view: memoryview) -> None:
        """Start at the first field."""
        self._view = view
        self._offset = 0

    def number(self, code: str) -> int:
        """Read an integer with the struct code `code`."""
        try:
            (value,) = struct.unpack_from('<' + code, self._view, self._offset)
        except struct.error:
            raise DamageError('a record ends too early') from None
        self._offset += struct.calcsize('<' + code)
        return int(value)

    def bytes(self, length: int) -> memoryview:
        """Read a number of bytes."""
        end = self._offset + length
        if end > len(self._view):
            raise DamageError('a record ends too early')
        start, self._offset = self._offset, end
        return self._view[start:end]

    def text(self) -> str:
        """Read a text with its length before it."""
        try:
            return str(self.bytes(self.number('I')), 'utf-8')
        except UnicodeDecodeError:
            raise DamageError('a text is damaged') from None

    def text_map(self) -> dict[str, str]:
        """Read pairs of texts."""
        inner = FieldReader(self.bytes(self.number('I')))
        pairs = {}
        while inner.remains():
            key = inner.text()
            pairs[key] = inner.text()
        return pairs

    def remains(self) -> bool:
        """Tell whether there is more to read."""
        return self._offset < len(self._view)

    def rest(self) -> memoryview:
        """Read all that follows."""
        return self._view[self._offset :]


def split_records(view: memoryview, cut: bool = False) -> Iterator[tuple[int, memoryview]]:
    """
    Split the contents of a chunk or another run of records.

    Parameters
    ----------
    view : memoryview
    cut : bool
        The end may be missing; then an incomplete last record is left out.

    Yields
    ------
    tuple of int and memoryview
        Opcode and fields.

    Raises
    ------
    DamageError
        If the last record is not complete and `cut` is not set.

    """
    offset = 0
    while offset < len(view):
        start = offset + HEAD.size
        if start <= len(view):
            opcode, length = HEAD.unpack_from(view, offset)
            offset = start + length
        if start > len(view) or offset > len(view):
            if cut:
                return
            raise DamageError('a record runs over the end of its chunk')
        yield opcode, view[start:offset]


def open_chunk(view: memoryview, cut: bool = False) -> memoryview:
    """
    Decompress and verify a chunk.

    Parameters
    ----------
    view : memoryview
        The record without its head.
    cut : bool
        The end is missing; then there is no check sum to verify.

    Returns
    -------
    memoryview
        The records in the chunk.

    Raises
    ------
    DamageError
        If the chunk is damaged or compressed in an unknown way.

    """
    fields = FieldReader(view)
    fields.number('Q')
    fields.number('Q')
    size = fields.number('Q')
    crc = fields.number('I')
    compression = fields.text()
    length = fields.number('Q')
    data = fields.rest() if cut else fields.bytes(length)
    if size > LARGEST_CHUNK:
        raise DamageError(f'a chunk of {size} bytes is larger than {LARGEST_CHUNK}')
    contents = memoryview(_decompress(data, compression, size))
    if cut:
        return contents
    if len(contents) != size:
        raise DamageError(f'a chunk has {len(contents)} bytes, expected {size}')
    if crc and zlib.crc32(contents) != crc:
        raise DamageError('the check sum is wrong')
    return contents


def _decompress(data: memoryview, compression: str, size: int) -> bytes | memoryview:
    """Decompress what is there, be it cut; never more than `size`, whatever damage claims."""
    if compression == '':
        return data
    if compression == 'zstd':
        import zstandard

        try:
            return zstandard.ZstdDecompressor().stream_reader(data).read(size)
        except zstandard.ZstdError as error:
            raise DamageError(str(error)) from None
    if compression == 'lz4':
        import lz4.frame  # type: ignore[import-untyped]

        try:
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, size))
        except RuntimeError as error:
            raise DamageError(str(error)) from None
    raise DamageError(f'compression {compression!r} is not known')
