# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The life of a process with nodes: start, run, and an end that loses nothing."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import re
import signal
import sys
import time
import traceback
from types import FrameType

from identnl_ros.nodes.managed_node import ManagedNode
import rclpy
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterException,
)
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

DRAIN_LIMIT = 4.0  # [s] launchers send SIGTERM 5 s after SIGINT
SIGNAL_INTERVAL = 0.1  # [s] a signal is noticed at the latest after this time
# A terminal and a launcher may each send the first signal; one more means it.
ABRUPT = 1

_TYPES = re.compile(r"to '(.*)' of type '(\w+)', expecting type '(\w+)'", re.DOTALL)


class _Signals:
    """Counts the requests to end."""

    def __init__(self) -> None:
        self.count = 0

    def note(self, _number: int, _frame: FrameType | None) -> None:
        self.count += 1


def run(make_nodes: Callable[[], Sequence[ManagedNode]], args: Sequence[str] | None = None) -> int:
    """
    Run nodes in this process until SIGINT, SIGTERM or one of them wants to end.

    Then each node in turn, in the order given, uses what has arrived for it and finishes.

    Parameters
    ----------
    make_nodes : callable
        Makes the nodes, sources first.
    args : sequence of str or None
        Arguments with those of ROS; None: those of the process.

    Returns
    -------
    int
        Exit code: 0, or 1 if a node could not be started.

    """
    nodes: Sequence[ManagedNode] = ()
    with _caught_signals() as signals:
        try:
            rclpy.init(
                args=None if args is None else list(args),
                signal_handler_options=SignalHandlerOptions.NO,
            )
            nodes = make_nodes()
            # Measured with a stand in one process: see docs/nodes.md. Several threads would only
            # compete for Python's lock, and the multi-threaded executor loses messages.
            executor = SingleThreadedExecutor()
            for node in nodes:
                executor.add_node(node)
            # Consumers first: a source finds them waiting.
            if not all(node.start() for node in reversed(nodes)):
                return 1
            _spin(executor, lambda: signals.count or any(node.wants_to_exit for node in nodes))
            _end(nodes, executor, signals)
            return 0
        except (ParameterException, RuntimeError, ValueError) as error:
            print(_explained(error), file=sys.stderr)  # noqa: T201
            return 1
        finally:
            for node in nodes:
                node.close()
                node.destroy_node()
            try_shutdown()


@contextmanager
def _caught_signals() -> Iterator[_Signals]:
    """Take the signals that ask to end; rclpy's own handling would cut the ground away."""
    signals = _Signals()
    before = {
        number: signal.signal(number, signals.note) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _spin(
    executor: SingleThreadedExecutor,
    is_over: Callable[[], object],
    interval: float = SIGNAL_INTERVAL,
) -> None:
    while not is_over():
        try:
            executor.spin_once(timeout_sec=interval)
        except ExternalShutdownException:
            return
        except Exception:
            # A request to one of ROS's own services that nobody can answer must not end a node.
            rclpy.logging.get_logger('identnl_ros').error(
                f'unexpected error, please report:\n{traceback.format_exc()}'
            )
            time.sleep(0.01)


def _end(
    nodes: Sequence[ManagedNode], executor: SingleThreadedExecutor, signals: _Signals
) -> None:
    """Let every node use what has arrived, in the order in which data pass through them."""
    deadline = time.monotonic() + DRAIN_LIMIT
    asked = signals.count
    for node in nodes:
        node.begin_to_end()
        _spin(
            executor,
            lambda node=node: (  # type: ignore[misc]
                node.is_drained() or signals.count > asked + ABRUPT or time.monotonic() > deadline
            ),
            0.02,
        )
        node.close()


def _explained(error: Exception) -> str:
    if isinstance(error, InvalidParameterTypeException):
        return f'{error}{_in_yaml(str(error))}'
    if isinstance(error, InvalidParameterValueException):
        return f'a parameter is out of its range: {error}'
    return str(error)


def _in_yaml(refusal: str) -> str:
    """Say how a value of the expected type is written."""
    match = _TYPES.search(refusal)
    if match is None:
        return ''
    value, found, expected = match.groups()
    match expected:
        case 'DOUBLE':
            return '; write a number with a point, e.g. ' + (
                f'{value}.0' if found == 'INTEGER' else '2.0'
            )
        case 'STRING_ARRAY':
            return f'; write a list: ["{value}"]'
        case 'STRING':
            return f'; write a text in two kinds of quotes: "\'{value}\'"'
        case 'INTEGER':
            return '; write a whole number without a point, e.g. 2'
        case 'BOOL':
            return '; write true or false'
        case _:
            return ''
