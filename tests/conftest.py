# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""
Settings of all tests: ROS keeps to this machine, each ROS test to a domain of its own.

With the environment variable ``IDENTNL_REQUIRE_ROS=1`` a test marked ``ros`` that is skipped
counts as failed (``.ci/run`` sets it), so that green means that ROS was there.

"""

from collections.abc import Generator, Iterator
import fcntl
import itertools
import os
from pathlib import Path
import signal
import tempfile

import pytest

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# ROS wants a folder for its logs, also where no home folder is set.
os.environ.setdefault('ROS_LOG_DIR', str(Path(tempfile.gettempdir()) / 'identnl_ros_test_logs'))

# A shell lets what it runs in the background ignore interrupts; processes of tests inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:  # so does nohup with hang-ups
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

FIRST_DOMAIN = 1
LAST_DOMAIN = 101  # the ports of higher domains overlap Linux's range of ephemeral ports
_domains_tried = itertools.count(os.getpid())


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """
    Take a ROS domain that no other test process on this machine uses; set ROS_DOMAIN_ID.

    The lock on a file per domain is the claim; it ends with the process, however it ends.

    """
    folder = Path(tempfile.gettempdir()) / f'identnl_ros_test_domains_{os.getuid()}'
    folder.mkdir(exist_ok=True)
    count = LAST_DOMAIN - FIRST_DOMAIN + 1
    for number in itertools.islice(_domains_tried, count):
        domain = FIRST_DOMAIN + number % count
        with (folder / str(domain)).open('w') as claim:
            try:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
            yield domain
            return
    pytest.fail(f'ROS domains {FIRST_DOMAIN} to {LAST_DOMAIN} are all taken: see {folder}')


@pytest.fixture(autouse=True)
def _ros_tests_have_a_domain(request: pytest.FixtureRequest) -> None:
    if request.node.get_closest_marker('ros'):
        request.getfixturevalue('ros_domain')


def _fail_if_skipped(report: pytest.TestReport | pytest.CollectReport) -> None:
    if os.environ.get('IDENTNL_REQUIRE_ROS') == '1' and report.skipped:
        report.outcome = 'failed'
        report.longrepr = f'skipped, but IDENTNL_REQUIRE_ROS=1: {report.longrepr}'


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if item.get_closest_marker('ros') and not hasattr(report, 'wasxfail'):
        _fail_if_skipped(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Count a module skipped as a whole as failed too: it may hold ROS tests."""
    report = yield
    _fail_if_skipped(report)
    return report
