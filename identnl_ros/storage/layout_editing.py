# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Changing numbers in the text of a layout file: comments, order and units stay."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
import math
import re

from identnl_ros.core.calibration.findings import Calibrated, corrected_layout, Property
from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.storage.layout_file import read_layout
from identnl_ros.storage.layout_writing import layout_text
from identnl_ros.storage.quantities import convert, same_dimension
from identnl_ros.storage.triaxial_sensors import AXES
from identnl_ros.storage.yaml_reading import KIND
from identnl_ros.storage.yaml_writing import number
import numpy as np
import yaml

# Numbers are rounded to this share of their standard error; without one, to so many digits.
ROUNDING = 0.01
DIGITS = 9
INDENT = 2
# What is read back may be off by this share of the standard error.
READ_BACK = 0.1

_NUMBER_AND_UNIT = re.compile(r'([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)', re.ASCII)
_OLD_COMMENT = re.compile(r'[ \t]*# calibrated: [^#\n\r]*(?=[\r\n]|$)')


@dataclass(frozen=True)
class EditedLayout:
    """
    The text of a layout file with calibrated numbers.

    Parameters
    ----------
    text : str
    layout : Layout
        As read back from the text.
    whole : bool
        The text was written anew, without the user's comments.

    """

    text: str
    layout: Layout
    whole: bool


@dataclass(frozen=True)
class _Edit:
    """A part of the text and what takes its place."""

    begin: int
    end: int
    text: str


def edited_layout(text: str, where: str, calibrated: tuple[Calibrated, ...]) -> EditedLayout:
    """
    Write calibrated numbers into the text of a layout file.

    Parameters
    ----------
    text : str
    where : str
        Name of the file, for errors.
    calibrated : tuple of Calibrated
        Of sensors of the file.

    Returns
    -------
    EditedLayout

    Raises
    ------
    LayoutError
        If the text does not describe sensors, or the numbers do not come out when it is read.

    """
    before = read_layout(text, where)
    intended = corrected_layout(before, calibrated)
    try:
        new = _applied(text, _edits(text, before, intended, calibrated))
        layout = read_layout(new, f'{where} with calibrated numbers')
        _check(layout, intended, calibrated)
    except (LayoutError, _NoEntryError):
        # What the text is like was not thought of here.
        new = layout_text(intended, f'{where} with calibrated numbers, written anew.')
        layout = read_layout(new, where)
        _check(layout, intended, calibrated)
        return EditedLayout(new, layout, True)
    return EditedLayout(new, layout, False)


class _NoEntryError(Exception):
    """A sensor is not an entry of its own."""


def _edits(
    text: str, before: Layout, intended: Layout, calibrated: tuple[Calibrated, ...]
) -> Iterator[_Edit]:
    root = yaml.compose(text, Loader=yaml.BaseLoader)
    top = _children(root)
    entries = _children(top.get('sensors', (None, None))[1])
    defaults = _children(top.get('defaults', (None, None))[1])
    comments: list[tuple[int, str, str]] = []
    listed: dict[str, dict[str, tuple[dict[str, str], str]]] = {}
    sensors = {one.name: one for one in intended.sensors}
    for sensor in before.sensors:
        found = [one for one in calibrated if one.sensor == sensor.name]
        if not found:
            continue
        entry, axis = _entry(entries, sensor.name)
        name_node, node = entries[entry]
        keys = _children(node)
        if keys[KIND][1].value != sensor.kind.value:
            raise _NoEntryError
        by_default = _children(defaults.get(sensor.kind.value, (None, None))[1])
        texts = _texts(by_default) | _texts(keys)
        if axis:
            axes = keys[AXES][1]
            if isinstance(axes, yaml.SequenceNode):
                values = _values(sensor, sensors[sensor.name], found, texts)
                listed.setdefault(entry, {})[axis] = values, _comment(found, values)
                continue
            name_node, node = _children(axes)[axis]
            keys = _children(node)
            texts |= _texts(keys)
        values = _values(sensor, sensors[sensor.name], found, texts)
        yield from _changed(text, node, keys, values)
        comments.append((name_node.start_mark.index, sensor.name, _comment(found, values)))
    for entry, of_axes in listed.items():
        name_node, node = entries[entry]
        if _is_flow(node):
            said = [(f'{entry}_{axis}', words) for axis, (_, words) in of_axes.items()]
            comments += [(name_node.start_mark.index, *one) for one in said]
        yield from _axes_with_keys(text, node, of_axes)
    yield from _comments(text, comments)


