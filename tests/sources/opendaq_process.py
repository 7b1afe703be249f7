# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Starts `opendaq_server.py` as a process and ends it."""

import json
from pathlib import Path
import socket
import subprocess
import sys

import pytest

SCRIPT = Path(__file__).with_name('opendaq_server.py')


class OpenDaqProcess:
    """
    A device in another process.

    Parameters
    ----------
    table : Path
    channels : list of dict
    rate : int
        [Hz].
    begin : int
        Index of the first sample.
    origin : str
        Of the clock.
    port : int
        On the loopback device; 0: any that is free.

    """

    def __init__(
        self,
        table: Path,
        channels: list[dict[str, object]],
        rate: int,
        begin: int,
        origin: str = '1970-01-01T00:00:00Z',
        port: int = 0,
    ) -> None:
        self._table, self._channels, self._rate = table, channels, rate
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(('127.0.0.1', port))
            listener.listen()
            self.port = listener.getsockname()[1]
            arguments = [listener.fileno(), table, json.dumps(channels), rate, begin]
            self.process = subprocess.Popen(
                [sys.executable, SCRIPT, *map(str, arguments), '--origin', origin],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                pass_fds=[listener.fileno()],
            )
        if self.process.stdout.readline().strip() != 'ready':
            words = self.process.stderr.read()
            self.kill()
            if 'no network namespace' in words:
                pytest.skip(f'{words.strip()}; the server of the SDK would listen on all networks')
            pytest.fail(words)

    def address(self, protocol: str) -> str:
        """Give the connection string."""
        return f'{protocol}://127.0.0.1:{self.port}'

    def command(self, words: str) -> None:
        """Change what is sent."""
        self.process.stdin.write(f'{words}\n')
        self.process.stdin.flush()

    def again(self, begin: int, origin: str = '1970-01-01T00:00:00Z') -> 'OpenDaqProcess':
        """Start another one on the same port."""
        return OpenDaqProcess(self._table, self._channels, self._rate, begin, origin, self.port)

    def kill(self) -> None:
        """End the process; its connections break."""
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()
