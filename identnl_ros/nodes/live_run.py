# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A stand's nodes as separate processes, and their estimates as they come."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
import os
import random
import signal
import subprocess
import sys
import threading
import time
from types import TracebackType

from identnl_msgs.msg import ParameterEstimateArray
from identnl_ros.core.errors import DataError
from identnl_ros.nodes import qos
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
import rclpy.utilities

POLL_INTERVAL = 0.1  # [s]
LONGEST_SILENCE = 60.0  # [s]
LONGEST_END = 10.0  # [s]
LAST_OWN_DOMAIN = 101


class LiveRun:
    """
    Bridge, transform and identifier, each a process, over DDS on this host alone.

    To be used in a `with` statement; leaving it ends the processes.

    Parameters
    ----------
    source : mapping
        Parameters of the sensor bridge.
    estimator : str
        Method of the identifier.
    publish_rate : float
        Of the estimates [Hz].

    """

    def __init__(
        self,
        source: Mapping[str, object],
        estimator: str = 'weak',
        publish_rate: float = 4.0,
    ) -> None:
        # Nothing of this leaves the host or meets another run, unless the user says so.
        os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        os.environ.setdefault('ROS_DOMAIN_ID', str(random.randint(1, LAST_OWN_DOMAIN)))
        self._namespace = '/stand'
        self._programs: dict[str, Mapping[str, object]] = {
            'identifier': {'estimator': estimator, 'publish_rate': publish_rate},
            'transform': {},
            'sensor_bridge': {**source, 'wait_for_consumers': 2, 'wait_timeout': 60.0},
        }
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._arrived: list[ParameterEstimateArray] = []
        self._node: Node | None = None
        self._executor: SingleThreadedExecutor | None = None

    def __enter__(self) -> 'LiveRun':
        """Start everything."""
        try:
            self._start()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End everything, sources first."""
        self._end()

    def _start(self) -> None:
        # An interrupt is for the caller to handle: rclpy's own handlers would shut the context
        # down under the executor.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('live_run', namespace=self._namespace)
        self._node.create_subscription(
            ParameterEstimateArray, 'estimates', self._arrived.append, qos.estimates()
        )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        for name, parameters in self._programs.items():
            with _signals_deferred():
                self._launch(name, parameters)

    def _launch(self, name: str, parameters: Mapping[str, object]) -> None:
        arguments = ['-r', f'__ns:={self._namespace}']
        for key, value in parameters.items():
            arguments += ['-p', f'{key}:={value}']
        self._processes[name] = subprocess.Popen(
            [sys.executable, '-m', f'identnl_ros.nodes.{name}', '--ros-args', *arguments,
             '--log-level', 'warn'],
            # An interrupt at the terminal reaches this process alone, which ends the others.
            start_new_session=True,
            stdout=sys.stderr.fileno(),
        )  # fmt: skip

    def _end(self) -> None:
        try:
            present = self._node.get_node_names() if self._node else []
            for name in reversed(self._processes):
                # One that still imports would answer an interrupt with a traceback, and has
                # nothing to finish.
                is_up = name in present
                self._processes[name].send_signal(signal.SIGINT if is_up else signal.SIGKILL)
            deadline = time.monotonic() + LONGEST_END
            for process in self._processes.values():
                with suppress(subprocess.TimeoutExpired):
                    process.wait(timeout=max(0.1, deadline - time.monotonic()))
        finally:
            for process in self._processes.values():
                if process.poll() is None:
                    process.kill()
                    process.wait()
            if self._executor:
                self._executor.shutdown()
            if self._node:
                self._node.destroy_node()
            rclpy.utilities.try_shutdown()

    def estimates(self) -> Iterator[ParameterEstimateArray]:
        """
        Yield the estimates as they come, up to that of the ended stream.

        Raises
        ------
        DataError
            If a process ends before its time or nothing comes for a minute.

        """
        assert self._executor, 'to be used in a with statement'
        heard = time.monotonic()
        while True:
            self._executor.spin_once(timeout_sec=POLL_INTERVAL)
            while self._arrived:
                heard = time.monotonic()
                message = self._arrived.pop(0)
                yield message
                if message.stream_ended:
                    return
            for name, process in self._processes.items():
                if process.poll() is not None:
                    raise DataError(
                        f'the process {name} has ended (exit code {process.returncode}); '
                        'its messages above say why'
                    )
            if time.monotonic() - heard > LONGEST_SILENCE:
                raise DataError(
                    f'no estimate for {LONGEST_SILENCE:.0f} s; does a firewall keep this host '
                    'from talking to itself (loopback)?'
                )


@contextmanager
def _signals_deferred() -> Iterator[None]:
    """Let a signal wait while a process is started: nobody would end one not yet written down."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in numbers}
    for number in numbers:
        signal.signal(number, lambda number, _frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])
