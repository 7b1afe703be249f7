# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Trustworthy data: what is wrong with which channel, and since when."""
