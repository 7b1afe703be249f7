# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Where simulation and measurement disagree: find the missing effect, name it, add it."""
