# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Values to start a fit from, from a record of all sensors."""

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.motion_record import records_of
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.weak.weak_identifier import noise_of
from identnl_ros.core.weak.weak_start import weak_form_start
import numpy as np


def rough_start(model: Model, record: MeasuredRecord) -> Model:
    """
    Estimate the unknowns from weak-form windows: rough, but without any start value.

    Parameters
    ----------
    model : Model
        Preloads and exponents need values.
    record : MeasuredRecord

    Returns
    -------
    Model

    Raises
    ------
    DataError
        If the record is too short or nothing moves.
    LayoutError
        If the sensors do not see every motion of the bodies.

    """
    transform = MotionTransform(model, record.layout, record.sample_rate)
    status = np.zeros(record.samples.shape[1], np.uint8)
    block = transform.add(
        SampleBlock(
            1, 0, record.first_index, record.sample_rate, record.samples, status, last=True
        )
    )
    if block is None:
        raise DataError('the record is too short to start from')
    directions = model.excitation_directions
    motion = max(records_of(block, directions), key=len)
    weighed = noise_of(block, directions).weigh(motion)
    return weak_form_start(model, [motion], weighed.weights, weighed.function)
