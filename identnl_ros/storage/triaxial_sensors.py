# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Triaxial sensors of a layout file: one entry with the key ``axes`` stands for up to three sensors.

The entry NAME gives NAME_x, NAME_y and NAME_z along the sensor's own axes, which ``orientation``
places in the machine frame. Keys of the entry hold for all axes, keys below an axis for it alone;
an axis that is a little off its place has a direction of its own.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from identnl_ros.storage.quantities import direction, shown, Vector
from identnl_ros.storage.yaml_reading import Document, KeyPath, KIND
import numpy as np

SENSORS = 'sensors'
AXES = 'axes'
ORIENTATION = 'orientation'
DIRECTION = 'direction'
COLUMN = 'column'
LETTERS = 'xyz'
KINDS = ('acceleration', 'velocity', 'displacement')
# Cosine between axes that are meant to be perpendicular.
TOLERANCE = 1e-3


def with_single_axes(document: Document, of_axis: Collection[str]) -> Document:
    """
    Replace every triaxial sensor by sensors of one axis.

    Parameters
    ----------
    document : Document
        A layout file.
    of_axis : collection of str
        Keys that may differ from axis to axis.

    Returns
    -------
    Document
        Its lines are those of the triaxial entries.

    Raises
    ------
    LayoutError
        If axes or orientation are no such, or two sensors would have one name; names line and
        key.

    """
    sensors = document.data.get(SENSORS)
    if not isinstance(sensors, dict):
        return document
    single: dict[str, Any] = {}
    lines = dict(document.lines)
    inside: dict[str, list[KeyPath]] = {}
    for place in document.lines:
        if place[0] == SENSORS and len(place) > 1:
            inside.setdefault(str(place[1]), []).append(place)
    for name, entry in sensors.items():
        path = (SENSORS, name)
        if isinstance(entry, dict) and AXES in entry:
            made = _sensors(document, path, entry, of_axis)
            lines |= _lines(document, inside[name], list(made))
        else:
            if isinstance(entry, dict) and ORIENTATION in entry:
                raise document.problem(
                    (*path, ORIENTATION),
                    f'goes with the key {AXES} of a triaxial sensor; a sensor of one axis has '
                    f'a {DIRECTION}',
                )
            made = {name: entry}
        for own, data in made.items():
            if own in single:
                raise document.problem(path, f'two sensors are called {own}; names must differ')
            single[own] = data
    return replace(document, data={**document.data, SENSORS: single}, lines=lines)


def _sensors(
    document: Document,
    path: KeyPath,
    entry: dict[str, Any],
    of_axis: Collection[str],
) -> dict[str, Any]:
    """Make the sensors of one entry."""
    if entry.get(KIND) not in KINDS:
        raise document.problem(
            (*path, AXES),
            f'only sensors of {", ".join(KINDS)} have axes, found kind {shown(entry.get(KIND))}',
        )
    for key in (DIRECTION, COLUMN):
        if key in entry:
            meant = f'give {ORIENTATION}' if key == DIRECTION else 'give one for each axis'
            raise document.problem((*path, key), f'a sensor with {AXES} has several; {meant}')
    own_keys = _own_keys(document, path, entry[AXES], of_axis)
    try:
        directions = _directions(entry.get(ORIENTATION))
    except ValueError as error:
        raise document.problem((*path, ORIENTATION), str(error)) from None
    common = {key: value for key, value in entry.items() if key not in (AXES, ORIENTATION)}
    made = {}
    for letter, own in own_keys.items():
        along = [repr(float(number)) for number in directions[LETTERS.index(letter)]]
        made[f'{path[1]}_{letter}'] = {**common, DIRECTION: along, **own}
    return made


def _lines(document: Document, inside: list[KeyPath], names: list[str]) -> dict[KeyPath, int]:
    """Find the lines of the sensors of one entry: of what is said of an axis alone, its own."""
    common: dict[KeyPath, int] = {}
    own: dict[KeyPath, int] = {}
    for place in inside:
        line = document.lines[place]
        if place[2:3] != (AXES,):
            common |= {(SENSORS, name, *place[2:]): line for name in names}
        elif len(place) > 4:
            own[SENSORS, f'{place[1]}_{place[3]}', *place[4:]] = line
    return common | own


def _own_keys(
    document: Document, path: KeyPath, axes: object, of_axis: Collection[str]
) -> dict[str, dict[str, Any]]:
    """Read the axes that there are, with what is said of each alone."""
    expected = (
        'expected some of the axes x, y and z, as a list "[x, y, z]" or each with keys of its own'
    )
    if axes and isinstance(axes, list):
        for i, letter in enumerate(axes):
            if not (isinstance(letter, str) and letter in tuple(LETTERS)):
                raise document.problem((*path, AXES, i), f'found {shown(letter)}, {expected}')
            if letter in axes[:i]:
                raise document.problem((*path, AXES, i), f'axis {letter} is here twice')
        axes = dict.fromkeys(axes, '')
    if not isinstance(axes, dict) or not axes:
        raise document.problem((*path, AXES), f'found {shown(axes)}, {expected}')
    found: dict[str, dict[str, Any]] = {}
    for letter, own in axes.items():
        here = (*path, AXES, letter)
        if letter not in tuple(LETTERS):
            raise document.problem(here, f'is no axis; {expected}')
        if own and not isinstance(own, dict):
            raise document.problem(here, f'found {shown(own)}, expected keys and values')
        found[letter] = own or {}
        for key in found[letter]:
            if key not in of_axis:
                raise document.problem(
                    (*here, key),
                    f'is no key of a single axis; allowed here: {", ".join(of_axis)}',
                )
    return found


def _directions(orientation: object) -> Vector:
    """Find the sensor's own axes in the machine frame, as rows."""
    if orientation is None:
        return np.eye(3)
    expected = (
        'expected where at least two of the axes of the sensor point in the machine frame, '
        'such as "{x: +z, y: -x}"'
    )
    if not isinstance(orientation, dict) or not 2 <= len(orientation) <= 3:
        raise ValueError(f'found {shown(orientation)}, {expected}')
    rows = np.full((3, 3), np.nan)
    for letter, value in orientation.items():
        if letter not in tuple(LETTERS):
            raise ValueError(f'found {shown(letter)}, {expected}')
        try:
            vector = direction(value)
        except ValueError as error:
            raise ValueError(f'{letter}: {error}') from None
        length = float(np.linalg.norm(vector))
        if length < 1e-12:
            raise ValueError(f'{letter}: direction is zero, expected a vector of any length')
        rows[LETTERS.index(letter)] = vector / length
    for i in range(3):
        if np.isnan(rows[i]).any():
            third = np.cross(rows[i - 2], rows[i - 1])
            rows[i] = third / (np.linalg.norm(third) or 1.0)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        if abs(rows[i] @ rows[j]) > TOLERANCE:
            angle = np.degrees(np.arccos(np.clip(rows[i] @ rows[j], -1, 1)))
            raise ValueError(
                f'{LETTERS[i]} and {LETTERS[j]} are at {angle:.5g} degrees, expected 90'
            )
    if np.linalg.det(rows) < 0:
        raise ValueError('the axes x, y, z are left-handed; turn one of them round')
    return rows
