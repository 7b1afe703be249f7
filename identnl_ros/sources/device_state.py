# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How a device is, for the user."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DeviceState:
    """
    How a device is.

    Parameters
    ----------
    name : str
    problem : str
        Why no samples come from it at present, in a sentence; empty: they come.
    samples : int
        That came from it.
    lost_samples : int
        That did not: missing in what it delivered, while it was away, or because they were
        not taken in time.
    reconnects : int
        How often it came back.
    sample_rate : float
        Nominal [Hz].
    measured_rate : float
        By the running index and the stamps since it last came [Hz]; NaN: not known yet.

    """

    name: str
    problem: str
    samples: int
    lost_samples: int
    reconnects: int
    sample_rate: float
    measured_rate: float
