# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Serialised messages (CDR) read by the message definition that a bag carries itself."""

from collections.abc import Callable
import re
import struct
from types import SimpleNamespace
from typing import Any, Literal

from identnl_ros.core.errors import DataError
import numpy as np

SEPARATOR = '=' * 80

_NUMBERS = {
    'bool': '?',
    'byte': 'B',
    'char': 'B',
    'int8': 'b',
    'uint8': 'B',
    'int16': 'h',
    'uint16': 'H',
    'int32': 'i',
    'uint32': 'I',
    'int64': 'q',
    'uint64': 'Q',
    'float32': 'f',
    'float64': 'd',
}
_INTEGERS = {kind for kind, code in _NUMBERS.items() if code in 'bBhHiIqQ'}
_FIELD = re.compile(
    r'(?P<type>[\w/]+)(?:<=\d+)?(?P<array>\[(?:<=)?(?P<size>\d*)\])?\s+(?P<name>\w+)(?P<rest>.*)'
)

_Order = Literal['<', '>']

# Reads one value and returns it with the offset after it
_Read = Callable[[memoryview, int], tuple[Any, int]]


class MessageDecoder:
    """
    Reader of one message type.

    Fields are found by the definition, so a bag of an older or newer version of this
    package, with fields more or less, is read right.

    Parameters
    ----------
    type_name : str
        E.g. ``identnl_msgs/msg/SampleBlock``.
    definition : str
        Its definition in the form ros2msg, the types it depends on appended.

    Raises
    ------
    DataError
        If the definition cannot be understood or lacks a type.

    """

    def __init__(self, type_name: str, definition: str) -> None:
        self._type_name = type_name
        texts = _split(type_name, definition)
        try:
            self._little = _reader(type_name, texts, '<', ())
            self._big = _reader(type_name, texts, '>', ())
        except (ValueError, RecursionError) as error:
            raise DataError(f'the definition of {type_name} is damaged: {error}') from None

    def decode(self, data: bytes | memoryview) -> SimpleNamespace:
        """
        Read one message.

        Parameters
        ----------
        data : bytes or memoryview
            With the four bytes that name the encoding.

        Returns
        -------
        SimpleNamespace
            An attribute for each field and for each integer constant of the definition;
            arrays of numbers are views of `data`.

        Raises
        ------
        DataError
            If the data do not fit the definition.

        """
        view = memoryview(data)
        if len(view) < 4 or view[0] != 0 or view[1] not in (0, 1):
            raise DataError(
                f'a {self._type_name} starts with the bytes {bytes(view[:4]).hex(" ")}, '
                'expected 00 00 or 00 01 (plain CDR); the message is damaged'
            )
        read = self._little if view[1] else self._big
        try:
            message, _ = read(view[4:], 0)
        except (struct.error, ValueError, IndexError) as error:
            raise DataError(
                f'a {self._type_name} of {len(view)} bytes does not fit its definition '
                f'({error}); the message is damaged'
            ) from None
        return message  # type: ignore[no-any-return]


def _full_name(name: str, package: str) -> str:
    parts = name.split('/')
    if len(parts) == 1:
        parts = [package, *parts]
    return f'{parts[0]}/msg/{parts[-1]}'


def _split(type_name: str, definition: str) -> dict[str, str]:
    """Texts by full type name."""
    texts: dict[str, str] = {}
    name = _full_name(type_name, '')
    for section in re.split(r'^={20,}\s*$', definition, flags=re.MULTILINE):
        head, _, rest = section.lstrip().partition('\n')
        if texts and head.startswith('MSG:'):
            name, section = _full_name(head[4:].strip(), ''), rest
        texts[name] = section
    return texts


def _reader(
    type_name: str, texts: dict[str, str], order: _Order, parents: tuple[str, ...]
) -> _Read:
    """Make the reader of a message type."""
    if type_name in parents or type_name not in texts:
        raise DataError(
            f'the definition of {(*parents, type_name)[0]} does not define {type_name}; '
            'the bag is damaged or was written by a faulty tool'
        )
    fields: list[tuple[str, _Read]] = []
    constants: dict[str, int] = {}
    for line in texts[type_name].splitlines():
        match = _FIELD.match(line.split('#')[0].strip())
        if match is None:
            continue
        if match['rest'].lstrip().startswith('='):
            if match['type'] in _INTEGERS:
                constants[match['name']] = int(match['rest'].strip(' ='), 0)
            continue
        fields.append((match['name'], _field_reader(match, type_name, texts, order, parents)))

    def read(view: memoryview, offset: int) -> tuple[Any, int]:
        message = SimpleNamespace(**constants)
        for name, read_field in fields:
            value, offset = read_field(view, offset)
            setattr(message, name, value)
        return message, offset

    return read


def _field_reader(
    match: re.Match[str],
    type_name: str,
    texts: dict[str, str],
    order: _Order,
    parents: tuple[str, ...],
) -> _Read:
    kind = match['type']
    size = (
        int(match['size'])
        if match['array'] and '<' not in match['array'] and match['size']
        else None
    )
    if kind in _NUMBERS:
        if match['array']:
            return _number_array_reader(np.dtype(_NUMBERS[kind]).newbyteorder(order), size, order)
        return _number_reader(_NUMBERS[kind], order)
    if kind == 'string':
        item = _string_reader(order)
    elif kind == 'wstring':
        raise DataError(f'{type_name} holds wide strings, which are not supported')
    else:
        inner = _full_name(kind, type_name.split('/')[0])
        item = _reader(inner, texts, order, (*parents, type_name))
    return _array_reader(item, size, order) if match['array'] else item


def _number_reader(code: str, order: _Order) -> _Read:
    unpack = struct.Struct(order + code).unpack_from
    size = struct.calcsize(order + code)

    def read(view: memoryview, offset: int) -> tuple[Any, int]:
        offset += -offset % size
        return unpack(view, offset)[0], offset + size

    return read


def _string_reader(order: _Order) -> _Read:
    read_length = _number_reader('I', order)

    def read(view: memoryview, offset: int) -> tuple[Any, int]:
        length, offset = read_length(view, offset)
        end = offset + length
        if end > len(view):
            raise ValueError('a string runs over the end')
        return str(view[offset : max(end - 1, offset)], 'utf-8'), end

    return read


def _number_array_reader(dtype: np.dtype[Any], size: int | None, order: _Order) -> _Read:
    read_length = _number_reader('I', order)

    def read(view: memoryview, offset: int) -> tuple[Any, int]:
        count = size
        if count is None:
            count, offset = read_length(view, offset)
        if not count:
            return np.empty(0, dtype), offset
        offset += -offset % dtype.itemsize
        end = offset + count * dtype.itemsize
        if end > len(view):
            raise ValueError('an array runs over the end')
        return np.frombuffer(view, dtype, count, offset), end

    return read


def _array_reader(item: _Read, size: int | None, order: _Order) -> _Read:
    read_length = _number_reader('I', order)

    def read(view: memoryview, offset: int) -> tuple[Any, int]:
        count = size
        if count is None:
            count, offset = read_length(view, offset)
        if count > len(view):
            raise ValueError('an array runs over the end')
        values = []
        for _ in range(count):
            value, offset = item(view, offset)
            values.append(value)
        return values, offset

    return read
