# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Where ROS is required, a skipped ROS test is not green; domains are kept apart."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

CONFTEST = Path(__file__).resolve().parents[1] / 'conftest.py'
SETTINGS = '[pytest]\nmarkers = ros\n'


def outcome(folder: Path, text: str, required: str) -> str:
    """Run a test file of its own with the settings of all tests; return the closing line."""
    shutil.copy(CONFTEST, folder)
    (folder / 'pytest.ini').write_text(SETTINGS)
    (folder / 'test_sample.py').write_text(f'import os\n\nimport pytest\n\n\n{text}')
    result = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', folder],
        env={**os.environ, 'IDENTNL_REQUIRE_ROS': required},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    return result.stdout.splitlines()[-1]


SKIPPED_ROS_TEST = "@pytest.mark.ros\ndef test_it():\n    pytest.skip('no ROS')\n"
SKIPPED_TEST = "def test_it():\n    pytest.skip('not today')\n"
SKIPPED_MODULE = "pytest.importorskip('there_is_no_such_module')\n"


@pytest.mark.parametrize(
    ('text', 'required', 'expected'),
    [
        (SKIPPED_ROS_TEST, '0', '1 skipped'),
        (SKIPPED_ROS_TEST, '1', '1 failed'),
        (SKIPPED_TEST, '1', '1 skipped'),
        (SKIPPED_MODULE, '0', '1 skipped'),
        (SKIPPED_MODULE, '1', '1 error'),
    ],
)
def test_skipped_ros_test_fails_where_ros_is_required(tmp_path, text, required, expected):
    assert outcome(tmp_path, text, required).startswith(expected)


def test_domain_is_shared_with_no_other_process(tmp_path, ros_domain):
    text = f'def test_it(ros_domain):\n    assert ros_domain != {ros_domain}\n'
    assert outcome(tmp_path, text, '0').startswith('1 passed')
    assert os.environ['ROS_DOMAIN_ID'] == str(ros_domain)


def test_discovery_keeps_to_this_machine():
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
