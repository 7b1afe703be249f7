# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Calibration of sensors from quiet records, from known inputs and from rigid-body motion."""
