# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Commands that need ROS 2 say so where it is not installed."""

import importlib.util

from identnl_ros.core.errors import DataError


def require_ros() -> None:
    """
    Check that the nodes can run here.

    Raises
    ------
    DataError
        If rclpy or the message package is missing.

    """
    for package in ('rclpy', 'identnl_msgs'):
        if importlib.util.find_spec(package) is None:
            raise DataError(
                f'{package} is not installed for this Python; this command needs ROS 2 Jazzy '
                'and the message package: run "make setup", or source a ROS workspace in which '
                'identnl_ros is built'
            )
