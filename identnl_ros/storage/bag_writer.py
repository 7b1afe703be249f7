# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Writing of bags that `ros2 bag` can play; ROS need not be installed."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
import os
from os import PathLike
from pathlib import Path
import shutil
from types import TracebackType

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.storage.bag_files import METADATA_NAME
from identnl_ros.storage.bag_metadata import metadata_text, WrittenTopic
from identnl_ros.storage.message_types import (
    definition_text,
    encode_block,
    encode_description,
    SAMPLE_BLOCK,
    STAND_DESCRIPTION,
    type_hash,
)
from identnl_ros.storage.stand_description import StandDescription
from mcap.writer import CompressionType, Writer

LATCHED_DEPTH = 1
DEPTH = 1000  # a subscriber that stalls for seconds loses nothing


class BagWriter:
    """
    Writes a bag; to be used in a `with` statement.

    Nothing but what is given is written, no time of day and no random number: the same
    calls give the same bytes.

    Parameters
    ----------
    path : path
        One file if it ends in ``.mcap``, else a folder as `ros2 bag` makes it.
    namespace : str
        Of the topics ``samples`` and ``stand_description``.
    keep_partial : bool
        For recording live: write in place, and keep what there is after an error; a bag that
        nothing was written to is removed. Else the bag appears under its name only when it is
        complete.
    compress : bool
        Pays for samples in the steps of an analogue-to-digital converter, to about 40 %;
        noise in full precision shrinks by 4 % and takes four times as long.

    Raises
    ------
    DataError
        If the path exists or cannot be written.

    """

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        namespace: str = '/stand',
        keep_partial: bool = False,
        compress: bool = False,
    ) -> None:
        """Create the file."""
        self.path = Path(path)
        self._namespace = '/' + namespace.strip('/') if namespace.strip('/') else ''
        self._keep_partial = keep_partial
        self._topics: dict[str, tuple[int, WrittenTopic]] = {}
        self._schemas: dict[str, int] = {}
        self._times: tuple[int, int] | None = None
        self._is_open = True
        self._has_failed = False
        self._is_empty = True
        self._check_is_new()
        self._target = (
            self.path
            if keep_partial
            else self.path.with_name(f'.{self.path.name}.{os.getpid()}.part')
        )
        is_file = self.path.suffix == '.mcap'
        self._file = self._target if is_file else self._target / f'{self.path.name}_0.mcap'
        with self._told_errors():
            if not is_file:
                self._target.mkdir()
            self._stream = self._file.open('xb')
        self._writer = Writer(
            self._stream,
            compression=CompressionType.ZSTD if compress else CompressionType.NONE,
            enable_data_crcs=True,
        )
        self._writer.start('ros2', 'identnl_ros')  # a few bytes, buffered: cannot fail

    def __enter__(self) -> 'BagWriter':
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Finish the bag; after an error discard it, or keep what there is."""
        if error is None:
            self.close()
        elif self._keep_partial:
            with suppress(DataError):  # the first error is the one to tell
                self.close()
        else:
            self._discard()

    @property
    def is_empty(self) -> bool:
        """Nothing was written."""
        return self._is_empty

    def write_description(self, description: StandDescription) -> None:
        """
        Write what the channels of a stream are, to be done before its first block.

        Parameters
        ----------
        description : StandDescription

        Raises
        ------
        DataError
            If it cannot be written.

        """
        self.write_raw(
            f'{self._namespace}/stand_description',
            STAND_DESCRIPTION,
            encode_description(description),
            description.stamp_ns,
            latched=True,
        )
        self.flush()  # in a chunk of its own: damage to samples does not cost the description

    def write_block(self, block: SampleBlock) -> None:
        """
        Write a block.

        Parameters
        ----------
        block : SampleBlock

        Raises
        ------
        DataError
            If it cannot be written.

        """
        self.write_raw(
            f'{self._namespace}/samples', SAMPLE_BLOCK, encode_block(block), block.stamp_ns
        )

    def write_raw(
        self,
        topic: str,
        type_name: str,
        data: bytes | bytearray | memoryview,
        log_time_ns: int,
        *,
        latched: bool = False,
    ) -> None:
        """
        Write a serialised message of any type of ROS 2 Jazzy or this project.

        Parameters
        ----------
        topic : str
        type_name : str
            E.g. ``diagnostic_msgs/msg/DiagnosticArray``.
        data : bytes
            CDR.
        log_time_ns : int
            [ns].
        latched : bool
            Players publish the topic with durability transient local; counts at the first
            message of a topic.

        Raises
        ------
        DataError
            If the type is not known, the time cannot be stored or writing fails.

        """
        if not 0 <= log_time_ns < 2**63:
            raise DataError(
                f'{self.path}: a message on {topic} has the time {log_time_ns} ns, '
                'expected 0 to 2^63 - 1'
            )
        with self._told_errors():
            channel, written = self._topic(topic, type_name, latched)
            self._writer.add_message(channel, log_time_ns, bytes(data), log_time_ns, written.count)
        written.count += 1
        self._is_empty = False
        first, last = self._times or (log_time_ns, log_time_ns)
        self._times = (min(first, log_time_ns), max(last, log_time_ns))

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """
        Write a record that is not a message, e.g. the true parameters of a simulation.

        Parameters
        ----------
        name : str
        values : mapping of str

        Raises
        ------
        DataError
            If it cannot be written.

        """
        with self._told_errors():
            self._writer.add_metadata(name, dict(values))
        self._is_empty = False

    def flush(self) -> None:
        """
        Hand all that was written to the operating system: a crash then cannot lose it.

        Raises
        ------
        DataError
            If writing fails.

        """
        with self._told_errors():
            self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """
        Finish the bag, or remove one that is kept partial and empty; a second call does nothing.

        Raises
        ------
        DataError
            If the bag cannot be finished.

        """
        if not self._is_open:
            return
        if self._has_failed or (self._keep_partial and self._is_empty):
            self._discard()
            return
        try:
            with self._told_errors():
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._stream.close()
                if self._file != self._target:
                    first, last = self._times or (0, 0)
                    topics = [topic for _, topic in self._topics.values()]
                    text = metadata_text(self._file.name, topics, first, last)
                    (self._target / METADATA_NAME).write_text(text, 'utf-8')
                if self._target != self.path:
                    self._check_is_new()
                    self._target.rename(self.path)
                self._is_open = False
        finally:
            self._discard()

    def _topic(self, topic: str, type_name: str, latched: bool) -> tuple[int, WrittenTopic]:
        if topic in self._topics:
            channel, written = self._topics[topic]
            if written.type_name != type_name:
                raise DataError(
                    f'{self.path}: topic {topic} carries {written.type_name}, '
                    f'so a {type_name} cannot be written to it'
                )
            return channel, written
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(
                type_name, 'ros2msg', definition_text(type_name).encode()
            )
        depth = LATCHED_DEPTH if latched else DEPTH
        written = WrittenTopic(topic, type_name, type_hash(type_name), depth, latched)
        channel = self._writer.register_channel(
            topic, 'cdr', self._schemas[type_name], written.channel_metadata
        )
        self._topics[topic] = (channel, written)
        return channel, written

    def _check_is_new(self) -> None:
        if self.path.exists():
            raise DataError(
                f'{self.path} exists and is never overwritten; choose another path or remove it'
            )
        if not self.path.parent.is_dir():
            raise DataError(f'{self.path}: there is no folder {self.path.parent}; make it first')

    def _discard(self) -> None:
        """Close the file and, unless there is something that shall stay, remove it."""
        if not self._is_open:
            return
        self._is_open = False
        with suppress(OSError):
            self._stream.close()
        if self._keep_partial and not self._is_empty:
            return
        if self._file == self._target:
            self._target.unlink(missing_ok=True)
        else:
            shutil.rmtree(self._target, ignore_errors=True)

    @contextmanager
    def _told_errors(self) -> Iterator[None]:
        """Turn an error of the operating system into one for the user."""
        if not self._is_open:
            raise DataError(f'{self.path} is closed; nothing more can be written to it')
        try:
            yield
        except OSError as error:
            self._has_failed = True
            kept = (
                'what was written before can be read'
                if self._keep_partial and not self._is_empty
                else 'the incomplete bag was removed'
            )
            raise DataError(
                f'{self.path} cannot be written: {error.strerror or error}; {kept}, '
                'check the folder, its permissions and the space left'
            ) from None
