# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What sensors read, and how readings become the motion of bodies."""
