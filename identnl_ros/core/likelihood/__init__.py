# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Maximum likelihood from all sensor channels."""
