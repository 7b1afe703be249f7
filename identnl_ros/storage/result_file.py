# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Results of an identification as `identnl identify --json` prints them."""

from collections.abc import Sequence
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from identnl_ros.core.errors import DataError
from identnl_ros.storage.quantities import shown
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, FiniteFloat, ValidationError

LARGEST_FILE = 50_000_000  # [bytes]
# Of a covariance, relative to the standard deviations: what rounding may spoil.
ROUNDING = 1e-6
# So many parameters are named in an error.
NAMED = 4
_UNION = ('float', 'int', 'constrained-float')
_NEXT = 'expected the document that "identnl identify BAG --json" prints'


class _Entry(BaseModel):
    model_config = ConfigDict(strict=True)

    name: str
    unit: str
    value: FiniteFloat | int | None
    standard_deviation: FiniteFloat | int | None = None
    status: str = 'unknown'


class _Document(BaseModel):
    model_config = ConfigDict(strict=True)

    parameters: list[_Entry]
    covariance: list[list[FiniteFloat | int | None]]
    machine: str = ''


@dataclass(frozen=True)
class IdentifiedParameters:
    """
    Values of parameters with their covariance.

    Parameters
    ----------
    machine : str
        Name of the machine; empty: not said.
    names, units, statuses : tuple of str
        Of every parameter.
    values : ndarray, shape (n,)
        [SI].
    covariance : ndarray, shape (n, n)
        NaN in rows and columns of parameters whose uncertainty is not known.

    """

    machine: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    statuses: tuple[str, ...]
    values: NDArray[np.float64]
    covariance: NDArray[np.float64]


def load_result(path: Path) -> IdentifiedParameters:
    """
    Read the result of an identification.

    Parameters
    ----------
    path : Path

    Returns
    -------
    IdentifiedParameters

    Raises
    ------
    DataError
        If the file is not such a result, or has parameters without a value.

    """
    document = _document(path)
    entries = document.parameters
    if not entries:
        raise DataError(f'{path}: parameters: found none; {_NEXT}')
    names = [entry.name for entry in entries]
    repeated = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if repeated:
        raise DataError(f'{path}: parameters: {repeated[0]} stands there more than once')
    without = [entry for entry in entries if entry.value is None]
    if without:
        raise DataError(
            f'{path}: no value for {listed([one.name for one in without])} '
            f'(status {without[0].status}): the data did not determine '
            f'{"it" if len(without) == 1 else "them"}, and a simulation needs every number; '
            'identify from data that do, or give these numbers known values in the machine file '
            'and identify again'
        )
    return IdentifiedParameters(
        document.machine,
        tuple(names),
        tuple(entry.unit for entry in entries),
        tuple(entry.status for entry in entries),
        np.array([entry.value for entry in entries], dtype=np.float64),
        _covariance(path, document),
    )


def listed(names: Sequence[str]) -> str:
    """
    Name some things, not too many.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    str

    """
    more = len(names) - NAMED
    return ', '.join(names[:NAMED]) + (f' and {more} more' if more > 0 else '')


def _document(path: Path) -> _Document:
    try:
        with path.open('rb') as file:
            content = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise DataError(f'{path}: cannot be read: {error.strerror or error}') from None
    if len(content) > LARGEST_FILE:
        raise DataError(f'{path}: larger than {LARGEST_FILE} bytes; {_NEXT}')
    try:
        data: Any = json.loads(content.decode('utf-8-sig'))
    except UnicodeDecodeError:
        raise DataError(f'{path}: is not a text in UTF-8; {_NEXT}') from None
    except json.JSONDecodeError as error:
        raise DataError(f'{path}:{error.lineno}: is not JSON: {error.msg}; {_NEXT}') from None
    except (RecursionError, ValueError):
        raise DataError(f'{path}: is not JSON that can be read; {_NEXT}') from None
    if not isinstance(data, dict):
        raise DataError(f'{path}: found {shown(data)}; {_NEXT}')
    if 'parameters' not in data and isinstance(data.get('error'), str):
        raise DataError(
            f'{path}: holds no result but the error of a command: {data["error"][:300]}'
        )
    try:
        return _Document.model_validate(data)
    except ValidationError as error:
        problem = error.errors()[0]
        # Behind the last key or index stands the member of a union.
        parts = [str(part) for part in problem['loc']]
        place = '.'.join(part for part in parts if part not in _UNION)
        found = (
            'is missing' if problem['type'] == 'missing' else f'found {shown(problem["input"])}'
        )
        reason = '' if problem['type'] == 'missing' else f' ({problem["msg"]})'
        raise DataError(f'{path}: {place}: {found}{reason}; {_NEXT}') from None


def _covariance(path: Path, document: _Document) -> NDArray[np.float64]:
    size = len(document.parameters)
    lengths = [len(row) for row in document.covariance]
    if lengths != [size] * size:
        raise DataError(
            f'{path}: covariance: found {len(lengths)} rows of {sorted(set(lengths))} numbers, '
            f'expected {size} of {size}, one for each parameter; {_NEXT}'
        )
    table = np.array(
        [[np.nan if one is None else one for one in row] for row in document.covariance],
        dtype=np.float64,
    )
    known = np.isfinite(np.diag(table))
    inner = table[np.ix_(known, known)]
    squares = np.diag(inner)
    sound = bool(np.isfinite(inner).all() and (squares >= 0).all())
    if sound:
        used = squares > 0
        scale = np.sqrt(squares[used])
        correlation = inner[np.ix_(used, used)] / np.outer(scale, scale)
        sound = np.allclose(correlation, correlation.T, rtol=0, atol=ROUNDING) and (
            not used.any() or float(np.linalg.eigvalsh(correlation)[0]) > -ROUNDING * size
        )
    if not sound:
        raise DataError(
            f'{path}: covariance: is none: not symmetric, or some combination of parameters '
            f'would have a negative variance; {_NEXT}'
        )
    return table
