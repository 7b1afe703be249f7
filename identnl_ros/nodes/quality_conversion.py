# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The condition of the channels as a message."""

from array import array

from identnl_msgs.msg import DataQuality
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.quality.monitor import BlockQuality
from identnl_ros.nodes.conversions import to_header
import numpy as np


def quality_to_message(quality: BlockQuality, block: SampleBlock) -> DataQuality:
    """
    Make a message of the condition of a block's channels.

    Parameters
    ----------
    quality : BlockQuality
    block : SampleBlock
        The cleaned samples that it is about.

    Returns
    -------
    identnl_msgs.msg.DataQuality

    """
    return DataQuality(
        header=to_header(block.stamp_ns),
        stream_id=block.stream_id,
        first_sample_index=quality.first_index,
        sample_count=quality.next_index - quality.first_index,
        channel_status=array('H', np.asarray(quality.status, np.uint16).tobytes()),
        excluded_samples=array('I', np.asarray(quality.excluded, np.uint32).tobytes()),
        findings=[finding.sentence for finding in quality.findings],
    )
