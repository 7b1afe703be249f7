# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Short gaps in smooth series, bridged from the samples around them."""

from identnl_ros.core.measurement.measured_record import MARGIN
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

# So many lost samples in a row are bridged.
LONGEST_GAP = 3


def bridged(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Fill short gaps from the samples around them.

    Parameters
    ----------
    samples : ndarray, shape (n_samples,)
        NaN where there is none.

    Returns
    -------
    ndarray, shape (n_samples,)
        Still NaN in gaps longer than `LONGEST_GAP`.

    """
    valid = np.isfinite(samples)
    if valid.all():
        return samples
    filled = samples.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ~valid, [False])).astype(np.int8)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        around = np.arange(max(0, begin - MARGIN), min(len(samples), end + MARGIN))
        around = around[valid[around]]
        if end - begin <= LONGEST_GAP and around.size > MARGIN:
            spline = make_interp_spline(around, samples[around], 5)
            filled[begin:end] = spline(np.arange(begin, end))
    return filled
