# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""An MCAP file read so that all sound messages are kept and all damage is told."""

from collections.abc import Collection, Iterator
from pathlib import Path

from identnl_ros.core.errors import DataError
from identnl_ros.storage.mcap_index import Contents, find_contents, Part, read_at
from identnl_ros.storage.mcap_records import (
    DamageError,
    FieldReader,
    HEAD,
    MAGIC,
    Opcode,
    open_chunk,
    split_records,
)
from identnl_ros.storage.recorded_channel import Problems, RecordedChannel, RecordedMessage


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
        self.metadata: list[tuple[str, dict[str, str]]] = []
        with path.open('rb') as stream:
            size = path.stat().st_size
            begins_well = stream.read(len(MAGIC)) == MAGIC
            if not begins_well and read_at(stream, max(size - 8, 0), size) != MAGIC:
                raise DataError(f'{path} is not an MCAP file: it does not begin as one')
            if not begins_well:
                problems.add(f'{path}: the first bytes are damaged; nothing is lost', 'byte 0')
            contents = find_contents(stream, size)
            for start, end in contents.metadata:
                self._read_metadata(read_at(stream, start + HEAD.size, end), start)
        self._parts = contents.parts
        self._note_damage(contents)

    @property
    def channels(self) -> list[RecordedChannel]:
        """Channels met so far; all of them after `scan`."""
        return list(self._channels.values())

    def scan(self, types: Collection[str]) -> Iterator[RecordedMessage]:
        """
        Find all channels and the messages of rare types, without reading the whole file.

        Parameters
        ----------
        types : collection of str
            Message types.

        Yields
        ------
        RecordedMessage

        """
        return self._messages(types, quick=True)

    def messages(self, types: Collection[str]) -> Iterator[RecordedMessage]:
        """
        Read all messages of some types in the order of the file.

        Parameters
        ----------
        types : collection of str
            Message types.

        Yields
        ------
        RecordedMessage

        """
        return self._messages(types, quick=False)

    def _messages(self, types: Collection[str], quick: bool) -> Iterator[RecordedMessage]:
        with self._path.open('rb') as stream:
            for part in self._parts:
                if quick and not self._may_hold(part, types):
                    continue
                try:
                    data = read_at(stream, part.start, part.end)
                    if part.is_chunk:
                        data = open_chunk(data[HEAD.size :], part.cut)
                    yield from self._part_messages(data, part.cut, types)
                except DamageError as error:
                    if part.cut:
                        continue  # nothing of it is complete; that the file is cut is told
                    self._problems.add(
                        f'{self._path}: a damaged part was left out',
                        f'bytes {part.start} to {part.end}: {error}',
                    )

    def _may_hold(self, part: Part, types: Collection[str]) -> bool:
        if not part.channels or not part.channels <= self._channels.keys():
            return True
        return any(self._channels[number].type_name in types for number in part.channels)

    def _part_messages(
        self, data: memoryview, cut: bool, types: Collection[str]
    ) -> Iterator[RecordedMessage]:
        for opcode, record in split_records(data, cut):
            if opcode == Opcode.MESSAGE:
                fields = FieldReader(record)
                channel = self._channels.get(fields.number('H'))
                if channel is None or channel.type_name not in types:
                    continue
                fields.number('I')
                log_time = fields.number('Q')
                fields.number('Q')
                yield RecordedMessage(channel, log_time, fields.rest())
            elif opcode == Opcode.CHANNEL:
                self._add_channel(FieldReader(record))
            elif opcode == Opcode.SCHEMA:
                self._add_schema(FieldReader(record))

    def _add_schema(self, fields: FieldReader) -> None:
        number, name, encoding = fields.number('H'), fields.text(), fields.text()
        data = bytes(fields.bytes(fields.number('I')))
        text = data.decode('utf-8', 'replace') if encoding == 'ros2msg' else ''
        self._schemas[number] = (name, text)

    def _add_channel(self, fields: FieldReader) -> None:
        number, schema, topic = fields.number('H'), fields.number('H'), fields.text()
        encoding = fields.text()
        type_name, definition = self._schemas.get(schema, ('', ''))
        if encoding != 'cdr':
            type_name = f'{type_name} as {encoding}'
        self._channels[number] = RecordedChannel(topic, type_name, definition, self._compressed)

    def _read_metadata(self, record: memoryview, start: int) -> None:
        fields = FieldReader(record)
        try:
            self.metadata.append((fields.text(), fields.text_map()))
        except DamageError as error:
            self._problems.add(
                f'{self._path}: a metadata record is damaged and was left out',
                f'byte {start}: {error}',
            )

    def _note_damage(self, contents: Contents) -> None:
        if contents.index_damaged:
            self._problems.add(
                f'{self._path}: the index is damaged; the file was read without it',
                'check sum at the end of the file',
            )
        if contents.damaged_at is not None:
            self._problems.add(
                f'{self._path} is damaged and could not be read further',
                f'byte {contents.damaged_at}',
            )
        if contents.cut_at is not None:
            kept = (
                'only its index is missing, no message is lost'
                if contents.data_ended
                else 'all complete messages before the end were kept'
            )
            self._problems.add(
                f'{self._path} was cut off or never closed; {kept}',
                f'last complete record ends at byte {contents.cut_at}',
            )