def _entry(entries: Mapping[str, tuple[yaml.Node, yaml.Node]], name: str) -> tuple[str, str]:
    """Find the entry that a sensor comes from, and its axis where the entry has several."""
    if _children(entries.get(name, (None, None))[1]):
        return name, ''
    entry, _, axis = name.rpartition('_')
    if AXES in _children(entries.get(entry, (None, None))[1]):
        return entry, axis
    raise _NoEntryError


def _changed(
    text: str,
    node: yaml.Node,
    keys: Mapping[str, tuple[yaml.Node, yaml.Node]],
    values: Mapping[str, str],
) -> Iterator[_Edit]:
    """Put values into a mapping, which may be empty or missing."""
    added = []
    for key, value in values.items():
        if key in keys:
            old = keys[key][1]
            yield _Edit(old.start_mark.index, old.end_mark.index, value)
        else:
            added.append(f'{key}: {value}')
    if not added:
        return
    if isinstance(node, yaml.MappingNode) and node.value:
        yield _added(text, node, added)
        return
    begin = node.start_mark.index
    blank = '' if isinstance(node, yaml.MappingNode) else ' '
    yield _Edit(begin, node.end_mark.index, f'{blank}{{{", ".join(added)}}}')


def _axes_with_keys(
    text: str, node: yaml.Node, of_axes: Mapping[str, tuple[dict[str, str], str]]
) -> Iterator[_Edit]:
    """Replace a list of axes by axes with keys, each in a line of its own if there is room."""
    key, axes = _children(node)[AXES]
    inside = []
    for letter in (one.value for one in axes.value):
        values, words = of_axes.get(letter, ({}, ''))
        written = ', '.join(f'{name}: {value}' for name, value in values.items())
        comment = '' if _is_flow(node) else _said(words)
        inside.append(f'{letter}: {{{written}}}{comment}')
    if _is_flow(node):
        yield _Edit(axes.start_mark.index, axes.end_mark.index, f'{{{", ".join(inside)}}}')
        return
    newline = '\r\n' if '\r\n' in text else '\n'
    indent = ' ' * (key.start_mark.column + INDENT)
    last = axes.end_mark.index if _is_flow(axes) else axes.value[-1].end_mark.index
    end = _line_end(text, last)
    yield _Edit(key.end_mark.index, last, ':')
    yield _Edit(end, end, ''.join(f'{newline}{indent}{line}' for line in inside))


def _children(node: yaml.Node | None) -> dict[str, tuple[yaml.Node, yaml.Node]]:
    """Keys of a mapping with the nodes of key and value."""
    if not isinstance(node, yaml.MappingNode):
        return {}
    return {key.value: (key, value) for key, value in node.value}


def _is_flow(node: yaml.Node) -> bool:
    return isinstance(node, yaml.CollectionNode) and bool(node.flow_style)


def _texts(keys: Mapping[str, tuple[yaml.Node, yaml.Node]]) -> dict[str, str]:
    return {
        key: value.value for key, (_, value) in keys.items() if isinstance(value, yaml.ScalarNode)
    }


def _added(text: str, node: yaml.MappingNode, lines: list[str]) -> _Edit:
    """Put keys behind the last one of a sensor."""
    first, last = node.value[0][0], node.value[-1][1]
    if node.flow_style:
        end = last.end_mark.index
        return _Edit(end, end, ''.join(f', {line}' for line in lines))
    indent = ' ' * first.start_mark.column
    newline = '\r\n' if '\r\n' in text else '\n'
    one_line = isinstance(last, yaml.ScalarNode) and last.style not in ('|', '>')
    if one_line or (isinstance(last, yaml.CollectionNode) and last.flow_style):
        end = _line_end(text, last.end_mark.index)
        return _Edit(end, end, ''.join(f'{newline}{indent}{line}' for line in lines))
    begin = first.start_mark.index
    return _Edit(begin, begin, ''.join(f'{line}{newline}{indent}' for line in lines))


def _comments(text: str, comments: list[tuple[int, str, str]]) -> Iterator[_Edit]:
    """Say at the end of the line of a sensor's name what was found."""
    lines: dict[int, list[tuple[str, str]]] = {}
    for index, *said in comments:
        lines.setdefault(_line_end(text, index), []).append((said[0], said[1]))
    for end, all_said in lines.items():
        begin = text.rfind('\n', 0, end) + 1
        old = _OLD_COMMENT.search(text[begin:end])
        words = [f'{name}: {words}' if len(all_said) > 1 else words for name, words in all_said]
        yield _Edit(begin + old.start() if old else end, end, _said('; '.join(words)))


def _said(words: str) -> str:
    return f'  # calibrated: {words}' if words else ''


