# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
YAML files that people write: read strictly, every error with file, line and key.

All scalars stay texts; what they mean is decided where the key is known. So ``1.2e7`` is a
number, ``no`` is a name, and no tag or alias can build anything.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
import re
from typing import Annotated, Any, TypeVar

from identnl_ros.core.errors import IdentnlError
from identnl_ros.storage.quantities import shown
from pydantic import AfterValidator, BaseModel, ConfigDict, model_validator, ValidationError
import yaml

LARGEST_FILE = 1_000_000  # [bytes]
LARGEST_DEPTH = 20
LONGEST_KEY = 60  # in errors
MOST_PROBLEMS = 10  # told at once

KIND = 'kind'

KeyPath = tuple[str | int, ...]

_PLAIN_TAGS = {f'tag:yaml.org,2002:{kind}' for kind in ('map', 'seq', 'str')}
_NAME = re.compile(r'[^\W\d][\w-]*')
_EXPECTED = {
    'list_type': 'a list',
    'dict_type': 'keys and values',
    'model_type': 'keys and values',
    'model_attributes_type': 'keys and values',
    'string_type': 'a word',
}


class KeyProblem(ValueError):
    """
    A problem of a key rather than of its value.

    Parameters
    ----------
    key : str
        Added to the path that the error names.
    message : str

    """

    def __init__(self, key: str, message: str) -> None:
        """Keep the key beside the message."""
        super().__init__(message)
        self.key = key


class StrictModel(BaseModel):
    """
    Keys of one part of a file: unknown ones are errors, missing ones count as empty.

    An empty value is then refused by its own field, in words that say what is expected.

    """

    model_config = ConfigDict(
        extra='forbid', strict=True, frozen=True, arbitrary_types_allowed=True
    )

    @model_validator(mode='before')
    @classmethod
    def _check_keys(cls, data: object) -> object:
        if not isinstance(data, dict):
            return data
        for key in data:
            if key not in cls.model_fields:
                raise KeyProblem(key, f'unknown key{_suggestion(key, list(cls.model_fields))}')
        missing = (
            name
            for name, info in cls.model_fields.items()
            if info.is_required() and name not in data
        )
        return {**data, **dict.fromkeys(missing, '')}


Model = TypeVar('Model', bound=BaseModel)


@dataclass(frozen=True)
class Document:
    """
    Content of a YAML file and where in it every key is.

    Parameters
    ----------
    where : str
        Name of the file, or whatever else the text came from.
    data : dict
        Nested dictionaries, lists and texts.
    lines : mapping from key path to int
        Line of every key and list item, from 1.
    error : type of IdentnlError
        What to raise when something is wrong.

    """

    where: str
    data: dict[str, Any]
    lines: Mapping[KeyPath, int]
    error: type[IdentnlError]

    def line(self, path: KeyPath) -> int | None:
        """
        Line of a key, or of the nearest part around it.

        Parameters
        ----------
        path : tuple of str and int

        Returns
        -------
        int or None
            None: the whole file.

        """
        known = (path[:end] for end in range(len(path), 0, -1) if path[:end] in self.lines)
        return next((self.lines[part] for part in known), None)

    def problem(self, path: KeyPath, message: str) -> IdentnlError:
        """
        Error in one line: where, which key, what.

        Parameters
        ----------
        path : tuple of str and int
            Empty: the file as a whole.
        message : str

        Returns
        -------
        IdentnlError
            To be raised by the caller.

        """
        line = self.line(path)
        place = self.where if line is None else f'{self.where}:{line}'
        keys = '.'.join(_shortened(part) for part in path)
        return self.error(f'{place}: {keys}: {message}' if keys else f'{place}: {message}')

    def validated(self, model: type[Model]) -> Model:
        """
        Check the whole content against a model.

        Parameters
        ----------
        model : type of BaseModel

        Returns
        -------
        BaseModel
            Instance of `model`.

        Raises
        ------
        IdentnlError
            The kind of the document, about the problems in the file.

        """
        try:
            return model.model_validate(self.data)
        except ValidationError as error:
            problems = [self._path_and_message(problem) for problem in error.errors()]
        problems.sort(key=lambda found: self.line(found[0]) or 0)
        # What is said at one place for several parts is told once.
        once = {
            (self.line(path), path[-1:], message): self.problem(path, message)
            for path, message in reversed(problems)
        }
        raise together([*reversed(once.values())]) from None

    def _path_and_message(self, problem: Any) -> tuple[KeyPath, str]:
        """Translate an error of pydantic."""
        path = self._path(problem['loc'])
        found, kind = f'found {shown(problem["input"])}', problem['type']
        if kind == 'value_error':
            cause = problem['ctx']['error']
            return (*path, cause.key) if isinstance(cause, KeyProblem) else path, str(cause)
        if kind == 'union_tag_invalid':
            context = problem['ctx']
            found = f'found {shown(context["tag"])}'
            return (*path, KIND), f'{found}, expected {_either(context["expected_tags"])}'
        if kind == 'literal_error':
            return path, f'{found}, expected {_either(problem["ctx"]["expected"])}'
        return path, f'{found}, expected {_EXPECTED.get(kind, problem["msg"])}'

    def _path(self, location: tuple[str | int, ...]) -> KeyPath:
        """Leave out what pydantic adds: the member of a union and marks of bad names."""
        path: list[str | int] = []
        data: Any = self.data
        for part in location:
            if isinstance(data, dict) and part not in data and (part in ('[key]', data.get(KIND))):
                continue
            path.append(part)
            data = data.get(part) if isinstance(data, dict) else None
        return tuple(path)


