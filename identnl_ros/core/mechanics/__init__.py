# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The machine: bodies, joints, their laws, and the equations of motion."""
