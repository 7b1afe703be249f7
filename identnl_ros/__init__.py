# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Identification of the nonlinear joints of vibrating machine tools."""

import os

__version__ = '0.1.0'

# The matrices are small: threads of the linear algebra only wait for each other, and the
# processes of a stand, each with as many threads as the host has cores, slow each other down to a
# tenth. Rounding depends on their number too, and a bag shall give the bits of the live run.
# Counts for what imports this before numpy.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
