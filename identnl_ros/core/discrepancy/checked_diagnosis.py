# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis together with its check on other data."""

from dataclasses import dataclass

from identnl_ros.core.discrepancy.diagnosis import Diagnosis
from identnl_ros.core.discrepancy.held_out import HeldOutError
from identnl_ros.core.mechanics.machine import Machine


@dataclass(frozen=True)
class CheckedDiagnosis:
    """
    A diagnosis of measured data and what it is worth on data that it has not seen.

    Parameters
    ----------
    diagnosis : Diagnosis
    machine : Machine
        As given.
    samples, held_out_samples : int
    sample_rate : float
        [Hz].
    before, after : HeldOutError
        Of the model as given and of the corrected one.
    problems : tuple of str
        Of the data.

    """

    diagnosis: Diagnosis
    machine: Machine
    samples: int
    held_out_samples: int
    sample_rate: float
    before: HeldOutError
    after: HeldOutError
    problems: tuple[str, ...]
