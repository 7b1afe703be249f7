# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Time integration of the equations of motion and of their derivatives."""
