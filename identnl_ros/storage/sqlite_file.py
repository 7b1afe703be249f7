# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""An SQLite bag file, the older format of ROS 2."""

from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
import sqlite3
from urllib.parse import quote

from identnl_ros.core.errors import DataError
from identnl_ros.storage.recorded_channel import Problems, RecordedChannel, RecordedMessage

MAGIC = b'SQLite format 3\0'


class SqliteFile:
    """
    One SQLite bag file.

    Parameters
    ----------
    path : Path
    problems : Problems
        Damage found on reading is noted here.
    compressed : bool
        Every message is compressed by itself.

    Raises
    ------
    DataError
        If it is not a bag or cannot be read at all.

    """

    def __init__(self, path: Path, problems: Problems, compressed: bool = False) -> None:
        """Read the list of topics."""
        self._path = path
        self._problems = problems
        self.metadata: dict[str, dict[str, str]] = {}
        try:
            with closing(self._connect()) as database:
                self._channels = _read_channels(database, compressed)
        except (sqlite3.Error, UnicodeError) as error:
            raise DataError(
                f'{path} cannot be read as a bag: {error}; it is damaged or not a ROS 2 bag'
            ) from None

    @property
    def channels(self) -> list[RecordedChannel]:
        """All channels."""
        return list(self._channels.values())

    def scan(self, types: Collection[str]) -> Iterator[RecordedMessage]:
        """
        Find the messages of rare types.

        Parameters
        ----------
        types : collection of str
            Message types.

        Yields
        ------
        RecordedMessage

        """
        return self.messages(types)

    def messages(self, types: Collection[str]) -> Iterator[RecordedMessage]:
        """
        Read all messages of some types in the order of recording.

        Parameters
        ----------
        types : collection of str
            Message types.

        Yields
        ------
        RecordedMessage

        """
        wanted = [
            number for number, channel in self._channels.items() if channel.type_name in types
        ]
        query = (
            'SELECT topic_id, timestamp, CAST(data AS BLOB) FROM messages '
            f'WHERE topic_id IN ({", ".join("?" * len(wanted))}) ORDER BY id'
        )
        count = 0
        try:
            with closing(self._connect()) as database:
                for number, time, data in database.execute(query, wanted):
                    count += 1
                    yield RecordedMessage(self._channels[number], time, data)
        except sqlite3.Error as error:
            self._problems.add(
                f'{self._path} is damaged and could not be read further',
                f'after {count} messages: {error}',
            )

    def _connect(self) -> sqlite3.Connection:
        # A database that was closed needs no lock: it may lie on a read-only medium
        closed = not self._path.with_name(f'{self._path.name}-wal').exists()
        options = 'mode=ro&immutable=1' if closed else 'mode=ro'
        location = quote(str(self._path.absolute()))
        return sqlite3.connect(f'file:{location}?{options}', uri=True)


def _read_channels(database: sqlite3.Connection, compressed: bool) -> dict[int, RecordedChannel]:
    tables = {name for (name,) in database.execute('SELECT name FROM sqlite_master')}
    definitions = {}
    if 'message_definitions' in tables:
        definitions = dict(
            database.execute(
                'SELECT topic_type, encoded_message_definition FROM message_definitions '
                "WHERE encoding = 'ros2msg'"
            )
        )
    return {
        number: RecordedChannel(
            topic,
            type_name if encoding == 'cdr' else f'{type_name} as {encoding}',
            definitions.get(type_name, ''),
            compressed,
        )
        for number, topic, type_name, encoding in database.execute(
            'SELECT id, name, type, serialization_format FROM topics'
        )
    }
