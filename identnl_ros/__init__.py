# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Identification of the nonlinear joints of vibrating machine tools."""

__version__ = '0.1.0'
