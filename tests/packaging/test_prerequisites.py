# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""What the set-up lacks is named with the package that brings it, before anything is made."""

from pathlib import Path
import platform
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
PYTHON = f'python{sys.version_info.major}.{sys.version_info.minor}'
BASE_PYTHON = getattr(sys, '_base_executable', sys.executable)

pytestmark = pytest.mark.skipif(
    f'{platform.system()} {platform.machine()}' != 'Linux x86_64' or not shutil.which('make'),
    reason='the set-up is for Linux on x86_64, and needs make',
)


class Machine:
    """A copy of what the set-up starts with, and a PATH on which only chosen commands are."""

    def __init__(self, folder: Path):
        self.checkout = folder / 'checkout'
        self.commands = folder / 'bin'
        (self.checkout / 'msg_defs').mkdir(parents=True)
        self.commands.mkdir()
        shutil.copy(ROOT / 'Makefile', self.checkout)
        shutil.copytree(ROOT / 'tools', self.checkout / 'tools')
        for name in ('cat', 'find', 'sed', 'sh', 'touch', 'uname'):
            (self.commands / name).symlink_to(shutil.which(name))
        for name in ('g++', 'git'):
            self.add(name, 'exit 0')
        self.add_python('python3')

    def add(self, name: str, script: str):
        command = self.commands / name
        command.write_text(f'#!/bin/sh\n{script}\n')
        command.chmod(0o755)

    def add_python(self, name: str, lacking: str = ''):
        """Add an interpreter that, asked for the thing that is lacking, does not find it."""
        edit = f"sed 's/{lacking}/missing_thing/' |" if lacking else ''
        self.add(name, f'{edit} "{BASE_PYTHON}" "$@"')

    def remove(self, name: str):
        (self.commands / name).unlink()

    def make_setup(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [shutil.which('make'), 'setup', *arguments],
            cwd=self.checkout,
            env={'PATH': str(self.commands)},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    def prerequisites(self, *pythons: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self.checkout / 'tools/prerequisites.sh', *pythons],
            env={'PATH': str(self.commands)},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def refusal(machine: Machine, *arguments: str) -> str:
    """Return what a set-up says that refuses to start, having made nothing."""
    # The lock file is missing in the copy: were it ever needed, make would say so.
    (machine.checkout / 'requirements.lock').touch()
    for name in ('setup.py', 'setup.cfg', 'package.xml'):
        (machine.checkout / name).touch()
    result = machine.make_setup(*arguments)
    assert result.returncode != 0
    assert not (machine.checkout / '.venv').exists()
    return result.stderr


def test_complete_machine_is_accepted(machine):
    result = machine.prerequisites()
    assert result.returncode == 0, result.stderr
    assert Path(result.stdout.strip()).samefile(BASE_PYTHON)


@pytest.mark.parametrize('command', ['g++', 'git'])
def test_missing_command_is_named(machine, command):
    machine.remove(command)
    assert f'{command} not found: install the package {command}\n' in refusal(machine)


def test_missing_python_is_named(machine):
    machine.remove('python3')
    said = refusal(machine)
    assert 'Python 3.11 or newer' in said
    assert 'install the package python3' in said


def test_too_old_python_is_refused(machine):
    machine.add('python3', 'cat >/dev/null; exit 1')
    assert 'Python 3.11 or newer' in refusal(machine)


@pytest.mark.parametrize(
    ('lacking', 'package'), [('ensurepip', f'{PYTHON}-venv'), ('Python\\.h', f'{PYTHON}-dev')]
)
def test_incomplete_python_is_named(machine, lacking, package):
    machine.add_python('python3', lacking)
    assert f'install the package {package}\n' in refusal(machine)


def test_everything_missing_is_named_at_once(machine):
    for command in ('g++', 'git', 'python3'):
        machine.remove(command)
    said = refusal(machine)
    assert all(word in said for word in ('g++ not found', 'git not found', 'Python 3.11'))


def test_command_that_only_prints_an_error_is_passed_over(machine):
    machine.add('python3.12', 'echo "python3.12: command not found" >&2; exit 127')
    assert machine.prerequisites().returncode == 0


def test_complete_python_is_preferred_to_an_incomplete_one(machine):
    machine.add_python('python3.12', 'ensurepip')
    assert machine.prerequisites().returncode == 0


def test_chosen_python_is_the_only_candidate(machine):
    assert '(tried python9) not found' in refusal(machine, 'PYTHON=python9')
