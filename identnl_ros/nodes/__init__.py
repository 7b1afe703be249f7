# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The nodes: the only code that knows ROS; they convert, call, publish and compute nothing."""
