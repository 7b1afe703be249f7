# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""One effect per file: see `identnl_ros.core.discrepancy.effect`."""
