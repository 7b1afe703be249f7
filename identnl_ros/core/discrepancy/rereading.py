# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What the recorded numbers mean if another layout is right."""

from dataclasses import replace

from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.measurement.measured_record import MeasuredRecord
import numpy as np


def reread(record: MeasuredRecord, layout: Layout) -> MeasuredRecord:
    """
    Read the recorded numbers with another layout.

    Parameters
    ----------
    record : MeasuredRecord
    layout : Layout
        Of the same channels.

    Returns
    -------
    MeasuredRecord

    """
    time = record.time
    columns = [
        new.to_si(old.to_recorded(record.samples[:, i], time), time)
        for i, (old, new) in enumerate(zip(record.layout.sensors, layout.sensors, strict=True))
    ]
    return replace(record, layout=layout, samples=np.column_stack(columns))
