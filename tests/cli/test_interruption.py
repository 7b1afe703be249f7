# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whoever ends a command gets a line and an exit code, and nothing half-written stays."""

import importlib.util
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from identnl_ros.cli.main import Interruption
import pytest

LONG = ('--duration', '100000', '--noise', 'none')
NEEDS_ROS = pytest.mark.skipif(
    not all(importlib.util.find_spec(one) for one in ('rclpy', 'identnl_msgs')), reason='no ROS 2'
)


@pytest.fixture
def begin():
    """Start the command line as a process that does not outlive the test."""
    processes = []

    def call(*arguments):
        process = subprocess.Popen(
            [sys.executable, '-m', 'identnl_ros.cli.main', *(str(one) for one in arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield call
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_for(condition, limit=120):
    deadline = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize('suffix', ['.mcap', ''])
def test_interrupted_simulation_leaves_nothing(begin, config, tmp_path, number, suffix):
    process = begin(
        'simulate', '--machine', config / 'knee_column.yaml', *LONG, '--json',
        '--out', tmp_path / f'run{suffix}',
    )  # fmt: skip
    wait_for(lambda: list(tmp_path.glob('.run*.part')))
    time.sleep(0.5)
    process.send_signal(number)
    process.send_signal(number)  # as timeout and a terminal may both do
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == 128 + number
    assert json.loads(stdout) == {'error': 'interrupted'}
    assert stderr == 'interrupted\n'
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings('ignore::pytest.PytestUnraisableExceptionWarning')
def test_interrupt_that_python_throws_away_comes_again():
    class Ending:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.01)

    def wait():
        ending = Ending()
        del ending
        time.sleep(5)

    with pytest.raises(KeyboardInterrupt), Interruption().caught():
        wait()
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.parametrize('delay', [0.0, 0.1, 0.2])
def test_interrupt_while_importing_is_a_line(begin, config, tmp_path, delay):
    process = begin(
        'simulate', '--machine', config / 'knee_column.yaml', *LONG, '--out', tmp_path / 'x.mcap'
    )
    status = Path(f'/proc/{process.pid}/status')

    def catches_sigterm():
        mask = next(one for one in status.read_text().splitlines() if one.startswith('SigCgt'))
        return int(mask.split()[1], 16) & (1 << (signal.SIGTERM - 1))

    wait_for(catches_sigterm)
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=120)
    assert stderr == 'interrupted\n'
    # In the middle of exec() Python itself insists on dying of the signal; shells tell it as 130.
    assert process.returncode in (130, -signal.SIGINT)


def test_interrupt_that_compiled_code_turned_into_an_error_is_one(monkeypatch, capsys):
    from identnl_ros.cli import commands, main

    def fail(*_, **__):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError('returned a result with an exception set') from error

    monkeypatch.setattr(commands.cli, 'main', fail)
    monkeypatch.setattr(sys, 'argv', ['identnl', 'check', 'x', '--json'])
    with pytest.raises(SystemExit) as caught:
        main.run()
    assert caught.value.code == 130
    captured = capsys.readouterr()
    assert captured.err == 'interrupted\n'
    assert json.loads(captured.out) == {'error': 'interrupted'}


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (('frobnicate', '--json'), 'frobnicate'),
        (('identify', '--json'), 'BAG'),
        (('simulate', '--machine', 'x', '--rate', '5 kg', '--out', 'y', '--json'), '5 kg'),
    ],
)
def test_usage_error_is_a_document_too(process, arguments, words):
    result = process(*arguments)
    assert result.returncode == 2
    assert words in json.loads(result.stdout)['error']
    assert 'Usage: identnl' in result.stderr
    assert words in result.stderr


def test_help_and_version_are_no_errors(process):
    for arguments in (('--help',), ('--version',), ('simulate', '--help')):
        result = process(*arguments)
        assert (result.returncode, result.stderr) == (0, '')
    assert process('frobnicate').stdout == ''


@NEEDS_ROS
@pytest.mark.parametrize('name', ['there.mcap', 'no/folder/x.mcap'])
def test_recording_to_an_unusable_path_is_refused_at_once(identnl, tmp_path, name):
    (tmp_path / 'there.mcap').write_bytes(b'')
    result = identnl('record', '--out', tmp_path / name, '--json')
    assert result.exit_code == 2
    assert str(tmp_path / name) in json.loads(result.stdout)['error']


@NEEDS_ROS
def test_record_of_nothing_says_so(begin, tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    process = begin('record', '--out', tmp_path / 'x.mcap', '--namespace', '/nobody')
    wait_for((tmp_path / 'x.mcap').exists)
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 1
    assert 'nothing was published on /nobody/samples' in stderr


@NEEDS_ROS
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('delay', [0.0, 0.7, 6.0])
def test_interrupted_demo_ends_its_processes(begin, number, delay):
    process = begin('demo', '--duration', '60', '--json')
    children = f'/proc/{process.pid}/task/{process.pid}/children'
    wait_for(lambda: len(Path(children).read_text().split()) == 3)
    started = Path(children).read_text().split()
    time.sleep(delay)
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == 128 + number
    assert json.loads(stdout) == {'error': 'interrupted'}
    assert 'Traceback' not in stderr
    assert not [one for one in started if _is_running(one)]


def _is_running(pid):
    try:
        return ' Z ' not in Path(f'/proc/{pid}/stat').read_text()
    except OSError:
        return False
