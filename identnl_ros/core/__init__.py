# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Mechanics and statistics: no ROS, no files, no printing."""
