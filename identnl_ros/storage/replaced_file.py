# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Files that are either complete or not there."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import tempfile
from typing import BinaryIO

from identnl_ros.core.errors import DataError


def write_text(path: Path, parts: Iterable[str]) -> None:
    """
    Write a text file; one of this name is replaced only when the new one is complete.

    Parameters
    ----------
    path : Path
        Its folder is made if need be.
    parts : iterable of str

    Raises
    ------
    DataError
        If it cannot be written.

    """
    write_bytes(path, (one.encode() for one in parts))


def write_bytes(path: Path, parts: Iterable[bytes]) -> None:
    """
    Write a file; one of this name is replaced only when the new one is complete.

    Parameters
    ----------
    path : Path
        Its folder is made if need be.
    parts : iterable of bytes

    Raises
    ------
    DataError
        If it cannot be written.

    """
    with replaced(path) as stream:
        stream.writelines(parts)


def require_folder(path: Path) -> None:
    """
    Refuse a path whose folder is missing, as a mistyped one.

    Parameters
    ----------
    path : Path
        Of a file to be written.

    Raises
    ------
    DataError

    """
    if not path.parent.is_dir():
        raise DataError(
            f'{path} cannot be written: there is no folder {path.parent}; make it, or correct the '
            'path'
        )


@contextmanager
def replaced(path: Path) -> Iterator[BinaryIO]:
    """
    Open a file for writing that gets its name, in place of another one, when it is complete.

    Parameters
    ----------
    path : Path
        Its folder is made if need be.

    Yields
    ------
    binary file
        That can be positioned.

    Raises
    ------
    DataError
        If it cannot be written.

    """
    part = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
        part = Path(name)
        with os.fdopen(descriptor, 'wb') as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        part.chmod(0o644)
        part.replace(path)
    except BaseException as error:
        if part is not None:
            with suppress(OSError):
                part.unlink()
        if isinstance(error, OSError):
            raise DataError(
                f'{path} cannot be written: {error.strerror or error}; '
                'check the folder, its permissions and the space left'
            ) from None
        raise
