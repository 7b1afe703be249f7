# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The formats of tables, for the options of commands; nothing heavy is imported."""

READABLE = ('csv', 'uff58', 'mat', 'tdms', 'hdf5', 'parquet')
WRITABLE = ('csv', 'uff58', 'parquet')
