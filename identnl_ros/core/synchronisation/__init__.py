# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""One time base: clocks of sources, resampling, delays that the data themselves show."""
