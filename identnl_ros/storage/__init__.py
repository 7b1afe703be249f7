# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Files to core objects and back; nothing here knows ROS."""
