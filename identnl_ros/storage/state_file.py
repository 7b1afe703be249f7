# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Files with all that an identifier has learned; numbers only, nothing that could be run."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
import os
from pathlib import Path
import tempfile
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints
import zipfile

from identnl_ros.core.errors import DataError
from identnl_ros.core.pointwise.identifier_state import IdentifierState
from identnl_ros.core.weak.weak_state import WeakState
import numpy as np
from numpy.typing import NDArray

FORMAT = 1
# Kinds of state by the name that the file gives them.
State = IdentifierState | WeakState
_KINDS: dict[str, type[State]] = {'pointwise': IdentifierState, 'weak': WeakState}


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


def save_state(path: Path, state: State) -> None:
    """
    Write a state; a file of this name is replaced only when the new one is complete.

    Parameters
    ----------
    path : Path
        In an existing folder.
    state : IdentifierState or WeakState

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
            tables: dict[str, Any] = dict(_flattened(state, ''))
            tables['estimator'] = next(
                name for name, kind in _KINDS.items() if isinstance(state, kind)
            )
            np.savez(stream, format=np.array(FORMAT), **tables)
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


def load_state(path: Path) -> State:
    """
    Read a state.

    Parameters
    ----------
    path : Path

    Returns
    -------
    IdentifierState or WeakState

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
        found = int(content['format'])
        if found == FORMAT:
            kind = _KINDS[str(content.get('estimator', 'pointwise'))]
            state: State = _built(kind, content, '')
    except (KeyError, TypeError, ValueError):
        raise DataError(
            f'{path} is no state of an identifier, damaged, or from another version'
        ) from None
    if found != FORMAT:
        raise DataError(
            f'{path} has format {found}, expected {FORMAT}; it comes from another version'
        )
    _check(path, state)
    return state


def _flattened(value: Any, name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the leaves of nested dataclasses with their dotted names; None has none."""
    if is_dataclass(value):
        for field in fields(value):
            inner = getattr(value, field.name)
            yield from _flattened(inner, f'{name}.{field.name}' if name else field.name)
    elif value is not None:
        yield name, np.asarray(sorted(value) if isinstance(value, frozenset) else value)


def _built(kind: Any, content: Mapping[str, NDArray[Any]], name: str) -> Any:
    """Make a value of an annotated type from the leaves below a name."""
    if NoneType in get_args(kind):
        if not any(key == name or key.startswith(f'{name}.') for key in content):
            return None
        (kind,) = (one for one in get_args(kind) if one is not NoneType)
    if isinstance(kind, type) and is_dataclass(kind):
        types = get_type_hints(kind)
        return kind(
            **{key: _built(types[key], content, f'{name}.{key}'.strip('.')) for key in types}
        )
    leaf = content[name]
    if kind in (int, bool, float):
        return kind(leaf)
    if get_origin(kind) in (tuple, frozenset):
        return get_origin(kind)(str(text) for text in leaf)
    return leaf.astype(np.float64)


def _check(path: Path, state: State) -> None:
    size = len(state.unknowns)
    if isinstance(state, WeakState):
        sound = state.information.size == size and state.values.shape == (size,)
    else:
        sound = _tables_fit(state, size)
    counts = state.samples, state.rejected, state.next_index, state.information.rows
    if not sound or min(counts) < 0:
        raise DataError(f'{path} is damaged: its tables do not fit its {size} parameters')


def _tables_fit(state: IdentifierState, size: int) -> bool:
    motion = state.pending.shape[2] if state.pending.ndim == 3 else -1
    elastic = len(state.slopes.sums)
    expected = [
        (state.information.factor, (size + 1, size + 1)),
        (state.scatter.moments, (size * (size + 1), size * (size + 1))),
        (state.scatter.scale, (size + 1,)),
        (state.scatter.reference, (size,)),
        (state.slopes.sums, (elastic,)),
        (state.slopes.products, (elastic, elastic)),
        (state.earlier_noise, (size + 1, size + 1)),
        (state.pending, (len(state.pending), 4, motion)),
    ]
    if state.moments is not None:
        count = len(state.moments.sums)
        expected += [
            (state.moments.sums, (count, size + 1)),
            (state.moments.products, (count * (size + 1), count * (size + 1))),
            (state.moments.sizes, (count, 3)),
            (state.moments.scale, (3, motion)),
            (state.moments.reference, (size,)),
        ]
    if state.noise is not None:
        parts = (getattr(state.noise, field.name) for field in fields(state.noise))
        expected += [(part, (motion, motion)) for part in parts]
    return all(table.shape == shape for table, shape in expected)