def read_text(path: Path, error: type[IdentnlError]) -> str:
    """
    Read a text file.

    Parameters
    ----------
    path : Path
    error : type of IdentnlError
        What to raise.

    Returns
    -------
    str

    Raises
    ------
    IdentnlError
        If there is no such file, or it is too large or no text.

    """
    try:
        if path.is_dir():
            raise error(f'{path}: is a folder, expected a YAML file')
        with path.open('rb') as file:
            content = file.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise error(f'{path}: larger than {LARGEST_FILE} bytes; is it the right file?')
        return content.decode('utf-8-sig')
    except FileNotFoundError:
        raise error(f'{path}: there is no such file{_neighbours(path)}') from None
    except UnicodeDecodeError:
        raise error(f'{path}: is not a text file in UTF-8; is it the right file?') from None
    except (OSError, ValueError) as cause:
        raise error(f'{path}: cannot be read: {getattr(cause, "strerror", cause)}') from None


def parse(text: str, where: str, error: type[IdentnlError]) -> Document:
    """
    Parse a YAML text whose top is a mapping.

    Parameters
    ----------
    text : str
    where : str
        Name of the file, for errors.
    error : type of IdentnlError
        What to raise.

    Returns
    -------
    Document

    Raises
    ------
    IdentnlError
        If it is no YAML, too large or too deep, repeats a key, has aliases or tags, or its
        top is not a mapping.

    """
    if len(text) > LARGEST_FILE:
        raise error(f'{where}: larger than {LARGEST_FILE} characters')
    try:
        node = _Composer(text).get_single_node()
        lines: dict[KeyPath, int] = {}
        data = _plain(node, (), lines) if node else ''
    except yaml.MarkedYAMLError as cause:
        mark = cause.problem_mark or cause.context_mark
        place = f'{where}:{mark.line + 1}' if mark else where
        raise error(f'{place}: {_explained(cause)}') from None
    except yaml.YAMLError as cause:
        reason = getattr(cause, 'reason', 'it cannot be parsed')
        raise error(f'{where}: is not YAML: {reason}') from None
    if not isinstance(data, dict):
        raise error(f'{where}: found {shown(data)}, expected keys and values such as "name: ..."')
    return Document(where, data, lines, error)


def together(errors: Sequence[IdentnlError]) -> IdentnlError:
    """
    Make one error of several.

    Parameters
    ----------
    errors : sequence of IdentnlError
        At least one, of one kind.

    Returns
    -------
    IdentnlError
        Every one of them in a line of its own.

    """
    lines = [str(error) for error in errors[:MOST_PROBLEMS]]
    if len(errors) > MOST_PROBLEMS:
        lines.append(f'and {len(errors) - MOST_PROBLEMS} more problems')
    return type(errors[0])('\n'.join(lines))


