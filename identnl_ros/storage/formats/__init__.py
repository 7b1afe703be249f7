# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Tables of other programs, read and written: one format a file, one interface for all."""
