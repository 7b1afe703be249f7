# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Files with all that an identifier has learned; numbers only, nothing that could be run."""

from contextlib import suppress
import os
from pathlib import Path
import tempfile
import zipfile

from identnl_ros.core.errors import DataError
from identnl_ros.core.identifier import IdentifierState
from identnl_ros.core.information import Information
import numpy as np

FORMAT = 1


def state_path(folder: str | Path, name: str) -> Path:
    """
    Path of a state file that is asked for by its name alone.

    Parameters
    ----------
    folder : str or Path
    name : str

    Returns
    -------
    Path

    Raises
    ------
    DataError
        If the name would lead out of the folder.

    """
    if not name or name in ('.', '..') or any(sign in name for sign in '/\\\0'):
        raise DataError(
            f'"{name}" cannot be the name of a state file; give a name without folder, '
            'e.g. "slideways.npz"'
        )
    return Path(folder) / name


def save_state(path: Path, state: IdentifierState) -> None:
    """
    Write a state; a file of this name is replaced only when the new one is complete.

    Parameters
    ----------
    path : Path
        In an existing folder.
    state : IdentifierState

    Raises
    ------
    DataError
        If it cannot be written.

    """
    part = None
    try:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
        part = Path(name)
        with os.fdopen(descriptor, 'wb') as stream:
            np.savez(
                stream,
                format=np.array(FORMAT),
                unknowns=np.array(state.unknowns, dtype=np.str_),
                factor=state.information.factor,
                rows=np.array(state.information.rows),
                noise_gram=state.noise_gram,
                pending=state.pending,
                samples=np.array(state.samples),
                rejected=np.array(state.rejected),
            )
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
    except OSError as error:
        if part is not None:
            with suppress(OSError):
                part.unlink()
        raise DataError(
            f'{path} cannot be written: {error.strerror or error}; '
            'check the folder, its permissions and the space left'
        ) from None


def load_state(path: Path) -> IdentifierState:
    """
    Read a state.

    Parameters
    ----------
    path : Path

    Returns
    -------
    IdentifierState

    Raises
    ------
    DataError
        If there is no such file or it is no state.

    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            content = {name: archive[name] for name in archive.files}
    except OSError as error:
        raise DataError(f'{path} cannot be read: {error.strerror or error}') from None
    except (ValueError, EOFError, AttributeError, TypeError, zipfile.BadZipFile):
        raise DataError(f'{path} is no state of an identifier, or damaged') from None
    try:
        if int(content['format']) != FORMAT:
            raise DataError(
                f'{path} has format {int(content["format"])}, expected {FORMAT}; '
                'it comes from another version'
            )
        state = IdentifierState(
            information=Information(content['factor'].astype(np.float64), int(content['rows'])),
            noise_gram=content['noise_gram'].astype(np.float64),
            pending=content['pending'].astype(np.float64),
            samples=int(content['samples']),
            rejected=int(content['rejected']),
            unknowns=tuple(str(name) for name in content['unknowns']),
        )
    except (KeyError, TypeError, ValueError):
        raise DataError(f'{path} is no state of an identifier, or damaged') from None
    size = len(state.unknowns)
    if (
        state.information.factor.shape != (size + 1, size + 1)
        or state.noise_gram.shape != (size, size)
        or state.pending.ndim != 3
        or state.pending.shape[1] != 4
        or min(state.information.rows, state.samples, state.rejected) < 0
    ):
        raise DataError(f'{path} is damaged: its tables do not fit its {size} parameters')
    return state