@contextmanager
def located(document: Document, sections: Mapping[str, str]) -> Iterator[None]:
    """
    Add file and line to errors that core objects raise while they are built.

    Parameters
    ----------
    document : Document
    sections : mapping
        From the word an error of the core begins with to the section of the file, e.g.
        ``{'body': 'bodies'}``.

    Yields
    ------
    None

    """
    try:
        yield
    except document.error as error:
        message = str(error)
        part = re.match(r'(\w+) ([\w-]+): ', message)
        path = (sections.get(part[1], ''), part[2]) if part else ()
        line = document.line(path)
        place = document.where if line is None else f'{document.where}:{line}'
        raise document.error(f'{place}: {message}') from None


def with_kind(data: object) -> object:
    """
    Let a missing kind count as an empty one, so that the error lists the choice.

    Parameters
    ----------
    data : object
        Of a part of a file, as found.

    Returns
    -------
    object

    """
    return {KIND: '', **data} if isinstance(data, dict) else data


def word(text: str) -> str:
    """
    Check that a text can be the name of a part.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
        The same.

    Raises
    ------
    ValueError
        If it is no name.

    """
    if not _NAME.fullmatch(text):
        raise ValueError(
            f'found {shown(text)}, expected a name: a letter, then letters, digits, "_" or "-"'
        )
    return text


Name = Annotated[str, AfterValidator(word)]


class _Composer(yaml.BaseLoader):
    """Node trees without aliases, of limited depth."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Refuse what could make a small file huge."""
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            raise _refused('aliases ("*name") are not allowed; write the value out', event)
        self._depth += 1
        if self._depth > LARGEST_DEPTH:
            raise _refused(f'nested deeper than {LARGEST_DEPTH} levels', event)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


def _plain(node: yaml.Node, path: KeyPath, lines: dict[KeyPath, int]) -> Any:
    """Dictionaries, lists and texts of a node, noting the lines."""
    if node.tag not in _PLAIN_TAGS:
        raise _refused(f'tags ("{node.tag}") are not allowed', node)
    if isinstance(node, yaml.ScalarNode):
        return node.value
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            lines[(*path, index)] = item.start_mark.line + 1
        return [_plain(item, (*path, index), lines) for index, item in enumerate(node.value)]
    result: dict[str, Any] = {}
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode):
            raise _refused('a key must be a word', key_node)
        key = key_node.value
        if key in result:
            first = lines[(*path, key)]
            raise _refused(f'the key {shown(key)} is here twice, first in line {first}', key_node)
        lines[(*path, key)] = key_node.start_mark.line + 1
        result[key] = _plain(value_node, (*path, key), lines)
    return result


class _RefusedError(yaml.MarkedYAMLError):
    """Valid YAML that these files do not use."""


def _refused(problem: str, at: yaml.Node | yaml.Event) -> _RefusedError:
    return _RefusedError(problem=problem, problem_mark=at.start_mark)  # type: ignore[arg-type]


def _explained(cause: yaml.MarkedYAMLError) -> str:
    """Put the commonest complaints of the YAML parser into plain words."""
    problem = str(cause.problem or cause.context)
    if isinstance(cause, _RefusedError):
        return problem
    if "'\\t'" in problem:
        return 'found a tab; indent with spaces'
    if 'mapping values are not allowed here' in problem:
        return 'a second ":" in one line, or wrong indentation; quote texts that contain ": "'
    return f'is not YAML: {problem}'


def _shortened(part: str | int) -> str:
    text = ' '.join(str(part).split())
    return text if len(text) <= LONGEST_KEY else f'{text[: LONGEST_KEY - 3]}...'


def _either(choices: str) -> str:
    """Format a list of choices as pydantic gives it."""
    return choices.replace("'", '"')


def _suggestion(key: str, allowed: list[str]) -> str:
    close = get_close_matches(key, allowed, n=1)
    meant = f'; did you mean "{close[0]}"?' if close else ';'
    return f'{meant} allowed here: {", ".join(allowed)}'


def _neighbours(path: Path) -> str:
    close = get_close_matches(path.name, (p.name for p in path.parent.glob('*.y*ml')), n=1)
    return f'; did you mean {path.with_name(close[0])}?' if close else ''
