# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A parameter that a node does not have is told, with the nearest that it has."""

import os
import subprocess
import sys

import pytest


def test_misspelt_parameter_is_warned_of():
    pytest.importorskip('rclpy')
    result = subprocess.run(
        [sys.executable, '-m', 'identnl_ros.nodes.sensor_bridge', '--ros-args',
         '-p', 'excitaton:=sine', '-p', 'seed:=1', '-p', 'use_sim_time:=false'],
        capture_output=True, text=True, timeout=60,
        env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
    )  # fmt: skip
    output = result.stdout + result.stderr
    assert 'parameter "excitaton" is unknown; did you mean "excitation"?' in output
    assert output.count('is unknown;') == 1
