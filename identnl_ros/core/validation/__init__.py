# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Agreement of a model with data that it has not seen."""
