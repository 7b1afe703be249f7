# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What all commands share: JSON or text, messages on standard error, exit codes."""

from collections.abc import Callable
from dataclasses import dataclass
import functools
import json
import sys
from typing import Any

import click
from identnl_ros.core.errors import IdentnlError

DONE = 0
NEGATIVE = 1
WRONG_USE = 2
UNWRITABLE = 'standard output cannot be written'
WRITABLE = 'make room, or send it elsewhere'


@dataclass(frozen=True)
class Outcome:
    """
    What a command has to say.

    Parameters
    ----------
    document : dict
        For programs; one JSON document.
    show : callable
        Prints the same for people.
    exit_code : int
        `DONE` or `NEGATIVE`.

    """

    document: dict[str, Any]
    show: Callable[[], None]
    exit_code: int = DONE


def command(function: Callable[..., Outcome]) -> Callable[..., None]:
    """
    Turn a function that returns an `Outcome` into the body of a command with --json.

    Parameters
    ----------
    function : callable

    Returns
    -------
    callable
        Takes `as_json` besides the function's own arguments; reports errors in a sentence.

    """

    @click.option('--json', 'as_json', is_flag=True, help='One JSON document on standard output.')
    @functools.wraps(function)
    def body(*, as_json: bool, **arguments: Any) -> None:
        try:
            outcome = function(**arguments)
        except (IdentnlError, OSError) as error:
            _fail(str(error), as_json, WRONG_USE)
        except MemoryError:
            _fail('not enough memory for so much data at once', as_json, WRONG_USE)
        try:
            if as_json:
                print(json.dumps(outcome.document, indent=2, allow_nan=False))
            else:
                outcome.show()
            sys.stdout.flush()
        except BrokenPipeError:
            # The reader has seen enough; keep the interpreter from complaining at exit.
            sys.stdout = None
            sys.exit(DONE)
        except IdentnlError as error:
            _fail(str(error), as_json, WRONG_USE)
        except OSError as error:
            # Nothing more can be written there, not even this.
            sys.stdout = None
            _fail(f'{UNWRITABLE}: {error.strerror or error}; {WRITABLE}', False, WRONG_USE)
        sys.exit(outcome.exit_code)

    return body


def say(message: str) -> None:
    """
    Tell people something that is not the result, on standard error.

    Parameters
    ----------
    message : str

    """
    click.echo(message, err=True)


def _fail(message: str, as_json: bool, exit_code: int) -> None:
    say(f'identnl {click.get_current_context().info_name}: {message}')
    if as_json:
        show_error(message)
    sys.exit(exit_code)


def show_error(message: str) -> None:
    """
    Write the document of an error, as far as standard output takes it.

    Parameters
    ----------
    message : str

    """
    try:
        print(json.dumps({'error': message}, indent=2), flush=True)
    except OSError:
        sys.stdout = None
