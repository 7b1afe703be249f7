# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The command line, run in this process or as a process of its own."""

import json
from pathlib import Path
import subprocess
import sys
from typing import Any

from click.testing import CliRunner, Result
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='session')
def config():
    """Folder of the shipped machine and layout files."""
    return ROOT / 'config'


@pytest.fixture(scope='session')
def bags():
    """Folder of the shipped bags."""
    return ROOT / 'bags'


@pytest.fixture
def identnl():
    """Call the command line in this process; what no command expects is raised."""
    from identnl_ros.cli.commands import cli

    def call(*arguments: object) -> Result:
        result = CliRunner().invoke(cli, [str(one) for one in arguments], prog_name='identnl')
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return call


@pytest.fixture
def document(identnl):
    """Call a command with --json and give back its document."""

    def call(*arguments: object) -> dict[str, Any]:
        result = identnl(*arguments, '--json')
        assert result.exit_code in (0, 1), result.stderr
        found: dict[str, Any] = json.loads(result.stdout)
        return found

    return call


@pytest.fixture
def process():
    """Run the command line as a process of its own."""

    def call(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, '-m', 'identnl_ros.cli.main', *(str(one) for one in arguments)],
            capture_output=True,
            text=True,
            timeout=120,
            cwd=cwd,
        )

    return call
