# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The nodes: the only code that knows ROS; they convert, call, publish and compute nothing."""

import os

# The matrices are small: threads of the linear algebra only wait for each other, and the nodes of
# a stand, each with as many threads as the host has cores, slow each other down to a tenth.
# Rounding depends on the number of threads too. Counts for what imports this before numpy.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