def _line_end(text: str, index: int) -> int:
    end = text.find('\n', index)
    end = len(text) if end < 0 else end
    return end - 1 if end > 0 and text[end - 1] == '\r' else end


def _applied(text: str, edits: Iterator[_Edit]) -> str:
    # Of edits at one place the keys come first, then the comment: in reverse, the longest last.
    for edit in sorted(edits, key=lambda one: one.begin, reverse=True):
        text = text[: edit.begin] + edit.text + text[edit.end :]
    return text


def _values(
    old: Sensor, new: Sensor, calibrated: list[Calibrated], texts: Mapping[str, str]
) -> dict[str, str]:
    """Text of every key that changes."""
    found: dict[str, str] = {}
    for one in calibrated:
        text, error = texts.get(one.what.value, ''), one.standard_error
        _, unit = _split(text)
        match one.what:
            case Property.GAIN:
                size, unit = _split(text or '1')
                scale = size / old.gain
            case Property.DIRECTION:
                errors = [
                    each.standard_error for each in calibrated if each.what is Property.DIRECTION
                ]
                parts = (_rounded(float(part), min(errors)) for part in new.direction)
                found['direction'] = f'[{", ".join(parts)}]'
                continue
            case Property.DELAY:
                unit = unit or 'us'
                scale = convert(1.0, 's', unit)
            case Property.FRONT_MASS:
                unit = unit or 'kg'
                scale = convert(1.0, 'kg', unit)
            case Property.OFFSET:
                scale = convert(1.0, old.recorded_unit, unit) if unit else 1.0
            case _:
                unit = unit or ('' if text else old.kind.unit)
                if not unit or same_dimension(unit, old.kind.unit):
                    scale = convert(1.0, old.kind.unit, unit) if unit else 1.0
                else:
                    scale = abs(new.gain) * convert(1.0, old.recorded_unit, unit)
        value = _rounded(one.value * scale, error * abs(scale))
        found[one.what.value] = f'{value} {unit}'.rstrip()
    return found


def _split(text: str) -> tuple[float, str]:
    """Split into number and unit."""
    match = _NUMBER_AND_UNIT.fullmatch(text.strip())
    return (float(match[1]), match[2].strip()) if match else (math.nan, '')


def _rounded(value: float, error: float) -> str:
    """Write as many digits as the standard error leaves."""
    if error > 0 and math.isfinite(error):
        decimals = math.ceil(-math.log10(ROUNDING * error))
        return number(float(round(value, decimals)))
    return number(float(f'{value:.{DIGITS}g}'))


def _comment(found: list[Calibrated], values: Mapping[str, str]) -> str:
    """Tell the standard errors."""
    words = []
    for one in found:
        if not one.standard_error > 0:
            continue
        if one.what is Property.DIRECTION:
            axis = 'xyz'[int(np.argmax(np.abs(one.axis)))]
            words.append(
                f'{np.degrees(one.value):.4g} +- {np.degrees(one.standard_error):.1g} deg '
                f'towards {axis}'
            )
            continue
        shown, unit = _split(values[one.what.value])
        scale = abs(shown / one.value) if one.value else 1.0
        words.append(
            f'{one.what.value} {values[one.what.value].split()[0]} +- '
            f'{one.standard_error * scale:.2g} {unit}'.rstrip()
        )
    return ', '.join(words)


def _check(read: Layout, intended: Layout, calibrated: tuple[Calibrated, ...]) -> None:
    """Compare what is read back with what was to be written."""
    wanted = {one.name: one for one in intended.sensors}
    if [one.name for one in read.sensors] != [one.name for one in intended.sensors]:
        raise LayoutError('calibrated layout: the sensors are not those that were there before')
    for sensor in read.sensors:
        found = [one for one in calibrated if one.sensor == sensor.name]
        other = wanted[sensor.name]
        tolerance = {one.what: READ_BACK * one.standard_error for one in found}
        for what in Property:
            if what is Property.DIRECTION:
                off = float(np.abs(sensor.direction - other.direction).max())
            else:
                off = abs(getattr(sensor, what.value) - getattr(other, what.value))
            size = float(np.max(np.abs(getattr(other, what.value))))
            # What is stated in the recorded unit follows the gain.
            follows = what in (Property.NOISE, Property.RESOLUTION) and what not in tolerance
            allowed = max(np.nan_to_num(tolerance.get(what, 0.0)), 1e-7 * size)
            if not (off <= allowed or follows or math.isnan(off)):
                raise LayoutError(
                    f'sensor {sensor.name}: {what.value} of {getattr(other, what.value)} is read '
                    f'back as {getattr(sensor, what.value)}'
                )
